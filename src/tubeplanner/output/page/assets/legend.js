// What the colours mean.

function swatch(color) {
  const made = element("span", "swatch");
  made.style.background = color;
  return made;
}

function breakable(text) {  // in a narrow panel, after these letters
  return text.replace(/[/_.]/g, "$&\u200b");
}

function layerBody(layer) {
  const body = element("span", "body");
  const inLine = layer.entries.every(({text}) => !text) ? layer.entries : [];
  if (layer.dashed) {
    const line = element("span", "dashed");
    line.style.borderColor = layer.dashed;
    body.append(line);
  }
  inLine.forEach((entry) => body.append(swatch(entry.color)));
  body.append(layer.label);
  if (!inLine.length) layer.entries.forEach((entry) => {
    const line = element("span", "entry");
    if (entry.color) line.append(swatch(entry.color));
    line.append(entry.text);
    body.append(line);
  });
  if (layer.scale) {
    const bar = element("div", "bar"), ticks = element("div", "ticks");
    bar.style.background = `linear-gradient(to right, ${layer.scale.colors.join(",")})`;
    layer.scale.ticks.forEach((tick) => ticks.append(element("span", "", tick)));
    body.append(bar, ticks);
  }
  return body;
}

function addLayer(layer) {
  const row = element("label", "layer"), box = element("input");
  box.type = "checkbox";
  box.checked = layer.visible;
  box.addEventListener("change", () => { show(layer.name, box.checked); });
  row.append(box, layerBody(layer));
  byId("layers").append(row);
}

function show(layer, visible) {
  objectAt(layer).visible = visible;
  viewer.set_dirty();
}

function addTrajectories() {
  const table = byId("trajectories"), head = element("tr");
  ["trajectory", "duration", "top speed"].forEach((text) => head.append(element("th", "", text)));
  table.append(head);
  data.trajectories.forEach((trajectory) => {
    const row = element("tr"), name = element("td");
    if (data.trajectories.length > 1) name.append(swatch(trajectory.color));
    name.append(breakable(trajectory.name));
    row.append(name, element("td", "duration", trajectory.lasts),
               element("td", "", trajectory.top));
    table.append(row);
  });
}

function setPanel(open) {
  byId("panel").classList.toggle("open", open);
  byId("fold").textContent = open ? "\u00d7" : "Legend";
  byId("fold").setAttribute("aria-expanded", open);
}

function fillPanel() {
  document.title = data.title;
  byId("name").textContent = breakable(data.title);
  byId("about").textContent = data.about;
  byId("hint").textContent = data.hint;
  if (data.duration > 0) addTrajectories();
  data.layers.forEach(addLayer);
  data.notes.forEach((note) => byId("notes").append(element("div", "note", note)));
  byId("fold").addEventListener("click", () => {
    setPanel(!byId("panel").classList.contains("open"));
    lookAtAll(lookedFrom);
  });
}

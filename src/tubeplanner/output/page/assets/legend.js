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

function addVerdicts() {  // above all else, on a narrow page too
  data.trajectories.forEach(({name, lasts, verdict}) => {
    if (!verdict) return;
    const line = element("div", verdict.passed ? "passed" : "failed");
    line.append(element("b", "", verdict.passed ? "certified" : "not certified"), `, ${lasts}`,
                element("div", "quiet", breakable(`${name}: ${verdict.text}`)));
    byId("verdict").append(line);
  });
}

function addRow(cells, isMore) {
  const row = element("tr", isMore ? "more" : "");
  row.append(...cells.map((cell) => {
    const made = element("td");
    made.append(cell);
    return made;
  }));
  byId("trajectories").append(row);
  row.lastChild.colSpan = data.trajectories.length > 1 ? 5 - cells.length : 3 - cells.length;
}

function addTrajectories() {
  const [{name, lasts, top, acceleration, gravities, verdict}, second] = data.trajectories;
  if (!second) {
    if (!verdict) addRow([breakable(name), lasts]);
    addRow(["tool speed", `peak ${top}`]);
    addRow(["tool acceleration", `peak ${acceleration} (${gravities})`]);
  } else {
    byId("trajectories").className = "many";
    addRow(["motion", "duration", "peak tool speed", "peak tool acceleration"]);
    data.trajectories.forEach((each) => {
      const named = element("span");
      named.append(swatch(each.color), breakable(each.name));
      addRow([named, each.lasts, each.top, each.acceleration]);
    });
  }
  data.facts.forEach(([what, value, isMore]) => {
    if (what.length < 20) addRow([what, breakable(value)], isMore);
    else addRow([breakable(`${what}: ${value}`)], isMore);
  });
  const more = button("More", "payload, limits, version", () => {
    more.textContent = byId("trajectories").classList.toggle("all") ? "Less" : "More";
  });
  byId("trajectories").after(more);
  more.id = "more";
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
  addVerdicts();
  if (data.duration > 0) addTrajectories();
  data.layers.forEach(addLayer);
  data.notes.forEach((note) => byId("notes").append(element("div", "note", note)));
  byId("fold").addEventListener("click", () => {
    setPanel(!byId("panel").classList.contains("open"));
    lookAtAll(lookedFrom);
  });
}

// What the colours mean.

function swatch(color) {
  const made = element("span", "swatch");
  made.style.background = color;
  return made;
}

function addLayer(layer) {
  const row = element("label", "layer"), box = element("input"), body = element("span", "body");
  box.type = "checkbox";
  box.checked = layer.visible;
  box.addEventListener("change", () => { show(layer.name, box.checked); });
  const entries = layer.entries.length === 1 && !layer.entries[0].text ? layer.entries : [];
  if (layer.dashed) {
    const line = element("span", "dashed");
    line.style.borderColor = layer.dashed;
    body.append(line);
  }
  entries.forEach((entry) => body.append(swatch(entry.color)));
  body.append(layer.label);
  if (!entries.length) layer.entries.forEach((entry) => {
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
  row.append(box, body);
  byId("layers").append(row);
}

function show(layer, visible) {
  viewer.scene_tree.find(["meshcat", layer]).object.visible = visible;
  viewer.set_dirty();
}

function fillPanel() {
  document.title = data.title;
  byId("name").textContent = data.title.replace(/[/_]/g, "$&\u200b");  // may break there
  byId("about").textContent = data.about;
  byId("hint").textContent = data.hint;
  const table = byId("trajectories");
  if (data.duration > 0) {
    const head = element("tr");
    ["trajectory", "duration", "top speed"].forEach((text) => head.append(element("th", "", text)));
    table.append(head);
    data.trajectories.forEach((trajectory) => {
      const row = element("tr");
      row.append(element("td", "", trajectory.name), element("td", "duration", trajectory.lasts),
                 element("td", "", trajectory.top));
      table.append(row);
    });
  }
  data.layers.forEach(addLayer);
  data.notes.forEach((note) => byId("notes").append(element("div", "note", note)));
}

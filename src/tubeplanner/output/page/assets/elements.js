// What all parts of the page share: its data, its state, its elements.
const data = JSON.parse(document.getElementById("data").textContent);
const byId = (id) => document.getElementById(id);
const isWide = () => window.innerWidth > 640;
let viewer, time = 0;

function element(tag, className, text) {
  const made = document.createElement(tag);
  if (className) made.className = className;
  if (text !== undefined) made.textContent = text;
  return made;
}

function button(text, title, pressed) {
  const made = element("button", "", text);
  made.title = title;
  made.addEventListener("click", pressed);
  return made;
}

function objectAt(...path) {  // of the scene, by layer, number and so on
  return viewer.scene_tree.find(["meshcat", ...path]).object;
}

function nearest(values, t, duration) {  // of values at equal steps of time
  return values[Math.round(Math.min(Math.max(t / duration, 0), 1) * (values.length - 1))];
}

function at(values, t, duration) {  // between them; missing ones are null
  const where = Math.min(Math.max(t / duration, 0), 1) * (values.length - 1);
  const low = values[Math.floor(where)], high = values[Math.ceil(where)];
  if (low === null || high === null) return nearest(values, t, duration);
  return low + (where - Math.floor(where)) * (high - low);
}

const inSeconds = (t) => `${t.toFixed(3)} s`;

// What is under the pointer, by name: links, solids and parts of the tube.
const KINDS = {arm: "link", carried: "carried", obstacles: "obstacle", tube: "tube"};
const paths = new Map();  // from an object of the scene to its path
let pointed = null;

function rememberPaths(node, path) {
  Object.entries(node.children).forEach(([name, child]) => {
    paths.set(child.object, [...path, name]);
    rememberPaths(child, [...path, name]);
  });
}

function pathOf(object) {
  for (let each = object; each; each = each.parent) if (paths.has(each)) return paths.get(each);
  return [];
}

function isSeen(object) {
  for (let each = object; each; each = each.parent) if (!each.visible) return false;
  return true;
}

function nameAt(x, y) {  // what is nearest there; a tube only where nothing is in it
  const {Raycaster, Vector2} = MeshCat.THREE, ray = new Raycaster();
  const place = new Vector2(2 * x / window.innerWidth - 1, 1 - 2 * y / window.innerHeight);
  ray.setFromCamera(place, viewer.camera);
  const layers = data.layers.map(({name}) => name).filter((name) => name in KINDS);
  const hits = ray.intersectObjects(layers.map((name) => objectAt(name)), true)
    .filter(({object}) => isSeen(object)).map(({object}) => pathOf(object));
  const [, layer, , , ...rest] = hits.find((path) => path[1] !== "tube") || hits[0] || [];
  if (!layer) return "";
  const words = rest.filter((each) => each !== "<object>");
  if (layer === "tube") return words[0].replace("_", " ");
  if (layer === "arm") words.pop();  // the number of the part of the link
  return `${KINDS[layer]} ${words.join("/")}`;
}

function showName() {  // once a picture
  if (!pointed) return;
  const {x, y, buttons} = pointed, hint = byId("pointed");
  pointed = null;
  const name = buttons ? "" : nameAt(x, y);
  hint.hidden = !name;
  hint.textContent = name;
  hint.style.left = `${Math.min(x + 14, window.innerWidth - hint.offsetWidth - 4)}px`;
  hint.style.top = `${y + 16}px`;
}

function addHover() {
  rememberPaths(viewer.scene_tree, []);
  const pane = byId("pane");
  pane.addEventListener("pointermove", ({clientX, clientY, buttons}) => {
    pointed = {x: clientX, y: clientY, buttons};
  });
  pane.addEventListener("pointerleave", () => { byId("pointed").hidden = true; });
}

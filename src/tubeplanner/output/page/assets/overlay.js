// Several motions: side by side, or all in one place and told apart by their colours.
const TINT = 0.75;  // of a motion's own colour on its arm
const ONCE = ["tube", "reference", "obstacles"];  // the same for all: drawn once in one place
let isOverlaid = false;

function isTinted(object) {
  return object.isMesh && object.material.color;
}

function tint(object, color) {  // back to its own colour if there is no other
  const kept = object.userData, {material} = object;
  if (!kept.own) kept.own = {color: material.color.clone(), vertices: material.vertexColors};
  material.vertexColors = color ? false : kept.own.vertices;
  material.color.copy(kept.own.color);
  if (color) material.color.lerp(new MeshCat.THREE.Color(color), TINT);
  material.needsUpdate = true;
}

function setOverlaid(on) {
  isOverlaid = on;
  byId("overlay").classList.toggle("on", on);
  byId("overlay").textContent = on ? "Side by side" : "Overlay";
  byId("labels").classList.toggle("overlaid", on);
  data.trajectories.forEach(({color}, i) => {
    data.layers.forEach(({name}) => {
      const stand = objectAt(name, `${i}`);
      stand.position.set(...data.offset.map((step) => on ? 0 : i * step));
      stand.visible = !(on && i > 0 && ONCE.includes(name));
    });
    ["arm", "tool"].forEach((name) => objectAt(name, `${i}`).traverse((object) => {
      if (isTinted(object)) tint(object, on ? color : null);
    }));
  });
  see(lookedFrom);
}

function addOverlay() {
  if (data.trajectories.length < 2) return;
  const title = "all motions in one place or beside each other";
  const made = button("Overlay", title, () => setOverlaid(!isOverlaid));
  made.id = "overlay";
  byId("tools").append(made);
}

// Names beside the arms.

const labels = [];

function placeAt(label, seen, isShown) {  // where a point is that the camera projected
  label.style.left = `${(seen.x + 1) / 2 * window.innerWidth}px`;
  label.style.top = `${(1 - seen.y) / 2 * window.innerHeight}px`;
  label.style.display = isShown && seen.z < 1 ? "" : "none";
}

function addLabels() {
  (data.labels || []).forEach(({text, point}) => {
    const label = element("div", "label", text);
    byId("labels").append(label);
    labels.push([label, point]);
  });
}

function placeLabels() {
  const {Vector3} = MeshCat.THREE;
  labels.forEach(([label, point]) =>
    placeAt(label, new Vector3(...upright(point)).project(viewer.camera), !isOverlaid));
}

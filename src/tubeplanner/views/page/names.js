// Names beside the arms.

const labels = [];
function placeLabels() {
  const Vector = viewer.camera.position.constructor;
  labels.forEach(([label, point]) => {
    const at = new Vector(...upright(point)).project(viewer.camera);
    label.style.left = `${(at.x + 1) / 2 * window.innerWidth}px`;
    label.style.top = `${(1 - at.y) / 2 * window.innerHeight}px`;
    label.style.display = at.z < 1 ? "" : "none";
  });
}

// The two points of links and solids that are nearest to each other, over time.
const UP = [0, 1, 0];  // along which a cylinder lies
const GAP_ORDER = 20;
const gaps = [];

function gapLine(color) {  // seen through all else
  const {CylinderGeometry, Mesh, MeshBasicMaterial} = MeshCat.THREE, radius = data.thickness;
  const material = new MeshBasicMaterial({color, depthTest: false, transparent: true});
  const line = new Mesh(new CylinderGeometry(radius, radius, 1, 10), material);
  line.renderOrder = GAP_ORDER;
  return line;
}

function addClosest() {
  const layer = data.layers.find(({name}) => name === "closest"), count = data.trajectories.length;
  if (!layer) return;
  data.trajectories.forEach(({clearance, color, duration}, i) => {
    if (!clearance) return;
    const stand = objectAt("closest", `${i}`), label = element("div", "label gap");
    const line = gapLine(count > 1 ? color : layer.entries[0].color);
    stand.position.set(...data.offset.map((step) => i * step));
    stand.add(line);
    label.style.color = count > 1 ? color : layer.entries[0].color;
    byId("labels").append(label);
    gaps.push({closest: clearance[0], line, label, stand, duration});
  });
}

function showClosest() {
  const {Vector3} = MeshCat.THREE;
  gaps.forEach((gap) => {
    const t = Math.min(time, gap.duration);
    const points = nearest(gap.closest.points, t, gap.duration);
    const [a, b] = [points.slice(0, 3), points.slice(3)].map((each) => new Vector3(...each));
    const along = b.clone().sub(a), length = along.length();
    gap.line.position.copy(a).add(b).multiplyScalar(0.5);
    gap.line.scale.y = Math.max(length, 1e-6);
    if (length > 0) gap.line.quaternion.setFromUnitVectors(new Vector3(...UP), along.normalize());
    const distance = nearest(gap.closest.distance, t, gap.duration);  // none while at rest
    gap.line.visible = distance !== null;
    gap.label.textContent = `${distance} mm`;
  });
}

function placeGaps() {
  gaps.forEach(({line, label, stand}) => {
    const at = line.getWorldPosition(new MeshCat.THREE.Vector3()).project(viewer.camera);
    placeAt(label, at, stand.parent.visible && line.visible);
  });
}

// The arm at the start and at the end, translucent; it shares its shapes with the arm that moves.
const GHOST_OPACITY = 0.3, GHOST_ORDER = 11;  // drawn after all else

function ghost(i, color) {  // of the arm as it stands now
  const skin = new MeshCat.THREE.MeshLambertMaterial(
    {color, opacity: GHOST_OPACITY, transparent: true});
  const copy = objectAt("arm", `${i}`).clone();
  copy.position.set(0, 0, 0);
  copy.traverse((object) => {
    if (!object.isMesh) return;
    object.material = skin;
    object.renderOrder = GHOST_ORDER;
  });
  addDepth(copy);
  return copy;
}

function addGhosts() {
  const {entries} = data.layers.find(({name}) => name === "ghosts");
  data.trajectories.forEach(({duration}, i) => {
    const stand = objectAt("ghosts", `${i}`);
    stand.position.set(...data.offset.map((step) => i * step));
    [0, duration].forEach((t, end) => {
      viewer.animator.seek(t);
      stand.add(ghost(i, entries[end].color));
    });
  });
}

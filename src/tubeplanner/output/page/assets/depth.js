// Of translucent things only the front is wanted: first their depth is drawn, then what is there.

function addDepth(root) {
  const depth = new MeshCat.THREE.MeshLambertMaterial({colorWrite: false, transparent: true});
  const meshes = [];
  root.traverse((object) => { if (object.isMesh) meshes.push(object); });
  meshes.forEach((mesh) => {
    const copy = mesh.clone();
    copy.material = depth;
    copy.renderOrder = mesh.renderOrder - 1;
    mesh.parent.add(copy);
  });
}

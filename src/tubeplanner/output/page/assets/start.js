// Start.

async function inflated(text) {
  const packed = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

function build(commands) {
  const lengths = new DataView(commands.buffer);
  for (let i = 0; i < commands.length;) {
    const length = lengths.getUint32(i, true);
    viewer.handle_command_bytearray(commands.slice(i + 4, i + 4 + length));
    i += 4 + length;
  }
}

function addMotion() {
  const asked = /[#&]t=([0-9.]+)/.exec(location.hash);  // page.html#t=0.25 stands still there
  addControls();
  viewer.animator.play();  // makes its actions count; time is kept here
  viewer.animator.pause();
  addGhosts();
  addClosest();
  setTab(tab);
  setTime(asked ? Number(asked[1]) : 0);
  setPlaying(!asked);
}

function takePicture() {  // for the printed page: the scene alone and in the middle
  const {renderer, scene, camera} = viewer, {view} = camera;
  camera.clearViewOffset();
  renderer.render(scene, camera);
  byId("picture").src = renderer.domElement.toDataURL();
  view.enabled = true;
  camera.updateProjectionMatrix();
  viewer.set_dirty();
}

async function start() {
  fillPanel();
  addFindings();
  setPanel(isWide());
  const commands = await inflated(byId("scene").textContent);
  viewer = new MeshCat.Viewer(byId("pane"));
  viewer.gui.domElement.style.display = "none";
  build(commands);
  addDepth(objectAt("swept"));
  addLabels();
  addViews();
  addOverlay();
  addRecording();
  window.addEventListener("beforeprint", takePicture);
  if (data.duration > 0) addMotion();
  data.layers.forEach((layer) => show(layer.name, layer.visible));
  addHover();
  viewer.set_3d_pane_size();
  if (data.duration > 0) setCurves(isWide() && window.innerHeight > 600);
  else lookAtAll(data.direction);
  window.addEventListener("resize", () => {
    viewer.set_3d_pane_size();
    lookAtAll(lookedFrom);
    if (data.duration > 0) drawCurves();
  });
  requestAnimationFrame(() => { lookAtAll(lookedFrom); requestAnimationFrame(tick); });
}

start().catch((error) => {
  byId("trouble").textContent = "This browser cannot show the scene (WebGL and a version of 2023 " +
    `or later are needed): ${error}`;
});

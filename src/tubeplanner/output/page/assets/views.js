// From where the scene is seen: buttons, and an eye that goes along with the tool.
const DIRECTIONS = [
  // Straight from above there would be no right and left.
  ["Top", "from above, x to the right", [0, -0.001, 1]],
  ["Front", "along -x, at the base's front", [1, 0, 0]],
  ["Side", "along y, from the base's right", [0, -1, 0]],
];
const CLOSER = 0.45;  // of the distance from which all is seen
let followed = null;  // where the tool was when the eye was moved last; null: the eye stands still

function toolPoint() {  // of the first motion
  const bodies = viewer.scene_tree.find(["meshcat", "tool", "0"]).children;
  const body = Object.values(bodies).find((each) => each.children.point);
  const ball = body.children.point.object.children[0];
  ball.geometry.computeBoundingSphere();
  ball.updateWorldMatrix(true, false);
  return ball.geometry.boundingSphere.center.clone().applyMatrix4(ball.matrixWorld);
}

function setFollowing(on) {
  byId("follow").classList.toggle("on", on);
  if (!on) { followed = null; return; }
  followed = toolPoint();
  const {camera, controls} = viewer;
  const back = camera.position.clone().sub(controls.target).multiplyScalar(CLOSER);
  controls.target.copy(followed);
  camera.position.copy(followed).add(back);
  viewer.set_dirty();
}

function followTool() {
  if (!followed) return;
  const now = toolPoint(), moved = now.clone().sub(followed);
  viewer.controls.target.add(moved);
  viewer.camera.position.add(moved);
  followed = now;
}

function see(from) {
  setFollowing(false);
  lookAtAll(from);
}

function addViews() {
  DIRECTIONS.forEach(([text, title, from]) =>
    byId("views").append(button(text, title, () => see(from))));
  byId("views").append(button("Reset", "as at first", () => see(data.direction)));
  if (!(data.duration > 0)) return;
  const follow = button("Follow tool", "the eye goes along with the tool", () => {
    if (followed) see(lookedFrom);
    else setFollowing(true);
  });
  follow.id = "follow";
  byId("views").append(follow);
}

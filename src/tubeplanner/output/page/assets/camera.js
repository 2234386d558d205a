// Where to look from.
const FIELD_OF_VIEW = 36, MARGIN = 1.06;  // degrees, -
let lookedFrom = data.direction;

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const plus = (a, b, s) => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2],
                         a[0] * b[1] - a[1] * b[0]];
const upright = ([x, y, z]) => [x, z, -y];  // the viewer's own frame has y up
const unit = (a) => plus([0, 0, 0], a, 1 / Math.hypot(...a));

function covered() {  // what panel, tools and controls take of the window [px]
  const below = byId("controls").offsetHeight, open = byId("panel").classList.contains("open");
  byId("panel").style.maxHeight =
    `calc(100% - ${byId("panel").offsetTop + below + 24}px)`;
  return {
    left: open && isWide() ? byId("panel").offsetWidth + 18 : 0,
    above: byId("tools").offsetTop + byId("tools").offsetHeight + (data.labels ? 26 : 4),
    below: below + 16,
  };
}

function outlineShown() {  // of one motion, if all stand in one place
  const count = data.outline.length / (isOverlaid ? data.trajectories.length : 1);
  return data.outline.slice(0, count);
}

function lookAtAll(from) {
  lookedFrom = from;
  const width = window.innerWidth, height = window.innerHeight;
  const {left, above, below} = covered(), outline = outlineShown();
  const tall = Math.tan(FIELD_OF_VIEW / 2 * Math.PI / 180);
  const vertical = tall * Math.max(0.2, (height - above - below) / height);
  const horizontal = tall * Math.max(0.2, (width - left - 8) / height);
  const back = unit(from), right = unit(cross([0, 0, 1], back)), up = cross(back, right);
  let target = outline.reduce((sum, point) => plus(sum, point, 1 / outline.length), [0, 0, 0]);
  let distance = 1;
  for (let round = 0; round < 12; round++) {
    const seen = outline.map((point) => {
      const offset = plus(point, target, -1);
      return [dot(offset, right), dot(offset, up), dot(offset, back)];
    });
    distance = MARGIN * Math.max(...seen.map(([x, y, z]) =>
      Math.max(Math.abs(x) / horizontal, Math.abs(y) / vertical) + z));
    const shown = [0, 1].map((i) => seen.map((p) => p[i] / (distance - p[2])));
    const middle = shown.map((list) => (Math.min(...list) + Math.max(...list)) / 2 * distance);
    if (round < 11) target = plus(plus(target, right, middle[0]), up, middle[1]);
  }
  const camera = viewer.camera;
  viewer.controls.target.set(...upright(target));
  camera.position.set(...upright(plus(target, back, distance)));
  camera.fov = FIELD_OF_VIEW;
  camera.near = distance / 200;
  camera.far = distance * 50;
  camera.aspect = width / height;
  camera.setViewOffset(width, height, -left / 2, (below - above) / 2, width, height);
  viewer.controls.update();
  viewer.set_dirty();
}

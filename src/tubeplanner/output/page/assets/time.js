// Time.
const HOLD = 0.9, LAST = 0.3;  // seconds at the end; of a video
let rate = 1, playing = false, held = 0, before = null;

function setTime(t) {
  time = Math.min(Math.max(t, 0), data.duration);
  viewer.animator.seek(time);
  byId("slider").value = time;
  const readout = byId("readout"), step = showSteps();
  readout.replaceChildren(element("b", "", inSeconds(time)), ` of ${inSeconds(data.duration)}`);
  if (data.trajectories.length === 1) {
    const speed = at(data.trajectories[0].speed, time, data.duration);
    readout.append(", ", element("b", "", step), `, tool at ${speed.toFixed(2)} m/s`);
  }
  drawCurves();
  showClosest();
  followTool();
}

function setPlaying(on) {
  playing = on;
  held = 0;
  before = null;
  if (on && time >= data.duration) setTime(0);
  byId("play").textContent = on ? "Pause" : "Play";
}

function setRate(value) {
  rate = value;
  document.querySelectorAll("#rates button").forEach((each) =>
    each.classList.toggle("on", Number(each.dataset.rate) === rate));
}

function tick(now) {
  requestAnimationFrame(tick);
  if (playing) {
    const passed = before === null ? 0 : Math.min((now - before) / 1000, 0.1);
    before = now;
    if (time < data.duration) setTime(time + rate * passed);
    else if ((held += passed) > (recorder ? LAST : HOLD)) {
      if (recorder) stopRecording();
      else { held = 0; setTime(0); }
    }
    if (recorder) showRecording();
  }
  placeLabels();
  placeGaps();
  showName();
}

function addControls() {
  [1, 0.25, 0.1].forEach((value) => {
    const made = button(value === 1 ? "1\u00d7 real time" : `${value}\u00d7`, "how fast it runs",
                        () => setRate(value));
    made.dataset.rate = value;
    byId("rates").append(made, " ");
  });
  byId("slider").max = data.duration;
  byId("slider").addEventListener("input", (event) => {
    setPlaying(false);
    setTime(Number(event.target.value));
  });
  byId("play").addEventListener("click", () => setPlaying(!playing));
  document.addEventListener("keydown", (event) => {
    if (event.key !== " " || ["BUTTON", "SELECT"].includes(event.target.tagName)) return;
    event.preventDefault();
    setPlaying(!playing);
  });
  addTimelines();
  addCurves();
  byId("controls").hidden = false;
  setRate(1);
}

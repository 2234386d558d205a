// Time.
const HOLD = 0.9;  // seconds at the end
let rate = 1, playing = false, held = 0, before = null;

function at(values, t, duration) {
  const where = Math.min(Math.max(t / duration, 0), 1) * (values.length - 1);
  const i = Math.min(Math.floor(where), values.length - 2);
  return values[i] + (where - i) * (values[i + 1] - values[i]);
}

function setTime(t) {
  time = Math.min(Math.max(t, 0), data.duration);
  viewer.animator.seek(time);
  byId("slider").value = time;
  const readout = byId("readout");
  readout.replaceChildren(element("b", "", `${Math.round(1000 * time)} ms`),
                          ` of ${Math.round(1000 * data.duration)} ms`);
  const step = data.timelines.length ? showSteps() : "";
  if (data.trajectories.length === 1) {
    if (step) readout.append(", ", element("b", "", step));
    const speed = at(data.trajectories[0].speed, time, data.duration);
    readout.append(`, tool at ${speed.toFixed(2)} m/s`);
  }
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
  document.querySelectorAll("#rates button").forEach((button) =>
    button.classList.toggle("on", Number(button.dataset.rate) === rate));
}

function tick(now) {
  requestAnimationFrame(tick);
  if (playing) {
    const passed = before === null ? 0 : Math.min((now - before) / 1000, 0.1);
    before = now;
    if (time < data.duration) setTime(time + rate * passed);
    else if ((held += passed) > HOLD) { held = 0; setTime(0); }
  }
  placeLabels();
}

function addControls() {
  [1, 0.25, 0.1].forEach((value) => {
    const button = element("button", "", value === 1 ? "1\u00d7 real time" : `${value}\u00d7`);
    button.dataset.rate = value;
    button.addEventListener("click", () => setRate(value));
    byId("rates").append(button, " ");
  });
  byId("slider").max = data.duration;
  byId("slider").addEventListener("input", (event) => {
    setPlaying(false);
    setTime(Number(event.target.value));
  });
  byId("play").addEventListener("click", () => setPlaying(!playing));
  document.addEventListener("keydown", (event) => {
    if (event.key !== " " || event.target.tagName === "BUTTON") return;
    event.preventDefault();
    setPlaying(!playing);
  });
  if (data.timelines.length) addTimelines();
  byId("controls").hidden = false;
  setRate(1);
}

// What happens when.
const PRESENT_OPACITY = 0.36, OTHER_OPACITY = 0.1;  // of the tubes of moves
const BAND = 20, ROW = 5, TEXT = 18;  // heights [px]

const share = (t) => `${100 * t / data.duration}%`;

function placed(className, begin, end, text) {
  const made = element("div", className, text);
  made.style.left = share(begin);
  if (end !== null) made.style.width = share(end - begin);
  return made;
}

function titled(made, text, begin, end) {
  made.title = `${text}: ${inSeconds(begin)}${end === undefined ? "" : ` to ${inSeconds(end)}`}`;
  return made;
}

function addBands(line, bands) {
  bands.forEach(({name, begin, end, color}) => {
    const band = titled(placed("band", begin, end, name), name, begin, end);
    band.style.background = `${color}8c`;
    line.append(band);
  });
}

function addBinds(line, binds) {  // one row under the other; returns their height [px]
  binds.forEach(({name, color, spans}, row) => spans.forEach(({kind, begin, end}) => {
    const mark = titled(placed("bind", begin, end), `${kind} of ${name} at its limit`, begin, end);
    mark.style.background = color;
    mark.style.top = `${BAND + 2 + ROW * row}px`;
    line.append(mark);
  }));
  return ROW * binds.length;
}

function addRests(line, rests, below) {
  rests.forEach((rest) => {
    line.append(placed("stop", rest.begin, rest.end));
    rest.ticks.forEach(([t, text]) => line.append(titled(placed("mark", t, null), text, t)));
    const happens = placed("happens", rest.room.begin, rest.room.end, rest.text);
    happens.style.textAlign = rest.room.align;
    happens.style.top = `${below}px`;
    happens.title = rest.text;
    line.append(happens);
  });
}

function goesThere(made) {  // where it is pressed or dragged to
  const go = (event) => {
    const {left, width} = made.getBoundingClientRect();
    setPlaying(false);
    setTime((event.clientX - left) / width * data.duration);
  };
  made.addEventListener("pointerdown", go);
  made.addEventListener("pointermove", (event) => { if (event.buttons) go(event); });
}

function addTimelines() {
  const box = byId("timelines"), many = data.timelines.length > 1;
  data.timelines.forEach((timeline, i) => {
    const line = element("div", "line");
    addBands(line, timeline.bands);
    const below = BAND + 4 + addBinds(line, timeline.binds);
    addRests(line, timeline.rests, below);
    timeline.marks.forEach(({time, text}) =>
      line.append(titled(placed("mark", time, null), text, time)));
    line.style.height = `${below + (timeline.rests.length ? TEXT : 0)}px`;
    line.append(placed("now", 0, null));
    goesThere(line);
    const whose = element("div", "whose");
    if (many) whose.append(swatch(data.trajectories[i].color), data.trajectories[i].name);
    box.append(whose, line);
  });
  box.append(byId("slider"));
}

function lastBegun(list, t) {
  return Math.max(0, list.findLastIndex((each) => each.begin <= t));
}

function setTubes(i, present) {  // of the moves of a cycle: that of the present one is stronger
  data.timelines[i].bands.forEach(({tube}, k) => {
    if (!tube) return;
    objectAt("tube", `${i}`, "body_0", tube, "<object>").material.opacity =
      k === present ? PRESENT_OPACITY : OTHER_OPACITY;
  });
}

function showSteps() {  // marks the present bands; returns what the first motion does
  const lines = document.querySelectorAll(".line");
  data.timelines.forEach(({bands}, i) => {
    const present = lastBegun(bands, time);
    lines[i].querySelectorAll(".band").forEach((band, k) => {
      band.classList.toggle("present", k === present && time <= bands[k].end);
    });
    lines[i].querySelector(".now").style.left = share(time);
    setTubes(i, present);
  });
  const {bands, rests} = data.timelines[0];
  const rest = rests.find(({begin, end}) => begin <= time && time < end);
  if (!rest) return bands[lastBegun(bands, time)].name;
  return rest.ticks.findLast(([t]) => t <= time)[1];
}

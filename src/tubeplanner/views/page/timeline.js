// What happens when.
const PRESENT_OPACITY = 0.36, OTHER_OPACITY = 0.1;  // of the tubes of moves

const share = (t) => `${100 * t / data.duration}%`;

function placed(className, begin, end, text) {
  const made = element("div", className, text);
  made.style.left = share(begin);
  if (end !== null) made.style.width = share(end - begin);
  return made;
}

function addMoves(line, moves) {
  moves.forEach((move) => {
    const band = placed("band", move.begin, move.end, move.name);
    band.style.background = `${move.color}8c`;
    const times = [move.begin, move.end].map((t) => `${Math.round(1000 * t)} ms`).join(" to ");
    band.title = `${move.name}: ${times}`;
    line.append(band);
  });
}

function addRests(line, rests) {
  rests.forEach((rest) => {
    line.append(placed("stop", rest.begin, rest.end));
    rest.ticks.forEach(([t, text]) => {
      const mark = placed("mark", t, null);
      mark.title = `${text}: ${Math.round(1000 * t)} ms`;
      line.append(mark);
    });
    const happens = placed("happens", rest.room.begin, rest.room.end, rest.text);
    happens.style.textAlign = rest.room.align;
    happens.title = rest.text;
    line.append(happens);
  });
}

function addTimelines() {
  const box = byId("timelines"), many = data.timelines.length > 1;
  data.timelines.forEach((timeline, i) => {
    const line = element("div", "line");
    addMoves(line, timeline.moves);
    addRests(line, timeline.rests);
    line.append(placed("now", 0, null));
    line.addEventListener("pointerdown", (event) => {
      const {left, width} = line.getBoundingClientRect();
      setPlaying(false);
      setTime((event.clientX - left) / width * data.duration);
    });
    box.append(element("div", "whose", many ? data.trajectories[i].name : ""), line);
  });
  box.append(element("span"), byId("slider"));
  box.hidden = false;
}

function lastBegun(list, t) {
  return Math.max(0, list.findLastIndex((each) => each.begin <= t));
}

function setTubes(i, present) {
  data.timelines[i].moves.forEach((_, k) => {
    const path = ["meshcat", "tube", `${i}`, "body_0", `move_${k}`, "<object>"];
    viewer.scene_tree.find(path).object.material.opacity =
      k === present ? PRESENT_OPACITY : OTHER_OPACITY;
  });
}

function showSteps() {  // marks the present moves; returns what the first motion does
  const lines = document.querySelectorAll(".line");
  data.timelines.forEach(({moves}, i) => {
    const present = lastBegun(moves, time);
    lines[i].querySelectorAll(".band").forEach((band, k) => {
      band.classList.toggle("present", k === present && time <= moves[k].end);
    });
    lines[i].querySelector(".now").style.left = share(time);
    setTubes(i, present);
  });
  const {moves, rests} = data.timelines[0];
  const rest = rests.find(({begin, end}) => begin <= time && time < end);
  if (!rest) return moves[lastBegun(moves, time)].name;
  return rest.ticks.findLast(([t]) => t <= time)[1];
}

// Curves over the time line: speed of the tool, use of the limits, clearance.
const HEIGHT = 112, FAINT = "#c9cfd8", PALE = "#6b7482", DARK = "#1d2330", NOW = "#c1121f";
const LATER = "#7A6FAF";  // of pairs of links, beside those of links and obstacles
const AT_LIMIT = 98, MOST = 200;  // [%]: thick from there on; what is far beyond is cut off
let tab = "limits", chosen = 0;

const ends = (t) => data.trajectories[t].duration;

function speedPlot() {
  const lines = data.trajectories.map(({name, speed, color}, i) =>
    ({name: data.trajectories.length > 1 ? name : "tool", values: speed, color,
      wide: i === chosen, lasts: ends(i), unit: "m/s", digits: 2}));
  const limit = data.trajectories[chosen].speedLimit;
  if (limit) lines.push({name: "limit", values: limit, color: PALE, dashed: true,
                         lasts: ends(chosen), unit: "m/s", digits: 2});
  const least = data.trajectories[chosen].speedLeast;
  if (least) lines.push({name: "at least", values: least, color: PALE, dashed: true,
                         lasts: ends(chosen), unit: "m/s", digits: 2});
  return {lines, unit: "m/s", digits: 2};
}

function limitsPlot() {
  const {lines, kinds} = data.trajectories[chosen].limits;
  const shown = lines.map((line) => ({
    ...line, values: line.share, lasts: ends(chosen), unit: "%", digits: 0,
    why: (t) => `of ${kinds[nearest(line.kind, t, ends(chosen))]}`,
  }));
  return {lines: shown, unit: "%", digits: 0, bound: 100, least: 115, most: MOST, binding: true};
}

function clearancePlot() {
  const lines = data.trajectories.flatMap(({name, clearance, color}, i) =>
    (i === chosen ? clearance || [] : (clearance || []).slice(0, 1)).map((closest, k) => ({
      name: i === chosen ? closest.name : name, values: closest.distance, unit: "mm", digits: 1,
      color: k ? LATER : color, wide: i === chosen && !k, lasts: ends(i),
      why: (t) => closest.pairs[nearest(closest.pair, t, ends(i))].join(" to "),
    })));
  (data.trajectories[chosen].clearance || []).slice(0, 1).forEach(({required}) => lines.push({
    name: "required", values: required, color: PALE, dashed: true, lasts: ends(chosen),
    unit: "mm", digits: 1}));
  return {lines, unit: "mm", digits: 0};
}

function holdingPlot() {
  const lines = (data.trajectories[chosen].holding || []).flatMap((contact) => {
    const {name, color, share, atRest, happens, words} = contact;
    const common = {color, lasts: ends(chosen), unit: "%", digits: 0};
    return [
      {...common, name, values: share, wide: true,
       why: (t) => `of what it carries (${words[nearest(happens, t, ends(chosen))]})`},
      {...common, name: `${name} at rest`, values: atRest, dashed: true},
    ];
  });
  return {lines, unit: "%", digits: 0, bound: 100, least: 115, most: MOST, binding: true};
}

const PLOTS = {
  speed: speedPlot, limits: limitsPlot, holding: holdingPlot, clearance: clearancePlot};
const TAB_WORDS = {
  speed: "Tool speed", limits: "Limits", holding: "Holding", clearance: "Clearance"};

function roundSteps(top) {  // of an axis: two to five of them
  const power = 10 ** Math.floor(Math.log10(top));
  return [0.2, 0.5, 1, 2, 5].map((each) => each * power).find((each) => top / each < 5);
}

function drawAxis(pen, {unit, digits, bound}, top, width, y) {
  const step = roundSteps(top);
  pen.font = "11px system-ui, sans-serif";
  pen.lineWidth = 1;
  for (let value = 0; value <= top; value += step) {
    pen.strokeStyle = FAINT;
    pen.beginPath();
    pen.moveTo(0, y(value));
    pen.lineTo(width, y(value));
    pen.stroke();
  }
  if (bound !== undefined) {
    pen.strokeStyle = DARK;
    pen.setLineDash([5, 3]);
    pen.beginPath();
    pen.moveTo(0, y(bound));
    pen.lineTo(width, y(bound));
    pen.stroke();
    pen.setLineDash([]);
  }
  return () => {  // numbers over the lines
    for (let value = step; value <= top; value += step) {
      const text = `${Number(value.toFixed(digits + 1))}${value + step > top ? ` ${unit}` : ""}`;
      const place = [3, Math.max(y(value) - 3, 10)];
      pen.strokeStyle = "rgba(255, 255, 255, .9)";
      pen.lineWidth = 3;
      pen.strokeText(text, ...place);
      pen.fillStyle = PALE;
      pen.fillText(text, ...place);
    }
  };
}

function drawLine(pen, line, x, y, shown) {  // shown: which of its values; those that are missing
  const {values, lasts, color, dashed} = line, count = values.length;  // are null: gaps
  pen.strokeStyle = color;
  pen.setLineDash(dashed ? [4, 3] : []);
  pen.beginPath();
  let drawing = false;
  values.forEach((value, i) => {
    if (value === null || !shown(i)) { drawing = false; return; }
    const place = [x(lasts * i / Math.max(count - 1, 1)), y(value)];
    if (drawing) pen.lineTo(...place);
    else pen.moveTo(...place);
    drawing = true;
  });
  pen.stroke();
  pen.setLineDash([]);
}

function drawBands(pen, x) {  // segments or moves, as the time line has them
  data.timelines[chosen].bands.forEach(({begin, end, color}) => {
    pen.fillStyle = `${color}1f`;
    pen.fillRect(x(begin), 0, x(end) - x(begin), HEIGHT);
  });
}

function drawCurves() {
  const canvas = byId("plot"), width = canvas.clientWidth, sharp = window.devicePixelRatio || 1;
  if (!width) return;
  canvas.width = Math.round(width * sharp);
  canvas.height = Math.round(HEIGHT * sharp);
  const pen = canvas.getContext("2d"), plot = PLOTS[tab]();
  pen.scale(sharp, sharp);
  const highest = Math.max(...plot.lines.map(({values}) => Math.max(...values)), 0);
  const top = Math.min(Math.max(1.12 * highest, plot.least || 0), plot.most || Infinity) || 1;
  const x = (t) => t / data.duration * width;
  const y = (value) => (HEIGHT - 2) * (1 - Math.min(value / top, 1)) + 1;
  drawBands(pen, x);
  const number = drawAxis(pen, plot, top, width, y);
  plot.lines.forEach((line) => {
    pen.lineWidth = line.wide ? 2 : 1.2;
    drawLine(pen, line, x, y, () => true);
    if (!plot.binding) return;
    pen.lineWidth = 4;
    drawLine(pen, line, x, y, (i) => line.values[i] >= AT_LIMIT);
  });
  number();
  drawCursor(pen, plot, x, y);
}

function drawCursor(pen, plot, x, y) {
  pen.fillStyle = NOW;
  pen.fillRect(x(time) - 1, 0, 2, HEIGHT);
  const readout = byId("values");
  readout.replaceChildren();
  plot.lines.forEach((line) => {
    const t = Math.min(time, line.lasts), value = at(line.values, t, line.lasts);
    const entry = element("span", "value");
    if (value !== null) {
      pen.fillStyle = line.color;
      pen.beginPath();
      pen.arc(x(t), y(value), 3.5, 0, 2 * Math.PI);
      pen.fill();
    }
    const why = value !== null && line.why ? ` ${line.why(t)}` : "";
    const shown = value === null ? "\u2013" : `${value.toFixed(line.digits)} ${line.unit}`;
    if (plot.binding && value >= AT_LIMIT) entry.classList.add("binds");
    entry.append(swatch(line.color), `${line.name} `, element("b", "", shown), why);
    readout.append(entry);
  });
}

function setTab(name) {
  tab = name;
  document.querySelectorAll("#tabs button[data-tab]").forEach((each) =>
    each.classList.toggle("on", each.dataset.tab === tab));
  drawCurves();
}

function setCurves(open) {
  document.body.classList.toggle("curves", open);
  byId("curves").textContent = open ? "Hide curves" : "Curves";
  byId("curves").setAttribute("aria-expanded", open);
  lookAtAll(lookedFrom);
  drawCurves();
}

function addChoice() {  // whose limits, where there are several motions
  const choice = element("select");
  choice.setAttribute("aria-label", "motion whose limits are drawn");
  data.trajectories.forEach(({name}, i) => {
    const option = element("option", "", name);
    option.value = i;
    choice.append(option);
  });
  choice.addEventListener("change", () => { chosen = Number(choice.value); drawCurves(); });
  byId("tabs").append(choice);
}

function addCurves() {
  Object.keys(PLOTS).forEach((name) => {
    if (!data.trajectories.some((each) => name === "speed" || each[name])) return;
    const made = button(TAB_WORDS[name], `${TAB_WORDS[name]} over time`, () => setTab(name));
    made.dataset.tab = name;
    byId("tabs").append(made);
  });
  if (data.trajectories.length > 1) addChoice();
  byId("plot").style.height = `${HEIGHT}px`;
  goesThere(byId("plot"));
  const fold = button("", "curves over the time line", () =>
    setCurves(!document.body.classList.contains("curves")));
  fold.id = "curves";
  byId("buttons").append(fold);
}

// Why there is no answer and what helps, or how much room there is: one line each, opened by a click.
let opened = null;  // the button of the line whose details are shown

function setOpened(pressed) {
  const details = (made) => made.nextElementSibling;
  if (opened) {
    opened.classList.remove("on");
    opened.setAttribute("aria-expanded", false);
    details(opened).hidden = true;
  }
  opened = opened === pressed ? null : pressed;
  if (!opened) return;
  opened.classList.add("on");
  opened.setAttribute("aria-expanded", true);
  details(opened).hidden = false;
}

function addFinding({text, details, setting}) {
  const made = button(breakable(text), "details", () => setOpened(made));
  const told = element("div", "told");
  made.className = "finding";
  made.setAttribute("aria-expanded", false);
  details.forEach((line) => told.append(element("div", "", breakable(line))));
  if (setting) told.append(element("code", "", setting));
  told.hidden = true;
  byId("findings").append(made, told);
}

function addFindings() {
  const found = data.findings, place = byId("findings");
  if (!found) return;
  place.hidden = false;
  place.append(element("div", "reason", breakable(found.reason)));
  place.append(element("h2", "", found.title));
  found.lines.forEach(addFinding);
  found.more.forEach((line) => place.append(element("div", "quiet", breakable(line))));
  const first = place.querySelector(".finding");
  if (first) setOpened(first);
}

const motion = @MOTION@;
const animator = viewer.animator;

if (window.innerWidth > 700) viewer.gui.open();
viewer.gui.__folders["Scene"].close();
animator.mixer.timeScale = motion.speed;
for (const controller of animator.folder.__folders["default"].__controllers) {
  if (controller.property === "timeScale") controller.name("speed");
  controller.updateDisplay();
}

function element(kind, text, parent) {
  const made = document.createElement(kind);
  made.textContent = text;
  parent.append(made);
  return made;
}

const heading = document.getElementById("heading");
const table = element("table", "", heading);
const cells = motion.names.map((name, i) => {
  const row = element("tr", "", table);
  const leg = element("td", "", row);
  const mark = element("span", "", leg);
  mark.className = "mark";
  mark.style.background = motion.colours[i];
  leg.append(motion.words[i]);
  const cell = element("td", "", row);
  cell.id = `force_${name}`;
  return cell;
});

/* ---- closures, and what of the picture is seen ---- */

const box = document.getElementById("parts");
if (!motion.layers.length) box.remove();
for (const [name, words, seen, nodes] of motion.layers) {
  const label = element("label", "", box);
  const check = element("input", "", label);
  check.type = "checkbox";
  check.id = `layer_${name}`;
  check.checked = seen;
  label.append(words);
  check.addEventListener("change", () => {
    for (const node of nodes) viewer.set_property(["meshcat", ...node.split("/")], "visible", check.checked);
    viewer.set_dirty();
  });
}
const list = motion.closures.length ? element("table", "", box) : null;
if (list) list.id = "closures";
const readings = motion.closures.map((closure) => {
  const row = element("tr", "", list);
  element("td", closure.number || "\u2013", row);
  const name = element("td", closure.kind, row);
  name.title = closure.name;
  return element("td", "", row);
});

if (motion.closures.some((closure) => closure.texts.some((text) => text.endsWith("in part")))) {
  element("small", "in part: what is determined of it, drawn pale", box);
}

const clock = element("span", "", heading);
clock.id = "time";
element("small", ` \u2003 lines of the floor every ${motion.mesh} m`, heading);
element("p", motion.legend, heading).id = "legend";
element("h1", motion.title, heading);

/* Between frames the forces are interpolated, as the arrows are. */
function forcesAt(time) {
  const place = Math.min(Math.max(time * motion.rate, 0), motion.forces.length - 1);
  const before = Math.floor(place), after = Math.min(before + 1, motion.forces.length - 1);
  return motion.forces[before].map((force, i) => {
    const next = motion.forces[after][i];
    return force === null || next === null ? force : force + (place - before) * (next - force);
  });
}

let shown = null;
function show() {
  if (animator.time === shown) return;
  shown = animator.time;
  clock.textContent = `t = ${(motion.start + shown).toFixed(3)} s`;
  forcesAt(shown).forEach((force, i) => {
    cells[i].textContent = force === null ? "not determined" : `${force.toFixed(motion.digits)} ${motion.units[i]}`;
  });
  const frame = Math.min(Math.max(Math.round(shown * motion.rate), 0), motion.forces.length - 1);
  readings.forEach((cell, i) => { cell.textContent = motion.closures[i].texts[frame]; });
}

/* Show an instant and stop there: for pictures and films. */
function freeze(time) {
  animator.pause();
  animator.seek(time);
  animator.display_progress(time);
  show();
  viewer.render();
}

function follow() {
  show();
  requestAnimationFrame(follow);
}
follow();

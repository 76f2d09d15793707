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

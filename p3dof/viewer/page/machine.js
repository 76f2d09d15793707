"use strict";
// The panel of the 3-DOF machine: it says what the page is told, and sends what the user does.

const AXES = ["y", "z", "theta"];
const LEGS = ["a", "b", "c"];

function prepare() {
  prepareMotion();
  $("case").hidden = !setup.motion;
  setup.colours.forEach((c, i) => document.documentElement.style.setProperty(`--${LEGS[i]}`, `rgb(${c})`));
  AXES.forEach((axis, i) => { [$(axis).min, $(axis).max] = setup.ranges[i]; });
}

function show() {
  const [y, z, theta] = state.pose;
  AXES.forEach((axis, i) => { if (!held.has(axis)) $(axis).value = state.pose[i]; });
  text("y-value", `${fixed(y, 4)} m`);
  text("z-value", `${fixed(z, 4)} m`);
  text("theta-value", `${fixed(theta, 4)} rad`);
  $("theta-value").title = `${fixed(theta * 180 / Math.PI, 2)}°`;
  showMotion();
  LEGS.forEach((leg, i) => {
    const force = state.forces[i], slider = state.sliders[i];
    text(`force-${leg}`, force === null ? "not determined" : `${fixed(force, 2)} N`);
    text(`slider-${leg}`, `${fixed(slider, 4)} m`);
    const [low, high] = setup.limits.travel;
    $(`force-${leg}`).classList.toggle("over", Math.abs(force) > setup.limits.force);
    $(`slider-${leg}`).classList.toggle("over", slider < low || slider > high);
    $(`force-${leg}`).parentElement.classList.toggle("bad", state.leg === leg);
  });
  for (const button of $("case").children) button.setAttribute("aria-pressed", button.value === state.case);
  note("message", state.message && `${state.message[0].toUpperCase()}${state.message.slice(1)}.\nThe last reachable pose is kept.`);
  note("limits", state.limits.length ? `Beyond a limit: ${state.limits.join("; ")}` : "");
  text("legend", state.legend);
  note("off-scale", state.off_scale.length ? `Arrows: ${state.off_scale.join("; ")}` : "");
  $("rest").hidden = state.source !== "pose";
  if (!before || before.case !== state.case) {
    drawChart(setup.motion ? setup.curves[state.case] : [], LEGS.map((leg) => `var(--${leg})`), "force [N] over time");
  }
  moveCursor();
}

function valueOf(axis) {
  return state.pose[AXES.indexOf(axis)];
}

for (const axis of AXES) {
  hold($(axis));
  $(axis).addEventListener("input", () => {
    const pose = state.pose.slice();
    pose[AXES.indexOf(axis)] = Number($(axis).value);
    send("pose", pose);
  });
}
$("home").addEventListener("click", () => send("pose", [0, 0, 0]));
for (const button of $("case").children) button.addEventListener("click", () => send("case", button.value));

connect();

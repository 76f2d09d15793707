"use strict";
// The panel of any robot: sliders for its actuated joints, forces, closures, and what of the picture is seen.

const sliders = [];   // of the actuated joints: the input, and where its value is written
const readings = [];  // where the forces of actuators and of closures are written

function prepare() {
  prepareMotion();
  text("title", setup.title);
  document.title = setup.title;
  $("joints").hidden = !setup.joints.length;
  $("forces").hidden = !setup.actuators.length;
  $("ties").hidden = !setup.closures.length;
  sliders.splice(0, Infinity, ...setup.joints.map(sliderOf));
  $("sliders").replaceChildren(...sliders.map((one) => one.row));
  readings.splice(0, Infinity, setup.actuators.map(actuatorRow), setup.closures.map(closureRow));
  $("actuators").replaceChildren(...readings[0].map((cell) => cell.parentElement));
  $("closures").replaceChildren(...readings[1].map((cell) => cell.parentElement));
  $("layers").replaceChildren(...setup.layers.map(layerBox));
  $("parts").hidden = !setup.layers.length;
  const units = [...new Set(setup.actuators.map((one) => one.unit))].join(", ");
  drawChart(setup.curves, setup.actuators.map((one) => `rgb(${one.colour})`), `force [${units}] over time`);
}

function sliderOf(joint, index) {
  const row = element("div", { className: "joint" });
  const id = `joint-${index}`;
  const label = element("label", { htmlFor: id, title: joint.name }, joint.name);
  const value = element("output", { id: `${id}-value` });
  const input = element("input", { type: "range", step: "any", id, min: joint.range[0], max: joint.range[1] });
  row.append(label, value, input);
  hold(input);
  input.addEventListener("input", () => {
    const values = state.joints.slice();
    values[index] = Number(input.value);
    send("joints", values);
  });
  return { row, input, value };
}

function actuatorRow(actuator) {
  const row = element("tr", {});
  const head = element("th", { title: actuator.name });
  const mark = element("i", {});
  mark.style.background = `rgb(${actuator.colour})`;
  head.append(mark, actuator.name);
  const cell = element("td", { id: `force-${actuator.name}` });
  row.append(head, cell);
  return cell;
}

function closureRow(closure) {
  const row = element("tr", {});
  const cell = element("td", {});
  row.append(element("td", { className: "number" }, closure.number || ""),
    element("th", { title: closure.name }, `${closure.kind} ${closure.name}`), cell);
  return cell;
}

function layerBox([name, words]) {
  const label = element("label", { className: "layer" });
  const box = element("input", { type: "checkbox", id: `layer-${name}` });
  box.addEventListener("change", () => {
    const all = setup.layers.map(([other]) => [other, $(`layer-${other}`).checked]);
    send("layers", Object.fromEntries(all));
  });
  label.append(box, words);
  return label;
}

function show() {
  showMotion();
  sliders.forEach(({ input, value }, i) => {
    if (!held.has(input.id)) input.value = state.joints[i];
    const written = `${fixed(state.joints[i], 4)} ${setup.joints[i].unit}`;
    if (value.textContent !== written) value.textContent = written;
    if (setup.joints[i].unit === "rad") value.title = `${fixed(state.joints[i] * 180 / Math.PI, 2)}°`;
  });
  readings[0].forEach((cell, i) => { cell.textContent = state.forces[i]; });
  readings[1].forEach((cell, i) => { cell.textContent = state.closures[i]; });
  $("in-part").hidden = !state.closures.some((words) => words.endsWith("in part"));
  $("smallest").hidden = !state.smallest;
  for (const [name] of setup.layers) $(`layer-${name}`).checked = state.layers[name];
  note("message", state.message && `${state.message[0].toUpperCase()}${state.message.slice(1)}.\nThe picture stays.`);
  note("limits", state.limits.length ? `Beyond a limit: ${state.limits.join("; ")}` : "");
  text("legend", state.legend);
  note("unknown", state.unknown && `${state.unknown[0].toUpperCase()}${state.unknown.slice(1)}.`);
  $("rest").hidden = state.source !== "pose";
  moveCursor();
}

function valueOf(id) {
  return state.joints[Number(id.slice("joint-".length))];
}

$("home").addEventListener("click", () => send("home", null));

connect();

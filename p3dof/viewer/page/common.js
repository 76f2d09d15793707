"use strict";
// What all live pages share: the connections, the motion that is played, a chart, and small things.
// The page's own script has `prepare` and `show`, for what it is told once and with every frame, and `valueOf`,
// for what a slider shows that is let go; it begins with `connect`.

const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4];
const CHART = { left: 34, right: 276, top: 8, bottom: 112 };

const $ = (id) => document.getElementById(id);
const at = (path) => `ws://${location.host}/${path}${location.search}`;  // the token goes with it

/* ---- scene ---- */

new ResizeObserver(() => viewer.set_3d_pane_size()).observe(pane);
viewer.connect(at("scene"));
viewer.connection.onclose = (event) => lost(event);

/* ---- what goes to the server ---- */

let socket = null;
let refused = "";        // why the viewer closed this page for good
let wanted = {};       // the latest of each kind since the last frame of the page
let sending = false;
const held = new Set();  // sliders that the user holds: they show what is wanted, not what is

function send(type, value) {
  delete wanted[type];
  wanted[type] = value;
  if (!sending) {
    sending = true;
    setTimeout(flush, 15);
  }
}

function flush() {
  sending = false;
  const messages = wanted;
  wanted = {};
  if (!socket || socket.readyState !== WebSocket.OPEN) return;
  for (const [type, value] of Object.entries(messages)) socket.send(JSON.stringify({ type, value }));
}

let again = false;

function connect() {
  socket = new WebSocket(at("control"));
  socket.onopen = () => again ? location.reload() : linked(true);
  socket.onmessage = (event) => told(JSON.parse(event.data));
  socket.onclose = (event) => lost(event);
}

/* One of the two connections is lost: without both the page would show what is no longer so. */
function lost(event) {
  if (event.code === 1008) refused = event.reason;
  linked(false);
  for (const one of [socket, viewer.connection]) { one.onclose = null; one.close(); }
  again = true;
  if (!refused) setTimeout(connect, 1000);
}

function linked(on) {
  $("link").className = on ? "" : "off";
  $("link").title = on ? "connected" : "not connected";
  if (!on) note("message", refused ? `The viewer has closed this page: ${refused}.`
    : "The viewer was closed, or cannot be reached. A new one has a new address.");
}

/* ---- what comes from the server ---- */

let setup = null;
let state = null;
let before = null;       // the state before it

function told(message) {
  if (message.type === "setup") { setup = message; prepare(); }
  else if (message.type === "state") { before = state; state = message; show(); }
  else if (message.type === "error") note("message", message.message);
}

/* ---- the motion ---- */

function prepareMotion() {
  $("panel").hidden = false;
  $("motion").hidden = !setup.motion;
  if (setup.motion) [$("time").min, $("time").max] = setup.motion;
  $("warnings").replaceChildren(...setup.warnings.map((text) => element("li", {}, text)));
  $("speed").replaceChildren(...SPEEDS.map((s) => element("option", { value: s }, `${s}×`)));
}

function showMotion() {
  if (!setup.motion) return;
  if (!held.has("time")) $("time").value = state.time;
  text("time-value", `${fixed(state.time, 3)} s`);
  $("play").classList.toggle("playing", state.playing);
  $("play").setAttribute("aria-label", state.playing ? "Pause" : "Play");
  text("source", state.source === "pose" ? "moved by hand" : state.playing ? "playing" : "paused");
  const speed = String(state.speed);
  if (![...$("speed").options].some((option) => option.value === speed)) {
    $("speed").append(element("option", { value: speed }, `${Number(state.speed.toFixed(3))}×`));
  }
  if (document.activeElement !== $("speed") || !held.has("speed")) $("speed").value = speed;
}

/* ---- chart ---- */

function drawChart(columns, colours, title) {
  const chart = $("chart");
  const none = !setup.motion || setup.time.length < 2 || !columns.length;
  chart.toggleAttribute("hidden", none);
  if (none) return;
  const values = columns.flat().filter((value) => value !== null);
  const [low, high, step] = nice(Math.min(0, ...values), Math.max(0, ...values));
  const [first, last] = setup.motion;
  const x = (t) => CHART.left + (t - first) / (last - first) * (CHART.right - CHART.left);
  const y = (f) => CHART.bottom - (f - low) / (high - low) * (CHART.bottom - CHART.top);
  const parts = [];
  for (let k = Math.round(low / step); k <= Math.round(high / step); k++) {
    const at = y(k * step);
    parts.push(shape("line", { class: k ? "grid" : "zero", x1: CHART.left, x2: CHART.right, y1: at, y2: at }));
    parts.push(shape("text", { x: CHART.left - 5, y: at + 3, "text-anchor": "end" }, minus(Number((k * step).toPrecision(6)))));
  }
  parts.push(shape("text", { x: CHART.left, y: 126 }, `${Number(first.toPrecision(4))} s`));
  parts.push(shape("text", { x: CHART.right, y: 126, "text-anchor": "end" }, `${Number(last.toPrecision(4))} s`));
  parts.push(shape("text", { x: (CHART.left + CHART.right) / 2, y: 126, "text-anchor": "middle" }, title));
  columns.forEach((column, i) => {
    let path = "", pen = "M";
    column.forEach((f, k) => {
      if (f === null) { pen = "M"; return; }
      path += `${pen}${x(setup.time[k]).toFixed(1)} ${y(f).toFixed(1)}`;
      pen = "L";
    });
    parts.push(shape("path", { class: "curve", d: path, stroke: colours[i] }));
  });
  parts.push(shape("line", { class: "now", id: "now", y1: CHART.top, y2: CHART.bottom }));
  chart.replaceChildren(...parts);
}

function moveCursor() {
  const now = $("now");
  if (!now) return;
  const [first, last] = setup.motion;
  const at = CHART.left + (state.time - first) / (last - first) * (CHART.right - CHART.left);
  now.setAttribute("x1", at);
  now.setAttribute("x2", at);
  now.toggleAttribute("hidden", state.source === "pose");
}

function nice(low, high) {
  const span = high - low || 1;
  const power = 10 ** Math.floor(Math.log10(span / 4));
  const step = [1, 2, 5, 10].map((m) => m * power).find((s) => span / s <= 5) || 10 * power;
  const bottom = Math.floor(low / step + 1e-9) * step;
  const top = Math.ceil(high / step - 1e-9) * step;
  return [bottom, top > bottom ? top : bottom + step, step];
}

/* ---- small things ---- */

function fixed(value, digits) {
  const rounded = value.toFixed(digits);
  return Number(rounded) === 0 ? rounded.replace("-", "") : minus(rounded);
}

function minus(number) {
  return String(number).replace("-", "\u2212");
}

function text(id, value) {
  if ($(id).textContent !== value) $(id).textContent = value;
}

function note(id, value) {
  $(id).hidden = !value;
  if (value) text(id, value);
}

function element(name, attributes, content) {
  return Object.assign(document.createElement(name), attributes, { textContent: content });
}

function shape(name, attributes, content) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (content !== undefined) made.textContent = content;
  return made;
}

/* ---- what the user does ---- */

function hold(slider) {
  const release = () => {
    if (held.delete(slider.id) && state) slider.value = slider.id === "time" ? state.time : valueOf(slider.id);
  };
  slider.addEventListener("pointerdown", () => held.add(slider.id));
  for (const end of ["pointerup", "pointercancel", "lostpointercapture", "blur"]) slider.addEventListener(end, () => setTimeout(release, 120));
}

hold($("time"));
$("time").addEventListener("input", () => send("time", Number($("time").value)));
$("play").addEventListener("click", () => send(state.playing ? "pause" : "play", null));
$("speed").addEventListener("change", () => send("speed", Number($("speed").value)));

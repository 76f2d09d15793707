// What keys do, and the list of them.
import { goHome, hold } from "./hold.js";
import { instant, runOf } from "./instant.js";
import { shownSpan, wholeSpan } from "./lines.js";
import { make } from "./make.js";
import { choose } from "./runs.js";
import { viewed } from "./state.js";
import { SPEEDS, seek, step, toggle } from "./time_bar.js";

/** @typedef {import("./types").State} State */

const THEMES = /** @type {const} */ (["auto", "light", "dark"]);
const CASES = /** @type {const} */ (["total", "static", "dynamic"]);
const VIEWS = /** @type {const} */ (["3d", "front", "side", "top"]);
/** How far a key moves the platform: y, z [m] and θ [rad]. */
const NUDGE = [0.005, 0.005, Math.PI / 180];

/** @type {[string[], string, (state: State, event: KeyboardEvent) => void][]} keys, what they do, and how */
const KEYS = [
    [[" "], "play, pause", toggle],
    [["ArrowLeft", "ArrowRight"], "one sample back, forward (with Shift: ten)", (state, event) =>
        step(state, (event.key === "ArrowLeft" ? -1 : 1) * (event.shiftKey ? 10 : 1))],
    [["PageUp", "PageDown"], "a twentieth of the run back, forward", (state, event) => {
        const [start, end] = wholeSpan(state);
        seek(state, state.time + ((event.key === "PageUp" ? -1 : 1) * (end - start)) / 20);
    }],
    [["Home", "End"], "to the start, to the end", (state, event) =>
        seek(state, wholeSpan(state)[event.key === "Home" ? 0 : 1])],
    [["-", "+"], "slower, faster", (state, event) => {
        const now = SPEEDS.findIndex((speed) => speed >= state.speed);
        const next = (now < 0 ? SPEEDS.length - 1 : now) + (event.key === "-" ? -1 : 1);
        state.set({ speed: SPEEDS[Math.min(SPEEDS.length - 1, Math.max(0, next))] });
    }],
    [["l"], "loop", (state) => state.set({ loop: !state.loop })],
    [["z", "x"], "zoom the charts around the instant, show all of the run", (state, event) =>
        event.key === "z" ? zoom(state) : state.set({ zoom: null })],
    [["1", "2", "3", "4"], "views: 3D, front, side, top", (state, event) =>
        state.set(viewed(state, VIEWS[Number(event.key) - 1]))],
    [["a", "d"], "move the platform in y (with Shift: finely)", (state, event) => nudge(state, event, 0, event.key === "a" ? -1 : 1)],
    [["s", "w"], "move the platform in z", (state, event) => nudge(state, event, 1, event.key === "s" ? -1 : 1)],
    [["q", "e"], "tilt the platform", (state, event) => nudge(state, event, 2, event.key === "q" ? -1 : 1)],
    [["h"], "hold the machine at home", goHome],
    [["c"], "total, static, dynamic forces", (state) => state.set({ case: after(CASES, state.case) })],
    [["r"], "the next run", (state) =>
        choose(state, (state.run + 1) % state.document.runs.length)],
    [["u"], "millimetres and degrees, or SI units", (state) => state.set({ units: state.units === "mm" ? "SI" : "mm" })],
    [["t"], "light, dark, as the system", (state) => state.set({ theme: after(THEMES, state.theme) })],
    [["?"], "these keys", (state) => state.set({ help: !state.help })],
    [["Escape"], "back to the run; show all of it", (state) => state.set({ help: false, hand: null, zoom: null, hover: null })],
];

/** @type {Record<string, string>} */
const NAMES = { " ": "Space", ArrowLeft: "←", ArrowRight: "→", PageUp: "Page up", PageDown: "Page down", Home: "Home", End: "End", Escape: "Esc" };

/**
 * Do what a key does.
 * @param {State} state
 * @param {KeyboardEvent} event
 * @returns {boolean} whether it does anything
 */
export function press(state, event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return false;
    const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    const found = KEYS.find(([keys]) => keys.includes(key === "=" ? "+" : key));
    if (!found) return false;
    found[2](state, new Proxy(event, { get: (of, name) => (name === "key" ? (key === "=" ? "+" : key) : Reflect.get(of, name)) }));
    return true;
}

/** Whether an element needs a key itself. @param {EventTarget | null} target @param {string} key */
export function taken(target, key) {
    if (!(target instanceof HTMLElement)) return false;
    if (target.closest("dialog[open]")) return key !== "?" && key !== "Escape";
    if (target.matches("input[type=range]")) return !target.classList.contains("track") && key.startsWith("Arrow");
    if (target.matches("input[type=checkbox], input[type=radio], button, summary, a")) return key === " " || key === "Enter";
    return target.matches("input, textarea, select, [contenteditable]") && key !== "Escape";
}

/** @param {HTMLElement} element @param {State} state */
export function mount(element, state) {
    const dialog = make("dialog", { className: "help", "aria-label": "Keys" },
        make("h2", {}, "Keys"), make("dl", {}, ...KEYS.flatMap(([keys, text]) => [
            make("dt", {}, ...keys.flatMap((key) => [make("kbd", {}, NAMES[key] ?? key.toUpperCase()), " "])), make("dd", {}, text)])),
        make("p", { className: "note" }, "In a chart: click to go there, drag to zoom, double click for all of the run."),
        make("button", { type: "button", onclick: () => state.set({ help: false }) }, "Close"));
    dialog.addEventListener("close", () => state.help && state.set({ help: false }));
    element.append(dialog);
    document.addEventListener("keydown", (event) => {
        if (event.defaultPrevented || taken(event.target, event.key)) return;
        if (press(state, event)) event.preventDefault();
    });
    document.addEventListener("click", ({ target, detail }) => { // after a click of the mouse, keys are for the page again
        if (detail > 0 && target instanceof Element) target.closest("button")?.blur();
    });
    state.subscribe(() => {
        if (state.help && !dialog.open) dialog.showModal();
        else if (!state.help && dialog.open) dialog.close();
    });
}

/** Show half of what the charts show, around the instant. @param {State} state */
export function zoom(state) {
    const [start, end] = shownSpan(state);
    const whole = wholeSpan(state);
    const quarter = (end - start) / 4;
    const { data } = runOf(state).time;
    if (quarter * 2 < (2 * (whole[1] - whole[0])) / Math.max(2, data.length)) return; // two samples are enough
    const middle = Math.min(Math.max(state.time, whole[0] + quarter), whole[1] - quarter);
    state.set({ zoom: [middle - quarter, middle + quarter] });
}

/** @param {State} state @param {KeyboardEvent} event @param {number} part of the pose @param {number} sign */
function nudge(state, event, part, sign) {
    const { pose } = instant(state);
    if (!pose) return;
    const moved = [...pose];
    moved[part] += sign * NUDGE[part] * (event.shiftKey ? 0.1 : 1);
    hold(state, moved);
}

/** @template T @param {readonly T[]} all @param {T} now @returns {T} */
const after = (all, now) => all[(all.indexOf(now) + 1) % all.length];

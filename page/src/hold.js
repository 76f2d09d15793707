// Moves a machine by hand, from wherever it is done: the picture, a field, a key.
import { instant } from "./instant.js";
import { margins, reasons, told } from "./workspace.js";

/** @typedef {import("./types").State} State */
/** @typedef {import("./types").Input} Input */

const HALVINGS = 40;
const TURN = 2 * Math.PI * (1 + 1e-12);
/** @param {number} angle */
const degrees = (angle) => String(Number(((angle * 180) / Math.PI).toPrecision(6)));

/**
 * Why a pose cannot be, and the leg that comes first on the way to it; null where it can.
 * @param {State} state @param {number[]} pose
 * @returns {import("./types").Refusal | null}
 */
export function refusal(state, pose) {
    const { engine } = state;
    if (!engine?.joints) return { text: "Without WebAssembly the platform cannot be moved in this page.", legs: [] };
    if (Math.abs(pose[2]) > TURN) {
        return { text: `The platform cannot go there: expected a tilt within ±360°, got ${degrees(pose[2])}°.`, legs: [] };
    }
    const can = (/** @type {number[]} */ one) => engine.joints(one).every(Number.isFinite);
    if (can(pose)) return null;
    const from = instant(state).pose;
    const first = engine.why?.(from && can(from) ? beyond(can, from, pose) : pose);
    const some = reasons(margins(engine, pose)).filter(({ leg }) => leg >= 0 && first?.legs.includes("abc"[leg]));
    if (some.length) return { text: `The platform cannot go there: ${some.map(told).join(", ")}.`, legs: first.legs };
    return first ?? engine.why?.(pose) ?? { text: "The platform cannot go there.", legs: [] };
}

/** The first pose that cannot be on the way from one that can to one that cannot. */
/** @param {(pose: number[]) => boolean} can @param {number[]} from @param {number[]} to */
function beyond(can, from, to) {
    const at = (/** @type {number} */ part) => from.map((x, i) => x + part * (to[i] - x));
    let [low, high] = [0, 1];
    for (let i = 0; i < HALVINGS; i++) {
        const middle = (low + high) / 2;
        if (can(at(middle))) low = middle;
        else high = middle;
    }
    return at(high);
}

/** Move the platform to a pose; where it cannot go, the last pose stays. @param {State} state @param {number[]} pose y, z [m], theta [rad] */
export function hold(state, pose) {
    if (state.engine?.move) return void state.engine.move({ pose }); // Python says whether it can
    const refused = refusal(state, pose);
    if (refused) state.set({ hand: state.hand ?? { pose: instant(state).pose ?? [0, 0, 0] }, refused, playing: false });
    else state.set({ hand: { pose }, playing: false });
}

/** Let go: the run is shown again. @param {State} state */
export function letGo(state) {
    if (state.hand || state.refused) state.set({ hand: null });
}

/** Hold the machine where it is at home. @param {State} state */
export function goHome(state) {
    const { inputs } = state.document;
    const own = inputs.filter(({ joint }) => joint !== undefined);
    if (!own.length) hold(state, ["y", "z", "theta"].map((key) => inputs.find((input) => input.key === key)?.value ?? 0));
    else if (state.engine?.move) state.engine.move({ inputs: Object.fromEntries(inputs.map(({ key, value }) => [key, value])) });
    else own.forEach((input) => setInput(state, input, input.value));
}

/** What an input of the machine is now [m, rad]; NaN where that is not known. @param {State} state @param {Input} input */
export function valueOf(state, input) {
    const { pose, q } = instant(state);
    if (input.joint === undefined) return pose?.[["y", "z", "theta"].indexOf(input.key)] ?? NaN;
    const joint = state.document.scene.joints[input.joint];
    if (!joint.q) return NaN;
    const [k] = joint.q;
    return joint.kind === "continuous" ? Math.atan2(q[k + 1], q[k]) : q[k];
}

/** Whether inputs of joints can be moved: by Python, or where no loop has to be closed. @param {State} state */
export const canMove = ({ engine, document: { closures } }) => Boolean(engine?.move) || closures.length === 0;

/** Set one input; the others stay as they are. @param {State} state @param {Input} input @param {number} value [m, rad] */
export function setInput(state, input, value) {
    const { inputs, scene } = state.document;
    const { pose, q } = instant(state);
    if (input.joint === undefined) {
        const place = ["y", "z", "theta"].indexOf(input.key);
        if (pose && place >= 0) hold(state, pose.map((part, i) => (i === place ? value : part)));
        return;
    }
    const goal = Math.min(Math.max(value, input.low), input.high);
    if (state.engine?.move) {
        const all = inputs.map((one) => [one.key, one === input ? goal : valueOf(state, one)]);
        state.engine.move({ inputs: Object.fromEntries(all) });
    } else if (state.document.closures.length) {
        state.set({ refused: { text: "Loops are closed by Python: open this robot with p3dof show to move it.", legs: [] } });
    } else {
        const joint = scene.joints[input.joint];
        const held = Array.from(q);
        const k = joint.q?.[0] ?? 0;
        if (joint.kind === "continuous") [held[k], held[k + 1]] = [Math.cos(goal), Math.sin(goal)];
        else held[k] = goal;
        state.set({ hand: { q: held }, playing: false });
    }
}

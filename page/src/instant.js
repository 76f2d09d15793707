// What is at one instant: computed once for each refresh, and shared, so that no frame mixes two.
import { closedWith, withLengths } from "./lengths.js";
import { Tree, directionOf, pointOf } from "./tree.js";

/** @typedef {import("./types").State} State */
/** @typedef {import("./types").Run} Run */
/** @typedef {import("./types").Scene} Scene */
/** @typedef {import("./types").Instant} Instant */
/** @typedef {import("./types").Table} Table */

/** @type {WeakMap<object, Tree>} */
const trees = new WeakMap();
/** Scenes with other lengths, by these. @type {WeakMap<object, Map<string, Scene>>} */
const others = new WeakMap();
const KEPT = 8;
/** @type {WeakMap<State, {version: number, instant: Instant}>} */
const known = new WeakMap();

/** The run that is shown: recomputed in the page, or the document's. @param {State} state @returns {Run} */
export const runOf = (state) => state.solved ?? state.document.runs[state.run];

/** What the state shows. @param {State} state @returns {Instant} */
export function instant(state) {
    const last = known.get(state);
    if (last && last.version === state.version) return last.instant;
    const found = compute(state);
    known.set(state, { version: state.version, instant: found });
    return found;
}

/** The tree of a scene. @param {Scene} scene */
export function treeOf(scene) {
    let tree = trees.get(scene);
    if (!tree) trees.set(scene, (tree = new Tree(scene.joints)));
    return tree;
}

/** The closures that are shown. @param {State} state */
export function closuresOf({ document: { closures, engine: given }, engine }) {
    if (!engine?.lengths || given.kind !== "p3dof") return closures;
    const [r, R, L] = given.parameters.data;
    return closures.map((closure) => closedWith(closure, { r, R, L }, engine.lengths));
}

/** The scene that is shown: the document's, or that with the lengths that the engine computes with. */
/** @param {State} state @returns {Scene} */
export function sceneOf({ document: { scene, engine: given }, engine }) {
    const to = engine?.lengths;
    return to && given.kind === "p3dof" ? lengthened(scene, given.parameters.data, to) : scene;
}

/** The scene of a run: with the lengths of its machine. @param {State["document"]} document @param {Run} run @returns {Scene} */
export function sceneOfRun({ scene, engine: given }, { machine }) {
    if (!machine || given.kind !== "p3dof") return scene;
    const [r, R, L] = given.parameters.data;
    return lengthened(scene, given.parameters.data, { r, R, L, ...machine });
}

/** @param {Scene} scene @param {ArrayLike<number>} from @param {{r: number, R: number, L: number}} to @returns {Scene} */
function lengthened(scene, from, to) {
    const [r, R, L] = [from[0], from[1], from[2]];
    if (to.r === r && to.R === R && to.L === L) return scene;
    const key = `${to.r} ${to.R} ${to.L}`, made = others.get(scene) ?? new Map();
    const other = made.get(key) ?? withLengths(scene, { r, R, L }, to);
    made.delete(key);
    made.set(key, other); // the latest last
    if (made.size > KEPT) made.delete(made.keys().next().value);
    others.set(scene, made);
    return other;
}

/**
 * A run at a time, whatever the state shows: for what is compared.
 * @param {Scene} scene @param {Run} run @param {number} time
 * @returns {Instant}
 */
export function instantOf(scene, run, time) {
    const where = locate(run.time.data, time);
    const q = joints(scene, run, where);
    return {
        time, run, byHand: false, q, pose: run.pose ? row(run.pose, where) : null,
        ...placed(scene, run, q, where, valuesOf(run, where), where),
    };
}

/** @param {State} state @returns {Instant} */
function compute(state) {
    const { hand, time } = state;
    const [scene, run] = [sceneOf(state), runOf(state)];
    if (!hand || !run) return instantOf(scene, run, time);
    const where = locate(run.time.data, time);
    const { q = joints(scene, run, where), pose = null, values = {}, loads } = heldBy(state, hand);
    const known = { ...unknown(run), ...values };
    const acting = state.engine?.pushes ? pushed(run, state.engine.pushes()) : run;
    return { time, run, byHand: true, q, pose, ...placed(scene, acting, q, where, known, null, loads) };
}

/**
 * What is known of a machine that stands still in somebody's hand.
 * @param {State} state @param {import("./types").Hand} hand
 * @returns {{q?: Float64Array, pose?: number[] | null, values?: Record<string, number>, loads?: any}}
 */
function heldBy(state, hand) {
    const { engine } = state;
    const held = engine?.held?.(hand, state);
    if (held) return held;
    if (!("pose" in hand)) return { q: Float64Array.from(hand.q) };
    if (!engine?.holding) return { pose: hand.pose };
    const { pose } = hand;
    const forces = engine.holding(pose);
    /** @type {Record<string, number>} */
    const values = { y: pose[0], z: pose[1], theta: pose[2], power_total: 0 };
    for (const name of ["y_dot", "z_dot", "theta_dot", "y_ddot", "z_ddot", "theta_ddot"]) values[name] = 0;
    /** @type {number[]} */
    const sliders = [...engine.sliders(pose)];
    ["a", "b", "c"].forEach((leg, i) => {
        for (const name of ["force", "static"]) values[`${name}_${leg}`] = forces[i];
        for (const name of ["speed", "acceleration", "power"]) values[`${name}_${leg}`] = 0;
        values[`slider_${leg}`] = sliders[i];
    });
    return { q: engine.joints(pose), pose, values };
}

/** A run with what acts from outside now. @param {Run} run @param {import("./types").Load[]} pushes @returns {Run} */
const pushed = (run, pushes) => ({ ...run, loads: [...run.loads.filter(({ group }) => group !== "wrench"), ...pushes] });

/** @param {Run} run @returns {Record<string, number>} */
const unknown = (run) => Object.fromEntries(run.curves.map(({ key }) => [key, NaN]));

/**
 * @param {Scene} scene @param {Run} run @param {Float64Array} q @param {Where} where
 * @param {Record<string, number>} values @param {Where | null} loaded null: stored vectors do not hold here
 * @param {Record<string, number[]>} [held] vectors of loads by key, where the machine is held
 */
function placed(scene, run, q, where, values, loaded, held) {
    const placements = treeOf(scene).place(q, run.placed ? (joint) => turn(run.placed?.[joint.name], where) : null);
    const loads = run.loads.map((load) => {
        const at = pointOf(placements, load.joint, load.point);
        const value = load.curve ? values[load.curve] : NaN;
        const own = load.curve ? (load.direction ?? [0, 0, 1]).map((x) => x * value)
            : loaded && load.values ? row(load.values, loaded) : held?.[load.key] ?? [NaN, NaN, NaN];
        const vector = load.frame === "joint" ? directionOf(placements, load.joint, own) : own;
        return { load, at, vector, value: load.curve ? value : Math.hypot(...vector) };
    });
    return { placements, values, loads };
}

/** @typedef {{i: number, part: number}} Where between sample i and the next one */

/** @param {ArrayLike<number>} instants growing @param {number} time @returns {Where} */
export function locate(instants, time) {
    let low = 0;
    let high = instants.length - 1;
    if (!(time > instants[0])) return { i: 0, part: 0 };
    if (time >= instants[high]) return { i: high, part: 0 };
    while (high - low > 1) {
        const middle = (low + high) >> 1;
        if (instants[middle] <= time) low = middle;
        else high = middle;
    }
    return { i: low, part: (time - instants[low]) / (instants[low + 1] - instants[low]) };
}

/** @param {Run} run @param {Where} where */
function valuesOf(run, where) {
    return Object.fromEntries(run.curves.map(({ key, values }) => [key, at(values.data, where.i, where.i + 1, where.part)]));
}

/** @param {ArrayLike<number>} data @param {number} i @param {number} j @param {number} part */
function at(data, i, j, part) {
    return part === 0 ? data[i] : data[i] + part * (data[j] - data[i]);
}

/** @param {Table} table @param {Where} where @returns {number[]} */
function row({ shape, data }, { i, part }) {
    const n = shape[1];
    return Array.from({ length: n }, (_, k) => at(data, i * n + k, (i + 1) * n + k, part));
}

/** @param {Table | undefined} table placements @param {Where} where */
function turn(table, where) {
    if (!table) return [0, 0, 0, 0, 0, 0, 1];
    const p = row(table, where);
    if (where.part === 0) return p;
    const n = 7 * where.i;
    shortest(p, 3, 4, table.data, n + 3, n + 10, where.part);
    return p;
}

/** @param {Scene} scene @param {Run} run @param {Where} where */
function joints(scene, run, where) {
    const q = Float64Array.from(row(run.q, where));
    if (where.part === 0) return q;
    const n = run.q.shape[1];
    for (const joint of scene.joints) {
        const k = joint.q?.[0] ?? 0;
        const first = { continuous: 0, planar: 2, spherical: 0, free: 3 }[/** @type {string} */ (joint.kind)];
        if (first === undefined) continue;
        const count = joint.kind === "spherical" || joint.kind === "free" ? 4 : 2;
        const from = where.i * n + k + first;
        shortest(q, k + first, count, run.q.data, from, from + n, where.part);
    }
    return q;
}

/** Interpolate a unit vector: of a quaternion the way of the same sign. */
/** @param {Float64Array | number[]} out @param {number} o @param {number} count @param {ArrayLike<number>} data @param {number} i @param {number} j @param {number} part */
function shortest(out, o, count, data, i, j, part) {
    let dot = 0;
    for (let k = 0; k < count; k++) dot += data[i + k] * data[j + k];
    const sign = count === 4 && dot < 0 ? -1 : 1;
    let square = 0;
    for (let k = 0; k < count; k++) {
        out[o + k] = (1 - part) * data[i + k] + sign * part * data[j + k];
        square += out[o + k] ** 2;
    }
    for (let k = 0; k < count; k++) out[o + k] /= Math.sqrt(square);
}

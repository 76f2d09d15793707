// What is at one instant: computed once for each refresh, and shared, so that no frame mixes two.
import { Tree, directionOf, pointOf } from "./tree.js";

/** @typedef {import("./types").State} State */
/** @typedef {import("./types").Run} Run */
/** @typedef {import("./types").Instant} Instant */
/** @typedef {import("./types").Table} Table */

/** @type {WeakMap<object, Tree>} */
const trees = new WeakMap();
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

/** The tree of a document's scene. @param {State["document"]} document */
export function treeOf(document) {
    let tree = trees.get(document.scene);
    if (!tree) trees.set(document.scene, (tree = new Tree(document.scene.joints)));
    return tree;
}

/**
 * A run at a time, whatever the state shows: for what is compared.
 * @param {State["document"]} document @param {Run} run @param {number} time
 * @returns {Instant}
 */
export function instantOf(document, run, time) {
    const where = locate(run.time.data, time);
    const q = joints(document, run, where);
    return {
        time, run, byHand: false, q, pose: run.pose ? row(run.pose, where) : null,
        ...placed(document, run, q, where, valuesOf(run, where), where),
    };
}

/** @param {State} state @returns {Instant} */
function compute(state) {
    const { document, hand, time } = state;
    const run = runOf(state);
    if (!hand || !run) return instantOf(document, run, time);
    const where = locate(run.time.data, time);
    const held = state.engine?.held?.(hand, state) ?? {};
    const q = held.q ?? ("q" in hand ? Float64Array.from(hand.q) : joints(document, run, where));
    const values = Object.fromEntries(run.curves.map(({ key }) => [key, held.values?.[key] ?? NaN]));
    const pose = "pose" in hand ? hand.pose : held.pose ?? null;
    return { time, run, byHand: true, q, pose, ...placed(document, run, q, where, values, null, held.loads) };
}

/**
 * @param {State["document"]} document @param {Run} run @param {Float64Array} q @param {Where} where
 * @param {Record<string, number>} values @param {Where | null} loaded null: stored vectors do not hold here
 * @param {Record<string, number[]>} [held] vectors of loads by key, where the machine is held
 */
function placed(document, run, q, where, values, loaded, held) {
    const placements = treeOf(document).place(q, run.placed ? (joint) => turn(run.placed?.[joint.name], where) : null);
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

/** @param {State["document"]} document @param {Run} run @param {Where} where */
function joints(document, run, where) {
    const q = Float64Array.from(row(run.q, where));
    if (where.part === 0) return q;
    const n = run.q.shape[1];
    for (const joint of document.scene.joints) {
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

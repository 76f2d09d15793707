// What a chart draws: curves of the run that is shown, as they were before, and those of another run.
import { difference, groupsOf, resample, samplesIn, shortened, wholePeak } from "./curves.js";
import { runOf } from "./instant.js";

/** @typedef {import("./types").State} State */
/** @typedef {import("./types").Run} Run */
/** @typedef {import("./types").Curve} Curve */
/** @typedef {"now" | "before" | "other" | "difference"} Kind */
/** @typedef {{key: string, label: string, colour: string, kind: Kind, time: ArrayLike<number>,
 *             values: ArrayLike<number>, x?: ArrayLike<number>, scale: number, limit?: [number | null, number | null]}} Line x: what it is drawn over, if not time */
/** @typedef {{group: string, unit: string, over: import("./against").Over | null, lines: Line[], names: Partial<Record<Kind, string>>}} Drawing */

const COLOURS = ["#0072b2", "#d55e00", "#009e73", "#6b299e", "#b8860b", "#c2185b", "#455a64", "#7cb342"];

/** What three charts show first, by units: the first group, speeds, powers. */
const FIRST = [[], ["m/s", "rad/s"], ["W"]];

/**
 * The first group of each list of units, and others in their order where there is none.
 * @param {import("./curves").Group[]} groups
 * @param {string[][]} wanted
 */
export function byUnits(groups, wanted) {
    /** @type {(import("./curves").Group | undefined)[]} */
    const found = wanted.map((units, i) => (i ? groups.find(({ unit }) => units.includes(unit)) : groups[0]));
    const rest = groups.filter((group) => !found.includes(group));
    return found.map((group) => group ?? rest.shift()).filter((group) => group !== undefined);
}

/** @param {State} state @returns {string[]} */
export function groupNames(state) {
    return groupsOf(runOf(state)).map(({ name }) => name);
}

/**
 * The group that a chart shows: the one that was chosen, where the run has it.
 * @param {State} state
 * @param {number} index of the chart
 */
export function groupOf(state, index) {
    const groups = groupsOf(runOf(state));
    const chosen = state.charts[index]?.group;
    if (chosen !== undefined && groups.some(({ name }) => name === chosen)) return chosen;
    return (byUnits(groups, FIRST)[index] ?? groups[0])?.name ?? "";
}

/** @param {State} state @param {number} index of the chart @returns {string[]} keys of curves that are not drawn */
export const hiddenIn = (state, index) => state.charts[index]?.hidden ?? [];

/** The curve that a chart is drawn over; empty for time, or where the run has no such curve. @param {State} state @param {number} index of the chart */
export const overIn = (state, index) => curveOf(runOf(state), state.charts[index]?.over ?? "")?.key ?? "";

/**
 * All that a chart draws, hidden curves too.
 * @param {State} state
 * @param {number} index of the chart
 * @returns {Drawing}
 */
export function drawingOf(state, index) {
    const group = groupOf(state, index), over = overIn(state, index);
    const run = runOf(state);
    const { before } = state;
    const other = otherOf(state);
    const less = state.difference ? (other ?? before) : null;
    const found = groupsOf(run).find(({ name }) => name === group);
    /** @type {Drawing} */
    const drawing = { group, unit: found?.unit ?? "", over: curveOf(run, over), lines: [], names: { now: "this run" } };
    const labels = shortened(found?.curves.map(({ label }) => label) ?? []);
    found?.curves.forEach((curve, i) => {
        const colour = curve.colour ?? COLOURS[i % COLOURS.length];
        /** @param {Kind} kind @param {Run} of @param {ArrayLike<number>} values */
        const line = (kind, of, values) => drawing.lines.push({
            key: curve.key, label: labels[i], colour, kind, time: of.time.data, values, limit: curve.limit, x: over ? (curveOf(of, over)?.values.data ?? []) : undefined,
            scale: Math.abs(wholePeak(run.time.data, curve.values.data)?.value ?? 0),
        });
        const past = curveOf(before, curve.key);
        const another = curveOf(other, curve.key);
        if (less) {
            const subtrahend = curveOf(less, curve.key);
            if (subtrahend) line("difference", run, difference(run.time.data, curve.values.data, less.time.data, subtrahend.values.data));
            return;
        }
        line("now", run, curve.values.data);
        if (past && before) line("before", before, past.values.data);
        if (another && other) line("other", other, another.values.data);
    });
    if (before) drawing.names.before = "before";
    if (other) drawing.names.other = other.name;
    if (less) {
        drawing.names.difference = less === before ? "less before" : `less ${less.name}`;
        drawing.lines.forEach((line) => delete line.limit);
    }
    return drawing;
}

/** The run that is compared with. @param {State} state @returns {Run | null} */
function otherOf({ compare, run, document }) {
    return compare === null || compare === run ? null : (document.runs[compare] ?? null);
}

/** @param {Run | null} run @param {string} key */
const curveOf = (run, key) => run?.curves.find((curve) => curve.key === key) ?? null;

/**
 * One axis of time for all lines, and their values on it; null where a line has no value.
 * @param {Line[]} lines
 * @returns {[ArrayLike<number>, ...(ArrayLike<number | null>)[]]}
 */
export function aligned(lines) {
    /** @type {ArrayLike<number>[]} */
    const axes = [];
    for (const { time } of lines) if (!axes.some((axis) => same(axis, time))) axes.push(time);
    const time = axes.length ? axes.reduce(union) : [];
    return [time, ...lines.map((line) => gaps(same(time, line.time) ? line.values : resample(line.time, line.values, time)))];
}

/**
 * As many samples as can be seen: the lowest and the highest of each column of pixels, in their order in time.
 * @param {[ArrayLike<number>, ...(ArrayLike<number | null>)[]]} data as `aligned` returns it
 * @param {[number, number]} span that is seen [s]
 * @param {number} columns of pixels
 * @returns {[ArrayLike<number>, ...(ArrayLike<number | null>)[]]} the same, if there are few samples
 */
export function thinned(data, span, columns) {
    const [time, ...all] = data;
    const [from, to] = samplesIn(time, span);
    const [start, end] = [Math.max(0, from - 1), Math.min(time.length, to + 1)]; // lines go out of what is seen
    if (end - start <= 4 * columns) return data;
    const width = (end - start) / columns;
    const edges = Array.from({ length: columns + 1 }, (_, k) => (k === columns ? end : start + Math.floor(k * width)));
    const axis = new Float64Array(2 * columns);
    for (let k = 0; k < columns; k++) [axis[2 * k], axis[2 * k + 1]] = [time[edges[k]], time[edges[k + 1] - 1]];
    return [axis, ...all.map((values) => extremes(values, edges))];
}

/** @param {ArrayLike<number | null>} values @param {number[]} edges @returns {(number | null)[]} two for each column */
function extremes(values, edges) {
    /** @type {(number | null)[]} */
    const found = new Array(2 * (edges.length - 1)).fill(null);
    for (let k = 0; k + 1 < edges.length; k++) {
        let low = -1, high = -1, least = Infinity, most = -Infinity;
        for (let i = edges[k]; i < edges[k + 1]; i++) {
            const value = values[i];
            if (value === null) continue;
            if (value < least) {
                least = value;
                low = i;
            }
            if (value > most) {
                most = value;
                high = i;
            }
        }
        if (low < 0) continue;
        found[2 * k] = low < high ? least : most;
        found[2 * k + 1] = low < high ? most : least;
    }
    return found;
}

/** @param {ArrayLike<number>} a @param {ArrayLike<number>} b */
function same(a, b) {
    if (a === b) return true;
    if (a.length !== b.length) return false;
    for (let i = 0; i < a.length; i++) if (a[i] !== b[i]) return false;
    return true;
}

/** @param {ArrayLike<number>} a @param {ArrayLike<number>} b both rising @returns {Float64Array} */
function union(a, b) {
    const all = new Float64Array(a.length + b.length);
    let count = 0;
    for (let i = 0, j = 0; i < a.length || j < b.length; count++) {
        const next = j >= b.length || a[i] <= b[j] ? a[i] : b[j];
        if (a[i] === next) i++;
        if (b[j] === next) j++;
        all[count] = next;
    }
    return all.subarray(0, count);
}

/** @param {ArrayLike<number>} values @returns {ArrayLike<number | null>} what uPlot breaks a line at is null */
function gaps(values) {
    let found = known.get(values);
    if (!found) known.set(values, (found = withGaps(values)));
    return found;
}

/** @type {WeakMap<object, ArrayLike<number | null>>} */
const known = new WeakMap();

/** @param {ArrayLike<number>} values */
function withGaps(values) {
    for (let i = 0; i < values.length; i++) {
        if (Number.isNaN(values[i])) return Array.from(values, (value) => (Number.isNaN(value) ? null : value));
    }
    return values;
}

/** From the first to the last instant of all that is drawn: of charts and time bar. @param {State} state @returns {[number, number]} */
export function wholeSpan(state) {
    const runs = [runOf(state), state.before, otherOf(state)];
    let [start, end] = [Infinity, -Infinity];
    for (const run of runs) {
        if (!run) continue;
        const { data } = run.time;
        start = Math.min(start, data[0]);
        end = Math.max(end, data[data.length - 1]);
    }
    return end > start ? [start, end] : Number.isFinite(start) ? [start, start + 1] : [0, 1];
}

/** The part of it that charts show. @param {State} state @returns {[number, number]} */
export function shownSpan(state) {
    const [start, end] = wholeSpan(state);
    if (!state.zoom) return [start, end];
    const zoom = /** @type {[number, number]} */ ([Math.max(start, state.zoom[0]), Math.min(end, state.zoom[1])]);
    return zoom[1] > zoom[0] ? zoom : [start, end];
}

// Numbers over time: what a run's curves are at an instant, where they peak, how two runs differ.

/** @typedef {ArrayLike<number>} Numbers */
/** @typedef {import("./types").Run} Run */
/** @typedef {import("./types").Curve} Curve */
/** @typedef {{index: number, time: number, value: number}} Peak */
/** @typedef {{name: string, unit: string, curves: Curve[]}} Group */

/** Smaller parts of a value are taken for rounding. */
export const ROUNDING = 1e-9;

/**
 * The last sample at or before an instant; 0 before the first.
 * @param {Numbers} time rising
 * @param {number} instant [s]
 * @returns {number}
 */
export function indexAt(time, instant) {
    let low = 0;
    let high = time.length - 1;
    while (low < high) {
        const middle = (low + high + 1) >> 1;
        if (time[middle] <= instant) low = middle;
        else high = middle - 1;
    }
    return low;
}

/**
 * Values between samples, straight from one to the next; NaN before the first and after the last.
 * @param {Numbers} time
 * @param {Numbers} values
 * @param {number} instant [s]
 * @returns {number}
 */
export function valueAt(time, values, instant) {
    const last = time.length - 1;
    if (last < 0 || !(instant >= time[0]) || instant > time[last]) return NaN;
    const index = indexAt(time, instant);
    if (index === last || time[index] === instant) return values[index];
    const share = (instant - time[index]) / (time[index + 1] - time[index]);
    return values[index] + share * (values[index + 1] - values[index]);
}

/**
 * The sample of largest magnitude; the first of them; null where there is no number.
 * @param {Numbers} time
 * @param {Numbers} values
 * @param {[number, number] | null} [span] within these times only [s]
 * @returns {Peak | null}
 */
export function peakOf(time, values, span = null) {
    const [start, end] = samplesIn(time, span);
    let index = -1;
    let size = -1;
    for (let sample = start; sample < end; sample++) {
        const magnitude = Math.abs(values[sample]);
        if (magnitude > size) {
            size = magnitude;
            index = sample;
        }
    }
    return index < 0 ? null : { index, time: time[index], value: values[index] };
}

/** @type {WeakMap<object, [number, number]>} */
const ranges = new WeakMap();

/** The smallest and the largest of a whole curve; found once for each. @param {Numbers} values */
export function wholeRange(values) {
    let found = ranges.get(values);
    if (!found) ranges.set(values, (found = rangeOf([values], 0, values.length)));
    return found;
}

/** @type {WeakMap<object, Peak | null>} */
const peaks = new WeakMap();

/** The peak of a whole run; found once for each curve. @param {Numbers} time @param {Numbers} values */
export function wholePeak(time, values) {
    let found = peaks.get(values);
    if (found === undefined) peaks.set(values, (found = peakOf(time, values)));
    return found;
}

/**
 * The samples within a span of time, as a half-open range.
 * @param {Numbers} time
 * @param {[number, number] | null} span [s]
 * @returns {[number, number]}
 */
export function samplesIn(time, span) {
    if (!span) return [0, time.length];
    let start = indexAt(time, span[0]);
    if (time[start] < span[0]) start += 1;
    const end = time.length && time[0] <= span[1] ? indexAt(time, span[1]) + 1 : 0;
    return [start, Math.max(start, end)];
}

/**
 * The smallest and the largest of several curves; [NaN, NaN] where there is no number.
 * @param {Numbers[]} all
 * @param {number} start
 * @param {number} end
 * @returns {[number, number]}
 */
export function rangeOf(all, start, end) {
    let low = Infinity;
    let high = -Infinity;
    for (const values of all) {
        for (let sample = start; sample < end; sample++) {
            const value = values[sample];
            if (value === null) continue; // a gap, not a zero
            if (value < low) low = value;
            if (value > high) high = value;
        }
    }
    return low <= high ? [low, high] : [NaN, NaN];
}

/**
 * The range of an axis: around all values with some room, and out to a limit that is nearly reached.
 * @param {[number, number]} range of the values
 * @param {[number | null, number | null][]} limits
 * @param {number} [scale] how large what they come from is: differences that are tiny beside it are none
 * @returns {[number, number]}
 */
export function axisOf(range, limits, scale = 0) {
    let [low, high] = Number.isFinite(range[0]) ? range : [0, 1];
    for (const [least, most] of limits) {
        if (most !== null && most > 0 && high >= most / 2) high = Math.max(high, most * 1.02);
        if (least !== null && least < 0 && low <= least / 2) low = Math.min(low, least * 1.02);
    }
    const size = Math.max(Math.abs(low), Math.abs(high), scale);
    const least = size > 0 ? ROUNDING * size : 1; // what only rounding moves is a straight line
    if (high - low < least) {
        const middle = (low + high) / 2;
        const half = size > 0 ? 0.1 * size : 0.5;
        return [middle - half, middle + half];
    }
    const room = 0.08 * (high - low);
    return [low - room, high + room];
}

/**
 * The curves of a run in groups, in the order of the document. A group has one unit: what has another one makes
 * a group of its own, which its labels name.
 * @param {Run | null | undefined} run
 * @returns {Group[]}
 */
export function groupsOf(run) {
    /** @type {Map<string, Curve[]>} */
    const families = new Map();
    for (const curve of run?.curves ?? []) families.set(curve.group, [...(families.get(curve.group) ?? []), curve]);
    return [...families].flatMap(([family, curves]) => {
        const labels = shortened(curves.map(({ label }) => label));
        return [...new Set(curves.map(({ unit }) => unit))].map((unit, i) => {
            const own = curves.flatMap((curve, k) => (curve.unit === unit ? [k] : []));
            const name = i === 0 ? family : `${family}: ${own.map((k) => labels[k]).join(", ")}`;
            return { name, unit, curves: own.map((k) => curves[k]) };
        });
    });
}

/**
 * Labels without the words that all of a group begin with: "Force A", "Force B" become "A", "B".
 * @param {string[]} labels
 * @returns {string[]}
 */
export function shortened(labels) {
    if (labels.length < 2) return labels;
    let common = labels.reduce((prefix, label) => {
        let size = 0;
        while (size < prefix.length && prefix[size] === label[size]) size += 1;
        return prefix.slice(0, size);
    });
    const whole = labels.every((label) => label.length > common.length && /^[\s,:]/.test(label.slice(common.length)));
    if (!whole) common = common.slice(0, common.search(/[^\s,:]*$/));
    return labels.map((label) => label.slice(common.length).replace(/^[\s,:]+/, ""));
}

/**
 * Values of one run at the times of another; NaN where it has none.
 * @param {Numbers} time
 * @param {Numbers} values
 * @param {Numbers} onto times, rising
 * @returns {Float64Array}
 */
export function resample(time, values, onto) {
    const found = new Float64Array(onto.length).fill(NaN);
    const last = time.length - 1;
    let index = 0;
    for (let sample = 0; sample < onto.length; sample++) {
        const instant = onto[sample];
        if (last < 0 || instant < time[0] || instant > time[last]) continue;
        while (index < last && time[index + 1] <= instant) index += 1;
        if (index === last || time[index] === instant) found[sample] = values[index];
        else {
            const share = (instant - time[index]) / (time[index + 1] - time[index]);
            found[sample] = values[index] + share * (values[index + 1] - values[index]);
        }
    }
    return found;
}

/**
 * One curve less another, at the times of the first.
 * @param {Numbers} time
 * @param {Numbers} values
 * @param {Numbers} otherTime
 * @param {Numbers} other
 * @returns {Float64Array}
 */
export function difference(time, values, otherTime, other) {
    const found = resample(otherTime, other, time);
    for (let sample = 0; sample < found.length; sample++) found[sample] = values[sample] - found[sample];
    return found;
}

/**
 * The next or earlier sample from an instant, so that a step always moves.
 * @param {Numbers} time
 * @param {number} instant [s]
 * @param {number} count how many samples; negative: back
 * @returns {number} its time [s]
 */
export function stepFrom(time, instant, count) {
    const index = indexAt(time, instant);
    const between = instant > time[index];
    const from = count < 0 && between ? index + 1 : index;
    return time[Math.min(time.length - 1, Math.max(0, from + count))];
}

// A task in time: waypoints, the ways between stops, and how long each takes, as `p3dof plan` has them.
import { CORNERS, PROFILES, Path, TaskError } from "./paths.js";

/** @typedef {import("./paths.js").Waypoint} Waypoint */

/**
 * What the platform has to do: from stop to stop, at rest in each.
 * @typedef {object} Task
 * @property {string} name
 * @property {string} profile quintic, septic or s-curve
 * @property {number} smoothness 2 or 3: how many derivatives go on where blends begin and end
 * @property {number} turning a turn of 1 rad counts as so much way [m]
 * @property {Waypoint[]} waypoints
 */

/**
 * How long the task takes: so long in all, or as short as the actuators' limits let it.
 * @typedef {{fastest: boolean, duration: number | null, force: number | null, speed: number | null, power: number | null}} Pace [s, N, m/s, W]; null: as it comes
 */

/** @type {Task} */
export const NO_TASK = { name: "waypoints", profile: "quintic", smoothness: 2, turning: 0.1, waypoints: [] };
/** @type {Pace} */
export const ANY_PACE = { fastest: false, duration: null, force: null, speed: null, power: null };

/**
 * A way from one stop to the next.
 * @typedef {object} Stretch
 * @property {number} first
 * @property {number} last
 * @property {Path} path
 */

/**
 * A task in time; rows of three.
 * @typedef {object} Plan
 * @property {Float64Array} time
 * @property {Float64Array} pose
 * @property {Float64Array} velocity
 * @property {Float64Array} acceleration
 * @property {Float64Array | null} wrench rows of six; null: none
 * @property {number[]} times when the platform gets to each waypoint [s]
 * @property {number[]} durations of the ways between stops [s]
 */

/** A part of a plan, from waypoint to waypoint or at one. @typedef {{start: number, end: number, wrench: number[] | null, waits: boolean}} Span */

/** The waypoints' names, or numbers. @param {Task} task */
export const namesOf = (task) => task.waypoints.map(({ name }, k) => name || `waypoint ${k + 1}`);

/**
 * The ways of a task.
 * @param {Task} task
 * @returns {Stretch[]}
 */
export function stretchesOf(task) {
    const { waypoints } = task, names = namesOf(task);
    if (waypoints.length < 2) throw new TaskError("expected two waypoints or more");
    for (const k of [0, waypoints.length - 1]) {
        if (waypoints[k].blend > 0) throw new TaskError(`${names[k]}: expected a stop at the beginning and at the end`);
    }
    const stops = waypoints.flatMap(({ blend }, k) => (blend > 0 ? [] : [k]));
    return stops.slice(1).map((last, k) => {
        const first = stops[k];
        const path = new Path(
            waypoints.slice(first, last + 1), names.slice(first, last + 1), task.turning, task.smoothness,
        );
        return { first, last, path };
    });
}

/**
 * How long each way takes when the whole task takes so long: ways without a duration of their own share what is left,
 * so that the largest acceleration is the same in all of them.
 * @param {Task} task @param {Stretch[]} stretches @param {number | null} total dwells included [s]
 */
export function durationsOf(task, stretches, total) {
    const given = stretches.map(({ last }) => task.waypoints[last].duration);
    const dwell = task.waypoints.reduce((sum, point) => sum + point.dwell, 0);
    const fixed = dwell + given.reduce((/** @type {number} */ sum, time) => sum + (time ?? 0), 0);
    if (given.every((time) => time !== null)) return /** @type {number[]} */ (given);
    if (total === null) throw new TaskError("expected the duration of the whole task");
    if (!(total > fixed)) {
        throw new TaskError(`expected more than the ${Number(fixed.toPrecision(6))} s that dwells and given durations take`);
    }
    const needs = stretches.map(({ path }, k) => (given[k] === null ? Math.sqrt(hardest(path, task)) : 0));
    const sum = needs.reduce((a, b) => a + b, 0);
    return given.map((time, k) => time ?? ((total - fixed) * needs[k]) / sum);
}

const GRID = 401;
/** Each part of a way has so many times fewer samples than all ways, at least; a wait so many times fewer again. */
const PARTS = 7;
/** Samples closer than that share of the time that the ways take are one. */
const CLOSE = 1e-9;

/** The largest acceleration on a way that takes one second [m/s^2]. @param {Path} path @param {Task} task */
function hardest(path, task) {
    let most = 0;
    for (let k = 0; k < GRID; ++k) {
        const [, , change] = moved(path, PROFILES[task.profile], k / (GRID - 1), 1);
        most = Math.max(most, Math.hypot(change[0], change[1], task.turning * change[2]));
    }
    return most;
}

/** Pose, velocity, acceleration. @param {Path} path @param {import("./paths.js").Profile} profile @param {number} share of the time @param {number} duration */
export function moved(path, profile, share, duration) {
    const [s, rate, change] = profile(share);
    const [pose, slope, bend] = path.at(Math.min(Math.max(path.end * s, 0), path.end));
    const speed = (path.end * rate) / duration, sped = (path.end * change) / duration ** 2;
    return [pose, slope.map((x) => x * speed), bend.map((x, i) => x * speed ** 2 + slope[i] * sped)];
}

/**
 * A task in time.
 * @param {Task} task @param {Stretch[]} stretches @param {number[]} durations of the stretches [s]
 * @param {number} samples least number of the ways together, even over each line or blend; all stops and waypoints are samples
 * @returns {Plan}
 */
export function planned(task, stretches, durations, samples = 1001) {
    const { waypoints } = task, profile = PROFILES[task.profile];
    const times = waypoints.map(() => 0);
    /** @type {Span[]} */
    const spans = [];
    /** @param {number} start @param {number} end @param {number[] | null} wrench @param {boolean} waits */
    const span = (start, end, wrench, waits) => void spans.push({ start, end, wrench, waits });
    let now = 0;
    const begun = stretches.map(({ first, last, path }, k) => {
        if (k === 0 && waypoints[0].dwell > 0) span(now, (now += waypoints[0].dwell), null, true);
        const start = now;
        const passed = path.atWaypoints.map((place) => durations[k] * when(profile, place / path.end));
        for (let way = first; way < last; ++way) {
            times[way + 1] = start + passed[way + 1 - first];
            span(start + passed[way - first], times[way + 1], waypoints[way + 1].wrench, false);
        }
        now = start + passed[last - first];
        if (waypoints[last].dwell > 0) span(now, (now += waypoints[last].dwell), null, true);
        return start;
    });
    const turns = begun.flatMap((start, k) => {
        const { path } = stretches[k];
        return path.pieces.map(({ end }) => start + durations[k] * when(profile, end / path.end));
    });
    const kinks = begun.flatMap((start, k) => (CORNERS[task.profile] ?? []).map((share) => start + durations[k] * share));
    const time = sampled(spans, turns, kinks, durations.reduce((sum, one) => sum + one, 0), samples);
    /** @type {Plan} */
    const plan = {
        time,
        pose: new Float64Array(3 * time.length),
        velocity: new Float64Array(3 * time.length),
        acceleration: new Float64Array(3 * time.length),
        wrench: wrenches(time, spans),
        times,
        durations,
    };
    time.forEach((at, i) => {
        let k = stretches.length - 1;
        while (k > 0 && !(at > begun[k])) --k;
        const { path, first, last } = stretches[k];
        if (at <= begun[k]) plan.pose.set(waypoints[first].pose, 3 * i);
        else if (at >= begun[k] + durations[k]) plan.pose.set(waypoints[last].pose, 3 * i);
        else {
            const [pose, velocity, acceleration] = moved(path, profile, (at - begun[k]) / durations[k], durations[k]);
            plan.pose.set(pose, 3 * i);
            plan.velocity.set(velocity, 3 * i);
            plan.acceleration.set(acceleration, 3 * i);
        }
    });
    return plan;
}

/**
 * The times of samples, as `p3dof.design.tasks.plan` has them: even over each part of a segment, few in dwells.
 * @param {Span[]} spans @param {number[]} turns where lines and blends end @param {number[]} kinks of the profile
 * @param {number} moving how long all ways take [s] @param {number} samples
 */
function sampled(spans, turns, kinks, moving, samples) {
    const total = spans[spans.length - 1].end, close = Math.max(CLOSE * moving, 1e-15 * total);
    const parts = apart(turns, [], close), ends = [0, ...spans.map(({ end }) => end)];
    const bends = apart(kinks, [...ends, ...parts], close), least = Math.ceil((samples - 1) / PARTS);
    const found = [total];
    for (const { start, end, waits } of spans) {
        const inner = parts.filter((time) => time > start + close && time < end - close);
        [start, ...inner].forEach((from, k) => {
            const to = inner[k] ?? end;
            const even = Math.max(least, Math.ceil(((samples - 1) * (to - from)) / moving - 1e-9));
            const step = (to - from) / (waits ? Math.ceil(least / PARTS) : even);
            const edges = [from, ...bends.filter((time) => time > from && time < to), to];
            edges.slice(1).forEach((edge, i) => {
                const size = edge - edges[i];
                const count = Math.min(Math.ceil(size / step - 1e-9), Math.max(1, Math.floor(size / close)));
                for (let n = 0; n < count; ++n) found.push(edges[i] + (size * n) / count);
            });
        });
    }
    return Float64Array.from(found).sort();
}

/** Those of times that are no closer to each other, and to known ones, than that. @param {number[]} times @param {number[]} known @param {number} close */
function apart(times, known, close) {
    const every = Float64Array.from(times).sort(), there = Float64Array.from(known).sort();
    let next = 0;
    return [...every].filter((time, k) => {
        if (k && time - every[k - 1] <= close) return false;
        while (next < there.length && there[next] < time - close) ++next;
        return !(next < there.length && there[next] <= time + close);
    });
}

/** The external load at samples; of two spans that meet, the earlier one counts. */
/** @param {Float64Array} time @param {Span[]} spans */
function wrenches(time, spans) {
    if (!spans.some(({ wrench }) => wrench?.some((x) => x !== 0))) return null;
    const rows = new Float64Array(6 * time.length);
    time.forEach((t, i) => {
        const found = spans.find(({ end }) => t <= end);
        if (found?.wrench) rows.set(found.wrench, 6 * i);
    });
    return rows;
}

/** The share of the time at which a share of the way is covered. @param {import("./paths.js").Profile} profile @param {number} share */
function when(profile, share) {
    if (share <= 0) return 0;
    if (share >= 1) return 1;
    let [low, high] = [0, 1];
    while (high - low > 1e-15) {
        const middle = (low + high) / 2;
        if (middle === low || middle === high) break;
        if (profile(middle)[0] < share) low = middle;
        else high = middle;
    }
    return (low + high) / 2;
}

// A task in time: waypoints, the ways between stops, and how long each takes, as `p3dof plan` has them.
import { PROFILES, Path, TaskError } from "./paths.js";

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
/** Intervals between samples of each way at least; the seven parts of the s-curve end at some of them. */
const EACH = 280;

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
 * @param {number} samples least number, evenly spaced; all stops and waypoints are samples besides
 * @param {number} each intervals of each way at least: a way among long waits has its own even samples
 * @returns {Plan}
 */
export function planned(task, stretches, durations, samples = 1001, each = EACH) {
    const { waypoints } = task, profile = PROFILES[task.profile];
    const times = waypoints.map(() => 0), ends = [0];
    /** @type {{start: number, end: number, wrench: number[] | null}[]} */
    const spans = [];
    /** @param {number} start @param {number} end @param {number[] | null} wrench */
    const span = (start, end, wrench) => void (ends.push(end), spans.push({ start, end, wrench }));
    let now = 0;
    const begun = stretches.map(({ first, last, path }, k) => {
        if (k === 0 && waypoints[0].dwell > 0) span(now, (now += waypoints[0].dwell), null);
        const start = now;
        const passed = path.atWaypoints.map((place) => durations[k] * when(profile, place / path.end));
        for (let way = first; way < last; ++way) {
            times[way + 1] = start + passed[way + 1 - first];
            span(start + passed[way - first], times[way + 1], waypoints[way + 1].wrench);
        }
        now = start + passed[last - first];
        if (waypoints[last].dwell > 0) span(now, (now += waypoints[last].dwell), null);
        return start;
    });
    const ways = begun.map((start, k) => ({ start, end: start + durations[k] }));
    const time = sampled(now, ends, samples, ways.filter(({ start, end }) => (end - start) * (samples - 1) < each * now), each);
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
 * The times of samples: evenly spaced, in short ways more densely, and the ends of all spans, in the place of what is next to them.
 * @param {number} last @param {number[]} ends @param {number} samples @param {{start: number, end: number}[]} dense one after the other @param {number} each
 */
function sampled(last, ends, samples, dense, each) {
    const close = 1e-12 * last, found = [...new Set(ends)].sort((a, b) => a - b);
    const even = Array.from({ length: samples }, (_, k) => (k === samples - 1 ? last : k * (last / (samples - 1))));
    let way = 0;
    const times = even.filter((time) => {
        while (way < dense.length && dense[way].end <= time) ++way;
        return way === dense.length || time <= dense[way].start;
    });
    for (const { start, end } of dense) for (let i = 1; i < each; ++i) times.push(start + ((end - start) * i) / each);
    times.sort((a, b) => a - b);
    let next = 0;
    const known = found.length;
    for (const time of times) {
        while (next < known && found[next] < time - close) ++next;
        if (!(next < known && found[next] <= time + close)) found.push(time);
    }
    return Float64Array.from(found).sort();
}

/** The external load at samples; of two spans that meet, the earlier one counts. */
/** @param {Float64Array} time @param {{start: number, end: number, wrench: number[] | null}[]} spans */
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

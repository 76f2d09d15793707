// Keeps the run of the waypoints in step with them: before all others in a refresh.
import { fastest, requireWay } from "./fastest.js";
import { TaskError } from "./paths.js";
import { durationsOf, namesOf, planned, stretchesOf } from "./plan.js";
import { runOfMotion } from "./resolve.js";
import { changedTo, engineOf, takeMachine } from "./solving.js";

/** @typedef {import("./types").State} State */
/** @typedef {import("./plan.js").Task} Task */
/** @typedef {import("./plan.js").Plan} Plan */

/**
 * What planning came to.
 * @typedef {{fault: string, plan: Plan | null, ways: {from: string, to: string, duration: number, binding: string}[], milliseconds: number}} Planned
 */

/** How long a way takes where nobody says [s]. */
const EASY = 1;

/** How long the task takes in all where nobody says [s]. @param {Task} task */
export function easyDuration({ waypoints }) {
    const stops = waypoints.filter(({ blend }) => !blend).length;
    return waypoints.reduce((sum, { dwell, duration }, k) => sum + dwell + (duration ?? 0) * (k ? 1 : 0), 0)
        + EASY * Math.max(0, stops - 1 - waypoints.filter(({ duration }) => duration !== null).length);
}

/** @typedef {{at: number | string, text: string}} Wrong a waypoint's or a field's entry that is no such number, and what was expected */

/** @param {number} value */
const got = (value) => (Number.isNaN(value) ? "nothing" : String(Number(value.toPrecision(6))));

/** Waypoints whose wait or blend is none. @param {Task} task @returns {Wrong[]} */
export function wrongWaits(task) {
    const names = namesOf(task);
    return task.waypoints.flatMap(({ dwell, blend }, at) => [
        ...(dwell >= 0 ? [] : [{ at, text: `${names[at]}: dwell: expected zero seconds or more, got ${got(dwell)}` }]),
        ...(blend >= 0 ? [] : [{ at, text: `${names[at]}: blend: expected more than zero, got ${got(blend * 1e3)} mm` }]),
    ]);
}

/**
 * Limits, or a time in all, that nothing can be planned with; a limit that is left empty is one where the machine has one.
 * @param {Task} task @param {import("./plan.js").Pace} pace @param {{force: number, speed: number}} own
 * @returns {Wrong[]}
 */
export function wrongPace(task, pace, own) {
    if (!pace.fastest) {
        const { duration } = pace, given = task.waypoints.every((point, k) => !k || point.blend || point.duration !== null);
        return given || duration === null || duration > 0 ? [] : [{ at: "duration", text: `time in all: expected more than zero seconds, got ${got(duration)}` }];
    }
    return /** @type {const} */ ([["force", "N"], ["speed", "m/s"], ["power", "W"]]).flatMap(([key, unit]) => {
        const value = pace[key], most = key === "power" ? Infinity : own[key];
        if (value === null || value > 0 || (Number.isNaN(value) && !Number.isFinite(most))) return [];
        const machine = Number.isFinite(most) ? `; the machine's own is ${got(most)} ${unit}` : "";
        return [{ at: key, text: `most ${key} of each actuator: expected more than zero ${unit}, got ${got(value)}${machine}` }];
    });
}

/** @param {State} state */
export function mount(state) {
    state.subscribe((_, changed) => {
        const engine = engineOf(state);
        if (!engine) return;
        const start = performance.now(), { runs } = state.document;
        const own = runs.findIndex(({ computed }) => computed === "waypoints"), lost = changed.has("document") && own < 0 && state.planned;
        const slower = changed.has("whatIf") && state.pace.fastest && state.planned;
        if (!changed.has("task") && !changed.has("pace") && !slower && !lost) return;
        takeMachine(engine, state.document); // the waypoints are the document's machine's, whatever run is shown
        changedTo(engine, state.whatIf);
        state.planned = state.task.waypoints.length < 2 ? null : attempt(state, engine);
        const plan = state.planned?.plan;
        const kept = runs.filter((_run, k) => k !== own);
        /** @type {import("./types").Run[]} */
        const made = plan ? [{ ...runOfMotion(engine, state.document, "Waypoints", plan), computed: "waypoints" }] : [];
        if (!made.length && own < 0) return void changed.add("planned");
        state.document = { ...state.document, runs: [...kept, ...made] };
        if (made.length && !lost && (changed.has("task") || changed.has("pace") || state.run === own)) state.run = kept.length;
        else if (state.run === own) state.run = 0;
        else if (own >= 0 && state.run > own) state.run -= 1;
        if (state.compare !== null && state.compare >= state.document.runs.length) state.compare = null;
        if (state.planned) state.planned.milliseconds = performance.now() - start;
        const { data } = state.document.runs[state.run].time;
        state.time = Math.min(Math.max(state.time, data[0]), data[data.length - 1]);
        for (const field of ["planned", "document", "run", "time"]) changed.add(field);
        state.version += 1;
    });
}

/** @param {State} state @param {import("./engine.js").Engine} engine @returns {Planned} */
function attempt(state, engine) {
    const { task, pace } = state, names = namesOf(task);
    try {
        const wrong = [...wrongWaits(task), ...wrongPace(task, pace, engine.limits)];
        if (wrong.length) throw new TaskError(wrong.map(({ text }) => text).join("; "));
        const stretches = stretchesOf(task), { force, speed } = engine.limits;
        for (const { path, first, last } of stretches) requireWay(engine, path, `${names[first]} to ${names[last]}`);
        const limits = { force: pace.force || force, speed: pace.speed || speed, power: pace.power || Infinity };
        const { durations, binding } = pace.fastest ? fastest(engine, task, stretches, limits)
            : { durations: durationsOf(task, stretches, pace.duration ?? easyDuration(task)), binding: [] };
        const plan = planned(task, stretches, durations);
        const ways = stretches.map(({ first, last }, k) => ({ from: names[first], to: names[last], duration: durations[k], binding: binding[k] ?? "" }));
        return { fault: "", plan, ways, milliseconds: 0 };
    } catch (error) {
        if (!(error instanceof TaskError)) throw error;
        return { fault: error.message, plan: null, ways: [], milliseconds: 0 };
    }
}

/** The duration of the way to each waypoint; null where none ends. @param {Task} task @param {Planned | null} found */
export function durationsTo(task, found) {
    let way = 0;
    return task.waypoints.map(({ blend }, k) => (k && !blend && found ? (found.ways[way++]?.duration ?? null) : null));
}

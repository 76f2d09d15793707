// Runs that the page makes of a robot: simulated under its motors, or recorded while somebody moves it.
import { Qr, largest, solvedSymmetric } from "./algebra.js";

/** @typedef {import("./robot_engine.js").RobotEngine} RobotEngine */
/** @typedef {import("./types").Run} Run */
/** @typedef {{time: number, q: Float64Array, v: Float64Array, tau: Float64Array, lambda: Float64Array}} Sample */
/** What motors do: nothing, or hold a pose by PD control with the forces that carry the weight there. */
/** @typedef {{kind: "off"} | {kind: "hold", goal: Float64Array, frequency: number, damping: number}} Control */

const STEP = 1e-3, SAMPLED = 4, PROJECTIONS = 4, CLOSED = 1e-12; // [s], steps between samples, Newton's steps, [m or rad]

/** The run ended, as nothing more can be computed; the message says why. */
class Ended extends Error {}

/**
 * Simulate a robot from rest by Runge and Kutta's method, each step back on the closed loops: one sample after
 * the other, the last one where it ends or a joint reaches a limit.
 * @param {RobotEngine} engine @param {Float64Array} start @param {number} duration [s] @param {Control} control
 * @returns {Generator<Sample, string, void>} why it ended early; empty where it did not
 */
export function* simulated(engine, start, duration, control) {
    const forces = controller(engine, start, control), steps = Math.max(1, Math.round(duration / STEP)), h = duration / steps;
    /** @type {[Float64Array, Float64Array]} */
    let [q, v] = [start, new Float64Array(engine.nv)];
    try {
        for (let step = 0; step <= steps; step++) {
            if (step % SAMPLED === 0 || step === steps) yield { time: step * h, q, v, ...known(engine, q, v, forces) };
            if (step === steps) break;
            const [then, speed] = next(engine, q, v, h, forces), out = engine.leaving(q, then);
            if (out) {
                [q, v] = next(engine, q, v, out.share * h, forces);
                if (out.share > 0 || step % SAMPLED) yield { time: (step + out.share) * h, q, v, ...known(engine, q, v, forces) };
                return out.text;
            }
            [q, v] = [then, speed];
        }
    } catch (error) {
        if (error instanceof Ended) return error.message;
        throw error;
    }
    return "";
}

/** @typedef {(q: ArrayLike<number>, v: ArrayLike<number>) => Float64Array} Forces */

/** Forces of the motors by the state. @param {RobotEngine} engine @param {Float64Array} start @param {Control} control @returns {Forces} */
function controller(engine, start, control) {
    const { motors, given } = engine, n = motors.length;
    if (control.kind === "off") return () => new Float64Array(n);
    const goal = engine.values(control.goal), { tau } = engine.holding(control.goal);
    const omega = 2 * Math.PI * control.frequency, inertia = felt(engine, start);
    return (q, v) => Float64Array.from(motors, (place, i) => {
        const off = goal[i] - engine.value(q, given.motors[i]);
        const circle = engine.document.scene.joints[given.motors[i]].kind === "continuous";
        const way = circle ? Math.atan2(Math.sin(off), Math.cos(off)) : off;
        const force = (Number.isFinite(tau[i]) ? tau[i] : 0) + inertia[i] * omega * (omega * way - 2 * control.damping * v[place]);
        const most = given.effort[i] ?? Infinity;
        return Math.min(Math.max(force, -most), most);
    });
}

/** The inertia that each motor moves, all others free [kg or kg m²]. @param {RobotEngine} engine @param {Float64Array} q */
function felt(engine, q) {
    const { nv, motors } = engine, at = engine.at(q), { N, free } = at, M = engine.mass(q);
    const H = new Float64Array(free * free), B = new Float64Array(free * motors.length);
    for (let c = 0; c < free; c++) {
        for (let d = 0; d < free; d++) for (let i = 0; i < nv; i++) for (let j = 0; j < nv; j++) H[c * free + d] += N[c * nv + i] * M[i * nv + j] * N[d * nv + j];
        motors.forEach((place, i) => void (B[i * free + c] = N[c * nv + place]));
    }
    const x = free ? solvedSymmetric(H, free, B) : B;
    if (!x) throw new Error("a free motion of the robot has no inertia");
    return motors.map((_, i) => {
        let give = 0;
        for (let c = 0; c < free; c++) give += B[i * free + c] * x[i * free + c];
        return give > 0 ? 1 / give : 0;
    });
}

/** @param {RobotEngine} engine @param {Float64Array} q @param {Float64Array} v @param {Forces} forces */
function known(engine, q, v, forces) {
    const found = engine.accelerated(engine.at(q), v, forces(q, v));
    if (!found) throw new Ended("a free motion of the robot has no inertia");
    return found;
}

/** One step of Runge and Kutta, and back onto the closed loops. */
/** @param {RobotEngine} engine @param {Float64Array} q @param {Float64Array} v @param {number} h @param {Forces} forces @returns {[Float64Array, Float64Array]} */
function next(engine, q, v, h, forces) {
    /** @param {Float64Array} at @param {Float64Array} speed */
    const rates = (at, speed) => ({ dq: engine.call("rate", engine.nq, at, speed).slice(), dv: known(engine, at, speed, forces).a });
    /** @param {ReturnType<typeof rates>} by @param {number} part @returns {[Float64Array, Float64Array]} */
    const shifted = (by, part) => [engine.normalised(q.map((x, k) => x + part * by.dq[k])), v.map((x, k) => x + part * by.dv[k])];
    const one = rates(q, v), two = rates(...shifted(one, h / 2)), three = rates(...shifted(two, h / 2)), four = rates(...shifted(three, h));
    /** @param {"dq" | "dv"} key @param {number} k */
    const mean = (key, k) => (h / 6) * (one[key][k] + 2 * two[key][k] + 2 * three[key][k] + four[key][k]);
    const moved = engine.normalised(q.map((x, k) => x + mean("dq", k))), speed = v.map((x, k) => x + mean("dv", k));
    if (!moved.every(Number.isFinite) || !speed.every(Number.isFinite)) throw new Ended("the motion grows beyond all numbers");
    return closed(engine, moved, speed);
}

/** The nearest closed configuration, and the velocity without what would open the loops. */
/** @param {RobotEngine} engine @param {Float64Array} q @param {Float64Array} v @returns {[Float64Array, Float64Array]} */
function closed(engine, q, v) {
    const { nv, rows } = engine;
    for (let round = 0; ; round++) {
        const { errors, J } = engine.closure(q), gap = largest(errors);
        const qr = new Qr(J, nv, rows, gap <= CLOSED ? 1e-9 : Math.max(1e-9, Math.min(1e-3, 100 * gap)));
        if (gap <= CLOSED || round === PROJECTIONS) {
            if (!(gap < 1e-6)) throw new Ended("the loops came open: the motion is near a singular pose");
            const opening = new Float64Array(rows);
            for (let i = 0; i < rows; i++) for (let j = 0; j < nv; j++) opening[i] += J[i * nv + j] * v[j];
            const less = qr.solveTransposed(opening);
            return [q, v.map((x, k) => x - less[k])];
        }
        q = engine.moved(q, qr.leastSquares(errors.map((x) => -x)));
    }
}

/**
 * Samples as a run: with the curves and arrows of the document's first run.
 * @param {RobotEngine} engine @param {string} name @param {Sample[]} samples @param {string[]} notes
 * @returns {Run}
 */
export function runOfSamples(engine, name, samples, notes) {
    const { document } = engine, [like] = document.runs, count = samples.length;
    const rows = samples.map(({ q, v, tau, lambda }) => {
        const { loads, sizes } = engine.transmitted(q, lambda);
        return { loads: { ...loads, ...engine.pushing() }, values: { ...engine.shown(q, v, tau, lambda), ...sizes } };
    });
    const q = { shape: [count, engine.nq], data: Float64Array.from(samples.flatMap((sample) => [...sample.q])) };
    const curves = like.curves.map((curve) => {
        const data = Float64Array.from(rows, ({ values }) => /** @type {Record<string, number>} */ (values)[curve.key] ?? NaN);
        return { ...curve, column: undefined, values: { shape: [count], data: curve.unit === "rad" ? unwrapped(data) : data } };
    });
    const vectors = [...like.loads.filter(({ group }) => group !== "wrench"), ...engine.pushes()];
    const loads = vectors.map((load) => load.curve ? load : {
        ...load, values: { shape: [count, 3], data: Float64Array.from(rows.flatMap(({ loads: each }) => /** @type {Record<string, number[]>} */ (each)[load.key] ?? [NaN, NaN, NaN])) },
    });
    return { name, time: { shape: [count], data: Float64Array.from(samples, ({ time }) => time) }, q, curves, loads, notes, computed: "kept" };
}

/** Angles without jumps of whole turns. @param {Float64Array} angles */
function unwrapped(angles) {
    for (let i = 1; i < angles.length; i++) {
        const jump = angles[i] - angles[i - 1];
        if (Math.abs(jump) > Math.PI && Math.abs(jump) < 3 * Math.PI) angles[i] -= 2 * Math.PI * Math.round(jump / (2 * Math.PI));
    }
    return angles;
}

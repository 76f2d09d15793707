// The shortest time of each way between two stops: its profile kept, its duration cut until a limit is met.
import { PROFILES } from "./paths.js";
import { moved, namesOf } from "./plan.js";
import { impossible, ownMargins, reasons, told } from "./workspace.js";
import { TaskError } from "./paths.js";

/** @typedef {import("./engine.js").Engine} Engine */
/** @typedef {import("./plan.js").Task} Task */
/** @typedef {import("./plan.js").Stretch} Stretch */
/** @typedef {{force: number, speed: number, power: number}} AxisLimits of each actuator [N, m/s, W]; Infinity: none */

const POINTS = 421, FINE = 2101; // the seven parts of the s-curve end at some of them
/** By how much a duration may be longer than the shortest one. */
const CLOSE = 1e-10;
const SLOWEST = 1e4;

/**
 * Durations of the ways within limits: that of the actuators' force, speed and power, and the sliders' travel.
 * A way whose stop has a duration keeps it.
 * @param {Engine} engine @param {Task} task @param {Stretch[]} stretches @param {AxisLimits} limits
 * @returns {{durations: number[], binding: string[]}} binding: what is met on each way
 */
export function fastest(engine, task, stretches, limits) {
    const names = namesOf(task), profile = PROFILES[task.profile];
    /** @type {string[]} */
    const binding = [];
    const durations = stretches.map(({ path, first, last }) => {
        const where = `${names[first]} to ${names[last]}`;
        requireWay(engine, path, where);
        const given = task.waypoints[last].duration;
        const wrench = wrenchesOf(task, path, first, profile);
        const coarse = new Way(engine, path, profile, POINTS, wrench), fine = new Way(engine, path, profile, FINE, wrench);
        requireStanding(coarse, limits, where);
        if (given !== null) {
            binding.push("given");
            return given;
        }
        const found = shortest((time) => coarse.shares(time, limits).most, 0, where);
        const checked = shortest((time) => fine.shares(time, limits).most, found, where);
        binding.push(fine.shares(checked, limits).what);
        return checked;
    });
    return { durations, binding };
}

/** What a way takes at points of it, whatever its duration. */
class Way {
    /**
     * @param {Engine} engine @param {import("./paths.js").Path} path @param {import("./paths.js").Profile} profile
     * @param {number} count @param {((share: number) => number[]) | null} wrench
     */
    constructor(engine, path, profile, count, wrench) {
        this.engine = engine;
        this.pose = new Float64Array(3 * count);
        this.velocity = new Float64Array(3 * count);
        this.acceleration = new Float64Array(3 * count);
        this.slow = new Float64Array(3 * count);
        this.still = new Float64Array(3 * count);
        this.wrench = wrench && new Float64Array(6 * count);
        for (let k = 0; k < count; ++k) {
            const share = k / (count - 1), [pose, velocity, acceleration] = moved(path, profile, share, 1);
            for (let i = 0; i < 3; ++i) {
                this.pose[3 * k + i] = pose[i];
                this.velocity[3 * k + i] = velocity[i];
                this.acceleration[3 * k + i] = acceleration[i];
            }
            if (this.wrench && wrench) this.wrench.set(wrench(share), 6 * k);
        }
    }

    /** The largest share of a limit that is used, and which. @param {number} duration @param {AxisLimits} limits */
    shares(duration, limits) {
        const { velocity, acceleration, slow, still } = this, square = duration * duration;
        for (let k = 0; k < slow.length; ++k) {
            slow[k] = velocity[k] / duration;
            still[k] = acceleration[k] / square;
        }
        const { forces, speeds, power } = this.engine.solve({
            pose: this.pose, velocity: slow, acceleration: still, wrench: this.wrench,
        });
        /** @type {[string, Float64Array, number][]} */
        const used = [["force", forces, limits.force], ["speed", speeds, limits.speed], ["power", power, limits.power]];
        let [most, at, what] = [0, 0, ""];
        for (const [name, values, limit] of used) {
            if (limit === Infinity) continue;
            for (let k = 0; k < values.length; ++k) {
                if (Number.isNaN(values[k])) return { most: Infinity, what: "reach" };
                const value = peakNear(values, k, name === "power") / limit;
                if (value > most) [most, at, what] = [value, k, name];
            }
        }
        return { most, what: `${what} of ${"ABC"[at % 3]}` };
    }
}

/** How large a curve is at a sample, or just beside it where it peaks between samples; of power what is given only. */
/** @param {Float64Array} values rows of three @param {number} k @param {boolean} given */
function peakNear(values, k, given) {
    const value = given || values[k] > 0 ? values[k] : -values[k], sign = value === values[k] ? 1 : -1;
    if (k < 3 || k + 3 >= values.length) return value;
    const before = sign * values[k - 3], after = sign * values[k + 3], bend = 2 * value - before - after;
    return value >= before && value >= after && bend > 0 ? value + (after - before) ** 2 / (8 * bend) : value;
}

/**
 * The shortest duration at which no share of a limit is above one, to a tiny part, and never below it.
 * @param {(time: number) => number} share @param {number} known none is shorter; 0: nothing is known @param {string} where
 */
function shortest(share, known, where) {
    /** How much is left or missing. @param {number} time */
    const over = (time) => share(time) - 1;
    let low = known || 1, below = over(low);
    if (known && below <= 0) return known;
    if (!known) while (below <= 0) below = over((low /= 2));
    let high = known ? low * (1 + 1e-6) : 2 * low, above = over(high);
    while (above > 0) {
        [low, below] = [high, above];
        high = known ? high + 4 * (high - known) : 2 * high;
        if (high > SLOWEST) throw new TaskError(`${where}: a limit is exceeded even very slowly: it allows no motion`);
        above = over(high);
    }
    for (let side = 0; high - low > CLOSE * high; ) { // regula falsi in 1 / time^2, in which forces are straight (Illinois)
        const [a, b] = [1 / low ** 2, 1 / high ** 2], straight = 1 / Math.sqrt((above * a - below * b) / (above - below));
        const middle = straight > low && straight < high ? straight : (low + high) / 2, value = over(middle);
        if (value > 0) [low, below, above, side] = [middle, value, side === 1 ? above / 2 : above, 1];
        else [high, above, below, side] = [middle, value, side === 2 ? below / 2 : below, 2];
        if (value === 0) break;
    }
    return high;
}

/** Throws where a way leaves what the machine can do however slowly. @param {Engine} engine @param {import("./paths.js").Path} path @param {string} where */
export function requireWay(engine, path, where) {
    for (let k = 0; k < POINTS; ++k) {
        const [pose] = path.at((path.end * k) / (POINTS - 1));
        const found = reasons(ownMargins(engine, pose));
        if (!found.length) continue;
        const what = impossible(found) ? "the path cannot be followed" : "the path leaves the limits";
        throw new TaskError(`${where}: ${what} ${Math.round((100 * k) / (POINTS - 1))} % along it: ${told(found[0])}`);
    }
}

/** @param {Way} way @param {AxisLimits} limits @param {string} where */
function requireStanding(way, limits, where) {
    const held = way.engine.holding(way.pose, way.wrench), count = held.length / 3 - 1;
    const worst = held.findIndex((force) => Math.abs(force) > limits.force);
    if (worst < 0) return;
    const [at, leg] = [Math.floor(worst / 3), "ABC"[worst % 3]];
    throw new TaskError(
        `${where}: ${leg} needs ${Math.abs(held[worst]).toFixed(1)} N to stand still ${Math.round((100 * at) / count)} % `
        + `along the path, more than ${limits.force} N`,
    );
}

/** The external load along a way, by share of its time. @param {Task} task @param {import("./paths.js").Path} path @param {number} first @param {import("./paths.js").Profile} profile */
function wrenchesOf(task, path, first, profile) {
    const loads = path.atWaypoints.slice(1).map((_, k) => task.waypoints[first + 1 + k].wrench ?? [0, 0, 0, 0, 0, 0]);
    if (!loads.some((row) => row.some((x) => x !== 0))) return null;
    return (/** @type {number} */ share) => {
        const place = path.end * profile(share)[0];
        const k = path.atWaypoints.findIndex((at, i) => i > 0 && place <= at);
        return loads[(k < 1 ? loads.length : k) - 1];
    };
}

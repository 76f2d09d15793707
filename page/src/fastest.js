// The shortest time of each way between two stops: its profile kept, its duration cut until a limit is met.
import { PROFILES } from "./paths.js";
import { moved, namesOf } from "./plan.js";
import { impossible, margins, reasons, told } from "./workspace.js";
import { TaskError } from "./paths.js";

/** @typedef {import("./engine.js").Engine} Engine */
/** @typedef {import("./plan.js").Task} Task */
/** @typedef {import("./plan.js").Stretch} Stretch */
/** @typedef {{force: number, speed: number, power: number}} AxisLimits of each actuator [N, m/s, W]; Infinity: none */

const POINTS = 401, FINE = 2001;
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
        const rows = Array.from({ length: count }, (_, k) => moved(path, profile, k / (count - 1), 1));
        this.pose = Float64Array.from(rows.flatMap(([pose]) => pose));
        this.velocity = Float64Array.from(rows.flatMap(([, velocity]) => velocity));
        this.acceleration = Float64Array.from(rows.flatMap(([, , acceleration]) => acceleration));
        this.wrench = wrench && Float64Array.from(rows.flatMap((_, k) => wrench(k / (count - 1))));
    }

    /** The largest share of a limit that is used, and which. @param {number} duration @param {AxisLimits} limits */
    shares(duration, limits) {
        const { forces, speeds, power } = this.engine.solve({
            pose: this.pose,
            velocity: this.velocity.map((x) => x / duration),
            acceleration: this.acceleration.map((x) => x / duration ** 2),
            wrench: this.wrench,
        });
        let [most, what] = [0, ""];
        for (let k = 0; k < forces.length; ++k) {
            const leg = "ABC"[k % 3];
            const force = Math.abs(forces[k]) / limits.force, speed = Math.abs(speeds[k]) / limits.speed;
            if (force > most) [most, what] = [force, `force of ${leg}`];
            if (speed > most) [most, what] = [speed, `speed of ${leg}`];
            if (power[k] / limits.power > most) [most, what] = [power[k] / limits.power, `power of ${leg}`];
            if (Number.isNaN(forces[k])) return { most: Infinity, what: "reach" };
        }
        return { most, what };
    }
}

/** The shortest duration at which no share is above one. @param {(time: number) => number} share @param {number} known at least */
function shortest(share, known, where = "") {
    let low = known, high = known || 1;
    if (known && share(known) <= 1) return known;
    while (share(high) > 1) {
        [low, high] = [high, known ? high * (1 + 2 * (high / known - 1) + 1e-9) : 2 * high];
        if (high > SLOWEST) throw new TaskError(`${where}: a limit is exceeded even very slowly: it leaves no room to move`);
    }
    while (low === 0 && share(high / 2) <= 1) high /= 2;
    low ||= high / 2;
    while (high - low > CLOSE * high) {
        const middle = (low + high) / 2;
        if (share(middle) <= 1) high = middle;
        else low = middle;
    }
    return high;
}

/** Throws where a way leaves what the machine can do however slowly. @param {Engine} engine @param {import("./paths.js").Path} path @param {string} where */
export function requireWay(engine, path, where) {
    for (let k = 0; k < POINTS; ++k) {
        const [pose] = path.at((path.end * k) / (POINTS - 1));
        const found = reasons(margins(engine, pose)).filter(({ kind }) => kind !== "force");
        if (!found.length) continue;
        const what = impossible(found) ? "the way cannot be made" : "the way leaves the limits";
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
        + `along the way, more than ${limits.force} N`,
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

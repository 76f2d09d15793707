// The machine's kinematics and dynamics in the page: generated C as WebAssembly, with the numbers of any machine.
import { bytesOf } from "./document.js";
import { JOINTS, NUMBERS, STEEL_SOLIDS, PLACES, changed } from "./machine.js";
import { RobotEngine } from "./robot_engine.js";
import { impossible, margins, reasons, told } from "./workspace.js";

/** @typedef {import("./machine.js").WhatIf} WhatIf */

/** What a status of a sample means. */
export const OK = 0, OUT_OF_REACH = 2, SINGULAR = 3;

/**
 * Samples, row after row: (y, z, theta) [m, rad] and what they change by; force and moment at P [N, N m].
 * @typedef {object} Samples
 * @property {ArrayLike<number>} pose
 * @property {ArrayLike<number>} [velocity]
 * @property {ArrayLike<number>} [acceleration]
 * @property {ArrayLike<number>|null} [wrench] of one row for all, or a row each
 */

/**
 * What samples take of the actuators, in the order A, B, C; NaN where a status is not 0.
 * @typedef {object} Solution
 * @property {Float64Array} forces
 * @property {Float64Array} sliders
 * @property {Float64Array} speeds
 * @property {Float64Array} power
 * @property {Uint8Array} status
 * @property {number} good
 */

const PAGE = 65536;
const ZEROS = [0, 0, 0];

/**
 * Load the engine of a document: the machine's or a robot's own; null where it has none.
 * @param {import("./types").Document} document
 * @param {string} wasm of the machine, base64
 * @param {import("./types").State} state
 * @returns {Promise<Engine | RobotEngine | null>}
 */
export async function load(document, wasm, state) {
    const { kind } = document.engine;
    if (kind !== "p3dof" && kind !== "loop") return null;
    if (typeof WebAssembly === "undefined") throw new Error("this browser has no WebAssembly");
    if (kind === "loop") {
        const module = /** @type {BufferSource} */ (document.engine.module.data);
        return new RobotEngine((await WebAssembly.instantiate(module, /** @type {any} */ ({ m: Math }))).instance, document, state);
    }
    const { instance } = await WebAssembly.instantiate(bytesOf(wasm, "engine"), {});
    return new Engine(instance, document.engine.parameters.data, document.engine.solids);
}

export class Engine {
    /** @type {any} */
    #exports;
    #heap = 0;
    #next = 0;

    /**
     * @param {WebAssembly.Instance} instance
     * @param {ArrayLike<number>} numbers
     * @param {import("./types").OfSolids} [solids]
     */
    constructor(instance, numbers, solids) {
        this.#exports = instance.exports;
        this.#heap = 16 * Math.ceil(this.#exports.__heap_base.value / 16);
        this.#exports.initialise();
        /** The machine of the document. */
        this.original = new Float64Array(NUMBERS);
        /** What its solids are made of. */
        this.solids = STEEL_SOLIDS;
        /** The machine that is computed with. @type {Float64Array} */
        this.numbers = this.original;
        /** @type {number[]|null} */
        this.wrench = null;
        /** What is changed of the document's machine. @type {WhatIf} */
        this.whatIf = {};
        /** How often the machine was changed: to know whether something was computed with the present one. */
        this.version = 0;
        this.take(numbers, solids);
    }

    /**
     * Changes the machine; throws a RangeError that says why it cannot be, and keeps the present one then.
     * @param {WhatIf} whatIf
     */
    set(whatIf) {
        const numbers = changed(this.original, whatIf, this.solids);
        this.#prepare(numbers);
        this.numbers = numbers;
        this.wrench = whatIf.wrench?.some((part) => part !== 0) ? [...whatIf.wrench] : null;
        this.whatIf = whatIf;
        ++this.version;
    }

    /** @param {Float64Array} numbers */
    #prepare(numbers) {
        const place = () => new Float64Array(this.#exports.memory.buffer, this.#exports.parameters(), NUMBERS);
        place().set(numbers);
        if (this.#exports.prepare() === OK) return;
        place().set(this.numbers);
        this.#exports.prepare();
        throw new RangeError("these numbers are not those of a machine");
    }

    /** Takes the machine of another document, unchanged. @param {ArrayLike<number>} numbers @param {import("./types").OfSolids} [solids] */
    take(numbers, solids = STEEL_SOLIDS) {
        if (numbers.length !== NUMBERS)
            throw new Error(`engine: expected ${NUMBERS} numbers of a machine, got ${numbers.length}`);
        if (this.solids === solids && this.original.every((value, k) => Object.is(value, numbers[k]))) return;
        this.solids = solids;
        this.original = Float64Array.from(numbers);
        this.set({});
    }

    /** Lengths [m]. */
    get lengths() {
        const [r, R, L, b] = this.numbers;
        return { r, R, L, b, h: Math.sqrt((L - (R - r)) * (L + (R - r))) };
    }

    /** Limits of the machine: travel [m], speed [m/s], force [N], tilt [rad]. */
    get limits() {
        const [low, high, speed, force, least, most] = this.numbers.subarray(PLACES.travel);
        return { travel: [low, high], speed, force, tilt: [least, most] };
    }

    /**
     * Returns what a motion takes of the actuators.
     * @param {Samples} samples
     * @returns {Solution}
     */
    solve({ pose, velocity, acceleration, wrench }) {
        const count = pose.length / 3;
        this.#begin(40 * count + 64);
        const at = this.#put(pose), still = velocity && acceleration ? 0 : this.#put(new Float64Array(3 * count));
        const moved = velocity ? this.#put(velocity) : still, sped = acceleration ? this.#put(acceleration) : still;
        const load = this.#load(wrench, count);
        const status = this.#room(count);
        const sliders = this.#called("inverse_kinematics", count, [at], 3, status);
        const slopes = this.#called("jacobian", count, [at], 9, status);
        const forces = this.#called("inverse_dynamics", count, [at, moved, sped, load], 3, status);
        const buffer = this.#exports.memory.buffer;
        const found = {
            forces: forces.slice(),
            sliders: sliders.slice(),
            speeds: new Float64Array(3 * count),
            power: new Float64Array(3 * count),
            status: new Uint8Array(buffer, status, count).slice(),
            good: 0,
        };
        const rate = new Float64Array(buffer, moved, 3 * count);
        for (let i = 0; i < count; ++i) {
            found.good += found.status[i] === OK ? 1 : 0;
            for (let leg = 0; leg < 3; ++leg) {
                const k = 3 * i + leg, j = 9 * i + 3 * leg;
                found.speeds[k] = slopes[j] * rate[3 * i] + slopes[j + 1] * rate[3 * i + 1] + slopes[j + 2] * rate[3 * i + 2];
                found.power[k] = found.forces[k] * found.speeds[k];
            }
        }
        return found;
    }

    /**
     * Returns the forces that hold poses at rest, with the external wrench of what is changed.
     * @param {ArrayLike<number>} pose
     * @param {ArrayLike<number>|null} [wrench]
     * @returns {Float64Array}
     */
    holding(pose, wrench) {
        const count = pose.length / 3;
        this.#begin(16 * count + 64);
        const at = this.#put(pose), still = this.#put(new Float64Array(3 * count)), load = this.#load(wrench, count);
        return this.#called("inverse_dynamics", count, [at, still, still, load], 3, this.#room(count)).slice();
    }

    /** Returns the sliders [m] at poses. @param {ArrayLike<number>} pose */
    sliders(pose) {
        return this.#simple("inverse_kinematics", pose, 3);
    }

    /** Returns what sliders change by, by y, z and theta: rows of 9 numbers. @param {ArrayLike<number>} pose */
    jacobian(pose) {
        return this.#simple("jacobian", pose, 9);
    }

    /** Returns the mass matrix in y, z and theta: rows of 9 numbers. @param {ArrayLike<number>} pose */
    massMatrix(pose) {
        return this.#simple("mass_matrix", pose, 9);
    }

    /** Returns the poses at which sliders stand, of the working mode. @param {ArrayLike<number>} sliders */
    poses(sliders) {
        return this.#simple("forward_kinematics", sliders, 3);
    }

    /**
     * Returns the accelerations that forces give.
     * @param {{pose: ArrayLike<number>, velocity: ArrayLike<number>, forces: ArrayLike<number>, wrench?: ArrayLike<number>|null}} samples
     */
    accelerations({ pose, velocity, forces, wrench }) {
        const count = pose.length / 3;
        this.#begin(20 * count + 64);
        const given = [pose, velocity, forces].map((rows) => this.#put(rows));
        const load = this.#load(wrench, count);
        return this.#called("forward_dynamics", count, [...given, load], 3, this.#room(count)).slice();
    }

    /**
     * Returns the accelerations of the sliders [m/s^2].
     * @param {{pose: ArrayLike<number>, velocity: ArrayLike<number>, acceleration: ArrayLike<number>}} samples
     */
    sliderAccelerations({ pose, velocity, acceleration }) {
        const { r, R, L } = this.lengths, found = new Float64Array(pose.length);
        for (let k = 0; k < pose.length; k += 3) {
            const [y, theta, dy, turn] = [pose[k], pose[k + 2], velocity[k], velocity[k + 2]];
            const [ddy, ddz, turned] = [acceleration[k], acceleration[k + 1], acceleration[k + 2]];
            const cos = Math.cos(theta), sin = Math.sin(theta), across = R - r * cos, rate = r * sin * turn;
            const change = r * (cos * turn * turn + sin * turned);
            found[k] = ddz + dropped(L, R - r + y, dy, ddy);
            found[k + 1] = ddz + dropped(L, R - r - y, -dy, -ddy);
            const square = (L - y) * (L + y) - across * across;
            const first = -2 * (y * dy + across * rate), second = -2 * (dy * dy + y * ddy + rate * rate + across * change);
            found[k + 2] = ddz + r * (cos * turned - sin * turn * turn) + root(square, first, second);
        }
        return found;
    }

    /**
     * Returns what a document's joints and curves are while the platform is held at rest in a pose.
     * @param {import("./types").Hand} hand
     * @param {{document: import("./types").Document, solved: import("./types").Run | null, run: number, case: string}} state
     */
    held(hand, { document, solved, run, case: part }) {
        const pose = "pose" in hand ? hand.pose : null;
        if (!pose) return {};
        const force = this.holding(pose), slider = this.sliders(pose);
        const rest = part === "dynamic" ? force.map((x) => 0 * x) : force;
        const { curves } = solved ?? document.runs[run];
        const known = { force: rest, static: force, slider, speed: ZEROS, acceleration: ZEROS, power: ZEROS };
        const values = /** @type {Record<string, number>} */ ({ power_total: 0, y: pose[0], z: pose[1], theta: pose[2] });
        for (const [key, row] of Object.entries(known)) ["a", "b", "c"].forEach((leg, k) => (values[`${key}_${leg}`] = row[k]));
        for (const { key } of curves) if (/^(y|z|theta)_d+ot$/.test(key)) values[key] = 0;
        return { q: this.configurations(document, pose), values, pose };
    }

    /**
     * Returns why the platform cannot be in a pose, and the legs to blame; null where it can.
     * @param {ArrayLike<number>} pose
     */
    why(pose) {
        const found = reasons(margins(this, pose));
        if (!impossible(found)) return null;
        const legs = found.flatMap(({ leg }) => (leg < 0 ? [] : ["abc"[leg]]));
        return { text: `The platform cannot go there: ${found.map(told).join(", ")}.`, legs };
    }

    /**
     * Returns the configurations of a document's tree at poses, row after row.
     * @param {import("./types").Document} document @param {ArrayLike<number>} pose
     */
    configurations({ scene }, pose) {
        const found = this.joints(pose), count = pose.length / 3;
        const places = scene.joints.map(({ name, q }) => [JOINTS.indexOf(name), q ? q[0] : -1]);
        const width = scene.joints.reduce((most, { q }) => (q ? Math.max(most, q[0] + q[1]) : most), 0);
        const rows = new Float64Array(width * count);
        for (const [from, to] of places) {
            if (from < 0 || to < 0) continue;
            for (let i = 0; i < count; ++i) rows[width * i + to] = found[JOINTS.length * i + from];
        }
        return rows;
    }

    /**
     * Returns the configuration of the tree at poses, in the order of `JOINTS` [m, rad].
     * @param {ArrayLike<number>} pose
     * @returns {Float64Array}
     */
    joints(pose) {
        return this.#simple("joints", pose, JOINTS.length);
    }

    /** @param {string} name @param {ArrayLike<number>} rows @param {number} size */
    #simple(name, rows, size) {
        const count = rows.length / 3;
        this.#begin((4 + size) * count + 64);
        return this.#called(name, count, [this.#put(rows)], size, this.#room(count)).slice();
    }

    /** Makes room for so many numbers. @param {number} count */
    #begin(count) {
        const missing = this.#heap + 8 * count - this.#exports.memory.buffer.byteLength;
        if (missing > 0) this.#exports.memory.grow(Math.ceil(missing / PAGE));
        this.#next = this.#heap;
    }

    /** @param {number} bytes */
    #room(bytes) {
        const place = this.#next;
        this.#next += 8 * Math.ceil(bytes / 8);
        return place;
    }

    /** @param {ArrayLike<number>} rows */
    #put(rows) {
        const place = this.#room(8 * rows.length);
        new Float64Array(this.#exports.memory.buffer, place, rows.length).set(rows);
        return place;
    }

    /**
     * Puts the external wrench of samples and the one of what is changed together; 0 without any.
     * @param {ArrayLike<number>|null|undefined} wrench
     * @param {number} count
     */
    #load(wrench, count) {
        if (!wrench && !this.wrench) return 0;
        const rows = new Float64Array(6 * count), own = this.wrench ?? [0, 0, 0, 0, 0, 0];
        for (let k = 0; k < rows.length; ++k) rows[k] = own[k % 6] + (wrench ? wrench[wrench.length === 6 ? k % 6 : k] : 0);
        return this.#put(rows);
    }

    /**
     * Calls a function on rows; what it does not know stays NaN.
     * @param {string} name
     * @param {number} count
     * @param {number[]} given
     * @param {number} size
     * @param {number} status
     */
    #called(name, count, given, size, status) {
        const place = this.#room(8 * size * count);
        const rows = new Float64Array(this.#exports.memory.buffer, place, size * count).fill(NaN);
        this.#exports[name](count, ...given, place, status);
        return rows;
    }
}

/** The second derivative of the drop of a leg, by its horizontal extent and its rates. */
/** @param {number} L @param {number} extent @param {number} rate @param {number} change */
const dropped = (L, extent, rate, change) =>
    root((L - extent) * (L + extent), -2 * extent * rate, -2 * (rate * rate + extent * change));

/** The second derivative of a root. @param {number} square @param {number} first @param {number} second */
const root = (square, first, second) => second / (2 * Math.sqrt(square)) - (first * first) / (4 * square ** 1.5);

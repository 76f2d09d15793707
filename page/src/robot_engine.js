// A robot's dynamics in the page: its traced functions as WebAssembly, and the linear algebra of its closed loops.
import { Qr, largest, solvedSymmetric } from "./algebra.js";
import { instant, treeOf } from "./instant.js";
import { directionOf, pointOf } from "./tree.js";

/** @typedef {import("./types").State} State */
/** @typedef {import("./types").LoopEngine} Given */

/** As of the general layer: rank of closed loops; accuracy of an equation of motion; share of an open change. */
const RANK = 1e-9, OPEN = 1e-3, ACCURACY = 1e-9, UNIQUE = 1e-7, NEAR_SINGULAR = 1e-6;
/** Newton's steps along a path, as of the general layer [m or rad]. */
const FIRST_STEP = 0.3, CONTRACTION = 0.25, NEGLIGIBLE = 1e-9, ON_THE_WAY = 1e-8, CLOSED = 1e-12, SHORTEST = 2 ** -22, MOST = 2000;
/** Forces smaller than this share of a robot's weight are none. */
const ROUNDING = 1e-12;
/** How much work a path may be, and the fewest steps: who drags a large robot cannot wait. */
const WORK = 4e7, FEWEST = 200;
const GREY = "#5f6b76";
const SMALLEST = "Other actuator forces would do too: the smallest are shown.";

/**
 * What a robot is at a configuration: how far its loops are open, and what their Jacobian allows.
 * @typedef {{q: Float64Array, errors: Float64Array, J: Float64Array, qr: Qr, N: Float64Array, free: number}} At
 */

/** @type {Map<number, number>} by joint [kg] */
const NONE = new Map();

export class RobotEngine {
    kind = "loop";
    /** What is changed of the robot, by joint; gravity and wrenches on bodies in world axes. */
    changes = { gravity: /** @type {number[] | null} */ (null), mass: NONE, payload: NONE, wrench: /** @type {Map<number, number[]>} */ (new Map()) };
    /** How often it was changed. */
    version = 0;

    /**
     * @param {WebAssembly.Instance} instance @param {import("./types").Document} document @param {State} state
     */
    constructor(instance, document, state) {
        const given = /** @type {Given} */ (document.engine);
        this.given = given;
        this.state = state;
        this.document = document;
        this.tree = treeOf(document.scene);
        this.exports = /** @type {any} */ (instance.exports);
        this.memory = new Float64Array(this.exports.memory.buffer);
        this.nq = given.nq;
        this.nv = given.nv;
        /** @type {number[]} */
        this.gravity = given.gravity;
        this.rows = given.rows.reduce((sum, count) => sum + count, 0);
        this.starts = given.rows.map((_, i) => given.rows.slice(0, i).reduce((sum, count) => sum + count, 0));
        this.motors = given.motors.map((joint) => given.v[joint][0]);
        this.original = Float64Array.from(given.inertias.data);
        this.inertias = this.original;
        this.weight = 0;
        /** @type {{hand: object, held: any} | null} */
        this.latest = null;
        this.units = document.scene.joints.flatMap(({ kind, q }) => {
            const [skip, count] = { continuous: [0, 2], planar: [2, 2], spherical: [0, 4], free: [3, 4] }[/** @type {string} */ (kind)] ?? [0, 0];
            return count && q ? [[q[0] + skip, count]] : [];
        });
        this.take();
        this.agreement = this.check();
    }

    /** Take what is changed into account. */
    take() {
        const { gravity, mass, payload } = this.changes;
        this.gravity = gravity ?? this.given.gravity;
        this.inertias = Float64Array.from(this.original);
        for (const [joint, value] of mass) {
            const own = this.inertias.subarray(10 * joint, 10 * joint + 10), part = value / own[0];
            if (own[0] > 0) for (let k = 0; k < 10; k++) own[k] *= part;
        }
        for (const [joint, value] of payload) this.load(joint, value, this.centre(joint));
        this.weight = Math.hypot(...this.gravity) * this.given.v.reduce((sum, _, i) => sum + this.inertias[10 * i], 0);
        this.version += 1;
        this.latest = null;
    }

    /** Change something of the robot, and hold it where it is. @param {Partial<RobotEngine["changes"]>} changes */
    change(changes) {
        Object.assign(this.changes, changes);
        this.take();
        this.state.set({ hand: { q: Array.from(instant(this.state).q) }, playing: false });
    }

    /** As in the file. */
    reset() {
        this.change({ gravity: null, mass: new Map(), payload: new Map(), wrench: new Map() });
    }

    /** Whether anything is changed. */
    get changed() {
        const { gravity, mass, payload, wrench } = this.changes;
        return Boolean(gravity) || mass.size + payload.size + wrench.size > 0;
    }

    /** The link that a joint moves. @param {number} joint */
    body(joint) {
        const { body, name } = this.document.scene.joints[joint];
        return body ?? name;
    }

    /** Mass centre of a body in its joint's axes [m]. @param {number} joint */
    centre(joint) {
        const own = this.original.subarray(10 * joint, 10 * joint + 4);
        return own[0] > 0 ? [own[1] / own[0], own[2] / own[0], own[3] / own[0]] : [0, 0, 0];
    }

    /** Add a point mass to a body. @param {number} joint @param {number} mass @param {number[]} at */
    load(joint, mass, [x, y, z]) {
        const more = [1, x, y, z, y * y + z * z, -x * y, x * x + z * z, -x * z, -y * z, x * x + y * y];
        more.forEach((part, k) => void (this.inertias[10 * joint + k] += mass * part));
    }

    /**
     * Call a function; what is returned is overwritten by the next call.
     * @param {string} name @param {number} size how many numbers it returns @param {...ArrayLike<number>} given
     */
    call(name, size, ...given) {
        let at = 0;
        for (const numbers of given) {
            this.memory.set(numbers, at);
            at += numbers.length;
        }
        this.exports[name](0, 8 * at);
        return this.memory.subarray(at, at + size);
    }

    /** Errors of the closures and their Jacobian, its rows one after the other. @param {ArrayLike<number>} q */
    closure(q) {
        const { rows, nv } = this, entries = this.given.entries.data, count = entries.length / 2;
        const found = this.call("closure", rows + count, q), J = new Float64Array(rows * nv);
        for (let k = 0; k < count; k++) J[entries[2 * k] * nv + entries[2 * k + 1]] = found[rows + k];
        return { errors: found.slice(0, rows), J };
    }

    /** @param {Float64Array} q @returns {At} */
    at(q) {
        const { errors, J } = this.closure(q), qr = new Qr(J, this.nv, this.rows, RANK);
        return { q, errors, J, qr, N: qr.nullSpace(), free: this.nv - qr.rank };
    }

    /** What acts on the bodies from outside, at joints' origins in world axes. @param {ArrayLike<number>} q */
    wrenches(q) {
        const found = new Float64Array(6 * this.given.v.length);
        const { external } = this.given, { wrench } = this.changes;
        if (!external.length && !wrench.size) return found;
        const placements = this.tree.place(q);
        /** @param {number} joint @param {number[]} point @param {number[]} w */
        const add = (joint, point, w) => {
            if (joint < 0) return;
            const [rx, ry, rz] = directionOf(placements, joint, point);
            const moment = [ry * w[2] - rz * w[1], rz * w[0] - rx * w[2], rx * w[1] - ry * w[0]];
            for (let k = 0; k < 3; k++) {
                found[6 * joint + k] += w[k];
                found[6 * joint + 3 + k] += w[3 + k] + moment[k];
            }
        };
        external.forEach(({ joint, point, wrench: w }) => add(joint, point, w));
        for (const [joint, w] of wrench) add(joint, this.centre(joint), w);
        return found;
    }

    /** Forces of the tree, and the acceleration at the closures without any of the joints. */
    /** @param {ArrayLike<number>} q @param {ArrayLike<number>} v @param {ArrayLike<number>} a @param {ArrayLike<number>} [wrenches] */
    terms(q, v, a, wrenches = this.wrenches(q)) {
        const found = this.call("terms", this.nv + this.rows, q, v, a, this.gravity, this.inertias, wrenches);
        return { forces: found.slice(0, this.nv), drift: found.slice(this.nv) };
    }

    /** The mass matrix. @param {ArrayLike<number>} q */
    mass(q) {
        const { nv } = this, places = this.given.mass.data, count = places.length / 2;
        const found = this.call("mass", count, q, this.inertias), M = new Float64Array(nv * nv);
        for (let k = 0; k < count; k++) {
            const [i, j] = [places[2 * k], places[2 * k + 1]];
            M[i * nv + j] = M[j * nv + i] = found[k];
        }
        return M;
    }

    /** q moved by a small step. @param {ArrayLike<number>} q @param {ArrayLike<number>} step */
    moved(q, step) {
        const rate = this.call("rate", this.nq, q, step), found = new Float64Array(this.nq);
        for (let k = 0; k < this.nq; k++) found[k] = q[k] + rate[k];
        return this.normalised(found);
    }

    /** q with circles and quaternions of length one, in its place. @param {Float64Array} q */
    normalised(q) {
        for (const [at, count] of this.units) {
            let square = 0;
            for (let k = at; k < at + count; k++) square += q[k] ** 2;
            for (let k = at; k < at + count; k++) q[k] /= Math.sqrt(square);
        }
        return q;
    }

    /** The values of the actuated joints [m or rad]. @param {ArrayLike<number>} q */
    values(q) {
        return this.given.motors.map((joint) => this.value(q, joint));
    }

    /** @param {ArrayLike<number>} q @param {number} joint */
    value(q, joint) {
        const [at, count] = this.document.scene.joints[joint].q ?? [0, 1];
        return count === 2 ? Math.atan2(q[at + 1], q[at]) : q[at];
    }

    // --- Where it is -------------------------------------------------------------------------------------------

    /**
     * The residual of closures and of actuated joints at targets, as one matrix in columns.
     * @param {Float64Array} q @param {[number, number][]} targets motor, value
     */
    point(q, targets) {
        const { nv, rows } = this, { errors, J } = this.closure(q), count = rows + targets.length;
        const r = new Float64Array(count), A = new Float64Array(nv * count);
        r.set(errors);
        A.set(J);
        targets.forEach(([motor, value], k) => {
            const off = this.value(q, this.given.motors[motor]) - value;
            const circle = this.document.scene.joints[this.given.motors[motor]].kind === "continuous";
            r[rows + k] = circle ? Math.atan2(Math.sin(off), Math.cos(off)) : off;
            A[(rows + k) * nv + this.motors[motor]] = 1;
        });
        const gap = largest(errors), tolerance = gap <= CLOSED ? RANK : Math.max(RANK, Math.min(OPEN, 100 * gap));
        return { q, r, A, count, tolerance };
    }

    /**
     * Drive closures and actuated joints to targets along a path that never leaves its assembly.
     * @param {Float64Array} q @param {[number, number][]} targets
     */
    follow(q, targets) {
        let point = this.point(q, targets), s = 0, step = 1, count = 0;
        const start = point.r, most = Math.min(MOST, Math.max(FEWEST, WORK / (this.nv ** 2 * point.count)));
        while (s < 1) {
            const end = Math.min(s + step, 1);
            const [arrived, steps] = this.correct(point, start.map((x) => (1 - end) * x), end === 1, targets);
            count += steps;
            const qr = arrived && new Qr(point.A, this.nv, point.count, point.tolerance);
            if (arrived && qr?.sameOrientation(arrived.A)) {
                point = arrived;
                [s, step] = [end, 2 * step];
            } else if (step > SHORTEST && count < most) step = Math.min(step, 1 - s) / 2;
            else return { q: point.q, complete: false, part: s };
        }
        return { q: point.q, complete: true, part: 1 };
    }

    /**
     * Newton's method for a residual; null unless it contracts from the first step on.
     * @param {ReturnType<RobotEngine["point"]>} start @param {Float64Array} goal @param {boolean} last @param {[number, number][]} targets
     * @returns {[ReturnType<RobotEngine["point"]> | null, number]}
     */
    correct(start, goal, last, targets) {
        const enough = last ? NEGLIGIBLE : ON_THE_WAY;
        let error = last ? CLOSED : ON_THE_WAY, point = start, limit = FIRST_STEP;
        for (let count = 1; count <= 10; count++) {
            const qr = new Qr(point.A, this.nv, point.count, point.tolerance);
            const step = qr.leastSquares(point.r.map((x, k) => goal[k] - x)), size = largest(step);
            if (!(size <= Math.max(limit, enough))) return [null, count];
            point = this.point(this.moved(point.q, step), targets);
            if (size <= enough) {
                error = Math.max(error, 16 * 2 ** -52 * largest(point.q));
                return [largest(point.r.map((x, k) => x - goal[k])) <= error ? point : null, count];
            }
            limit = CONTRACTION * size;
        }
        return [null, 10];
    }

    /** Move to values of the actuated joints; where there are more than freedoms, the others follow. */
    /** @param {{inputs?: Record<string, number>, pose?: number[]}} goal */
    move({ inputs = {} }) {
        const q = Float64Array.from(instant(this.state).q), now = this.values(q);
        const redundant = this.motors.length > this.at(q).free;
        /** @type {[number, number][]} */
        const targets = [];
        this.document.inputs.forEach(({ key }, motor) => {
            const value = inputs[key] ?? now[motor];
            if (!redundant || Math.abs(value - now[motor]) > CLOSED) targets.push([motor, value]);
        });
        const found = this.follow(q, targets), out = found.complete ? this.leaving(q, found.q) : null;
        if (found.complete && !out) return this.hold(found.q);
        const text = out ? `The robot cannot go there: ${out.text}`
            : `The loops do not close there: they end after ${Math.floor(100 * found.part)} % of the way`;
        this.state.set({ refused: { text, legs: [] }, playing: false });
    }

    /** Hold the robot at a configuration. @param {Float64Array} q */
    hold(q) {
        this.state.set({ hand: { q: Array.from(q) }, playing: false });
    }

    /** The Jacobian of a point of a body: three rows (nv) [m or rad]. */
    /** @param {Float64Array} placements @param {number} joint @param {number[]} point in the joint's axes */
    pointJacobian(placements, joint, point) {
        const { joints } = this.document.scene, { nv } = this, found = new Float64Array(3 * nv);
        const at = pointOf(placements, joint, point);
        for (let j = joint; j >= 0; j = joints[j].parent) {
            const origin = [12, 13, 14].map((k) => placements[16 * j + k]);
            const [x, y, z] = at.map((value, k) => value - origin[k]), first = this.given.v[j][0];
            motionsOf(joints[j]).forEach(({ along, about, turned }, k) => {
                const slide = directionOf(placements, j, along);
                const turn = turned ? this.outer(placements, j, about) : directionOf(placements, j, about);
                found[first + k] = slide[0] + turn[1] * z - turn[2] * y;
                found[nv + first + k] = slide[1] + turn[2] * x - turn[0] * z;
                found[2 * nv + first + k] = slide[2] + turn[0] * y - turn[1] * x;
            });
        }
        return found;
    }

    /** The first axis of a universal joint in the world: fixed in the body before. */
    /** @param {Float64Array} placements @param {number} joint @param {number[]} axis */
    outer(placements, joint, axis) {
        const { parent, placement: [, , , x, y, z, w] } = this.document.scene.joints[joint];
        const [a, b, c] = axis, [tx, ty, tz] = [2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)];
        return directionOf(placements, parent, [a + w * tx + y * tz - z * ty, b + w * ty + z * tx - x * tz, c + w * tz + x * ty - y * tx]);
    }

    /**
     * Pull a point of a body towards a place, or the line through it, as near as it comes with closed loops;
     * joints keep their limits.
     * @param {number} joint @param {number[]} point in the joint's axes @param {number[]} goal in the world @param {number[]} [along] of length one
     */
    pull(joint, point, goal, along = [0, 0, 0]) {
        /** @type {Float64Array} */
        let q = Float64Array.from(instant(this.state).q);
        let off = this.off(q, joint, point, goal, along), part = 1;
        const first = off.distance;
        for (let round = 0; round < 8 && off.distance > 1e-9 && part > 1e-3; round++) {
            const step = this.towards(q, joint, off);
            const most = largest(step);
            const scaled = step.map((x) => (x * part * Math.min(1, FIRST_STEP / Math.max(most, 1e-300))) || 0);
            const found = this.follow(this.moved(q, scaled), []);
            const next = found.complete ? this.off(found.q, joint, point, goal, along) : null;
            if (next && next.distance < off.distance && !this.leaving(q, found.q)) [q, off, part] = [found.q, next, Math.min(1, 2 * part)];
            else part /= 4;
        }
        if (off.distance < first) this.hold(q);
        else if (!this.state.hand) this.hold(q);
    }

    /** How far a point of a body is from a line. */
    /** @param {Float64Array} q @param {number} joint @param {number[]} point @param {number[]} goal @param {number[]} along */
    off(q, joint, point, goal, along) {
        const placements = this.tree.place(q), at = pointOf(placements, joint, point);
        const way = across(goal.map((x, k) => x - at[k]), along);
        return { placements, point, way, along, distance: Math.hypot(...way) };
    }

    /** The step of damped least squares in the free motions. @param {Float64Array} q @param {number} joint @param {ReturnType<RobotEngine["off"]>} off */
    towards(q, joint, off) {
        const { nv } = this, { N, free } = this.at(q), P = this.pointJacobian(off.placements, joint, off.point);
        const B = new Float64Array(3 * free), square = new Float64Array(9);
        for (let k = 0; k < free; k++) {
            const rate = [0, 0, 0];
            for (let i = 0; i < 3; i++) for (let j = 0; j < nv; j++) rate[i] += P[i * nv + j] * N[k * nv + j];
            B.set(across(rate, off.along), 3 * k);
        }
        for (let i = 0; i < 3; i++) for (let j = 0; j < 3; j++) for (let k = 0; k < free; k++) square[3 * j + i] += B[3 * k + i] * B[3 * k + j];
        const most = Math.max(square[0], square[4], square[8], 1e-300);
        for (const i of [0, 4, 8]) square[i] += 1e-6 * most;
        const y = /** @type {Float64Array} */ (solvedSymmetric(square, 3, off.way)), step = new Float64Array(nv);
        for (let k = 0; k < free; k++) {
            const by = B[3 * k] * y[0] + B[3 * k + 1] * y[1] + B[3 * k + 2] * y[2];
            for (let j = 0; j < nv; j++) step[j] += by * N[k * nv + j];
        }
        return step;
    }

    /**
     * The joint that leaves its limits on the way between two configurations, and at which share of it; null where
     * none does, or goes on doing so.
     * @param {ArrayLike<number>} from @param {ArrayLike<number>} to
     */
    leaving(from, to) {
        let [first, share, words] = [-1, 1, ""];
        this.given.limits.forEach(([low, high], i) => {
            if (low === null && high === null) return;
            const [a, b] = [from, to].map((q) => this.value(q, i));
            for (const [end, past, word] of /** @type {const} */ ([[low, -1, "lower"], [high, 1, "upper"]])) {
                if (end === null || !(past * (b - end) > 0) || past * (a - end) > 0) continue;
                const part = b === a ? 0 : (end - a) / (b - a);
                if (part <= share) [first, share, words] = [i, part, word];
            }
        });
        return first < 0 ? null : { share, text: `the joint ${this.document.scene.joints[first].name} is at its ${words} limit` };
    }

    // --- Forces ------------------------------------------------------------------------------------------------

    /**
     * The shortest forces of the actuators that give Nᵀ f, and what is missing then.
     * @param {At} at @param {ArrayLike<number>} forces of the tree
     */
    actuators({ N, free }, forces) {
        const { motors, nv } = this, n = motors.length, B = new Float64Array(n * free), wanted = new Float64Array(free);
        for (let k = 0; k < free; k++) {
            motors.forEach((place, i) => void (B[k * n + i] = N[k * nv + place]));
            for (let j = 0; j < nv; j++) wanted[k] += N[k * nv + j] * forces[j];
        }
        const qr = new Qr(B, n, free, RANK, 1), tau = qr.solveTransposed(wanted);
        let missing = 0;
        for (let k = 0; k < free; k++) {
            let value = wanted[k];
            for (let i = 0; i < n; i++) value -= B[k * n + i] * tau[i];
            missing = Math.max(missing, Math.abs(value));
        }
        const least = qr.rank < Math.min(n, free) ? 0 : Math.abs(qr.diagonal[qr.rank - 1] ?? 1);
        return { tau, rank: qr.rank, missing, least, rounding: 100 * 2 ** -52 * largest(tau) };
    }

    /**
     * What holds the robot at a configuration: NaN where it is not determined, and why.
     * @param {Float64Array} q
     */
    holding(q) {
        const at = this.at(q), still = new Float64Array(this.nv), { forces } = this.terms(q, still, still);
        const n = this.motors.length, unknown = { tau: new Float64Array(n).fill(NaN), lambda: new Float64Array(this.rows).fill(NaN) };
        if (!n) return { ...(this.accelerated(at, still, []) ?? unknown), note: "" };
        const found = this.actuators(at, forces);
        const fits = found.missing - found.rounding <= ACCURACY * largest(forces);
        if (at.free <= n && (found.rank < at.free || (!fits && found.least < NEAR_SINGULAR))) {
            return { ...unknown, note: `The actuators cannot hold the robot here: they resist ${found.rank} of its ${at.free} free motions` };
        }
        if (!fits) {
            const lost = Number(found.missing.toPrecision(3));
            const note = `A force is needed that no actuator gives: ${lost} N or N m is missing (${n} actuators, ${at.free} free motions)`;
            return (this.nv - (this.given.rank ?? at.qr.rank) > n && this.hanging(at, forces)) || { ...unknown, note };
        }
        return { tau: found.tau, lambda: this.multipliers(at, forces, found.tau), note: found.rank < n ? SMALLEST : "" };
    }

    /** What keeps the actuated joints where they are, while passive freedoms move. @param {At} at @param {Float64Array} forces */
    hanging(at, forces) {
        const { nv, motors } = this, n = motors.length, { N, free } = at;
        const S = new Float64Array(n * free);
        for (let k = 0; k < free; k++) motors.forEach((place, i) => void (S[i * free + k] = N[k * nv + place]));
        const qr = new Qr(S, free, n, RANK, 1), Z = qr.nullSpace(), left = free - qr.rank;
        if (qr.rank < n || !left) return null;
        const W = new Float64Array(nv * left);
        for (let c = 0; c < left; c++) for (let k = 0; k < free; k++) for (let j = 0; j < nv; j++) W[c * nv + j] += N[k * nv + j] * Z[c * free + k];
        const a = this.free(at.q, W, left, forces.map((x) => -x));
        if (!a) return null;
        const needed = this.plus(forces, at.q, a), found = this.actuators(at, needed);
        if (!(found.missing - found.rounding <= ACCURACY * largest(needed))) return null;
        return { tau: found.tau, lambda: this.multipliers(at, needed, found.tau), note: "" };
    }

    /** The acceleration along some motions that forces give; null where one of them has no inertia. */
    /** @param {ArrayLike<number>} q @param {Float64Array} W motions, its columns @param {number} count @param {ArrayLike<number>} forces */
    free(q, W, count, forces) {
        const { nv } = this, M = this.mass(q), MW = new Float64Array(nv * count), H = new Float64Array(count * count);
        const right = new Float64Array(count);
        for (let c = 0; c < count; c++) {
            for (let i = 0; i < nv; i++) {
                const x = W[c * nv + i];
                if (x !== 0) for (let j = 0; j < nv; j++) MW[c * nv + j] += M[i * nv + j] * x;
                right[c] += x * forces[i];
            }
        }
        for (let c = 0; c < count; c++) {
            for (let d = c; d < count; d++) {
                let value = 0;
                for (let i = 0; i < nv; i++) value += W[d * nv + i] * MW[c * nv + i];
                H[c * count + d] = H[d * count + c] = value;
            }
        }
        const y = solvedSymmetric(H, count, right);
        if (!y) return null;
        const a = new Float64Array(nv);
        for (let c = 0; c < count; c++) for (let i = 0; i < nv; i++) a[i] += y[c] * W[c * nv + i];
        return a;
    }

    /** Forces f + M a. @param {ArrayLike<number>} forces @param {ArrayLike<number>} q @param {ArrayLike<number>} a */
    plus(forces, q, a) {
        const { nv } = this, M = this.mass(q), found = Float64Array.from(forces);
        for (let i = 0; i < nv; i++) for (let j = 0; j < nv; j++) found[j] += M[i * nv + j] * a[i];
        return found;
    }

    /** The multipliers that take what the actuators leave; NaN where another solution has others. */
    /** @param {At} at @param {ArrayLike<number>} forces @param {ArrayLike<number>} tau */
    multipliers({ qr }, forces, tau) {
        const left = Float64Array.from(forces);
        this.motors.forEach((place, i) => void (left[place] -= tau[i]));
        const found = qr.solve(left), unique = qr.unique(UNIQUE);
        return found.map((x, k) => (unique[k] ? x : NaN));
    }

    /**
     * Acceleration and multipliers under forces of the actuators; null where a free motion has no inertia.
     * @param {At} at @param {Float64Array} v @param {ArrayLike<number>} tau
     */
    accelerated(at, v, tau) {
        const { nv } = this, { forces, drift } = this.terms(at.q, v, new Float64Array(nv));
        const first = at.qr.solveTransposed(drift.map((x) => -x)), needed = this.plus(forces, at.q, first);
        const left = needed.map((x) => -x);
        this.motors.forEach((place, i) => void (left[place] += tau[i]));
        const more = this.free(at.q, at.N, at.free, left);
        if (!more) return null;
        const a = first.map((x, k) => x + more[k]);
        return { a, tau: Float64Array.from(tau), lambda: this.multipliers(at, this.plus(needed, at.q, more), tau) };
    }

    /** Forces of a motion, the shortest where several would do. @param {At} at @param {ArrayLike<number>} v @param {ArrayLike<number>} a */
    inverse(at, v, a) {
        return this.actuators(at, this.terms(at.q, v, a).forces).tau;
    }

    // --- What the page shows -----------------------------------------------------------------------------------

    /** What is known of where the robot is held. @param {import("./types").Hand} hand */
    held(hand) {
        if (!("q" in hand)) return undefined;
        if (this.latest?.hand === hand) return this.latest.held;
        const q = Float64Array.from(hand.q), { tau, lambda, note } = this.holding(q);
        const { loads, sizes } = this.transmitted(q, lambda);
        const values = { ...this.shown(q, new Float64Array(this.nv), tau, lambda), ...sizes };
        const held = { q, values, loads: { ...loads, ...this.pushing() }, notes: note ? [note] : [] };
        this.latest = { hand, held };
        return held;
    }

    /** @param {number} force */
    plain(force) {
        return Math.abs(force) <= ROUNDING * this.weight ? 0 : force;
    }

    /** Values of curves of actuators and joints, by key. @param {Float64Array} q @param {Float64Array} v @param {Float64Array} tau @param {Float64Array} lambda */
    shown(q, v, tau, lambda) {
        /** @type {Record<string, number>} */
        const found = { power: 0 }, { joints } = this.document.scene;
        this.given.motors.forEach((joint, i) => {
            const power = this.plain(tau[i]) * v[this.motors[i]];
            found[`force ${joints[joint].name}`] = this.plain(tau[i]);
            found[`power ${joints[joint].name}`] = power;
            found.power += power;
        });
        joints.forEach(({ name, q: place }, i) => {
            if (this.given.v[i][1] !== 1 || !place) return;
            found[`q ${name}`] = this.value(q, i);
            found[`v ${name}`] = v[this.given.v[i][0]];
        });
        this.given.rows.slice(this.document.closures.length).forEach((_, i) => {
            found[`coupling ${i + 1}`] = this.plain(lambda[this.starts[this.document.closures.length + i]]);
        });
        return found;
    }

    /** Forces and moments in closures: vectors by key of the loads, and their sizes. @param {ArrayLike<number>} q @param {Float64Array} lambda */
    transmitted(q, lambda) {
        const { closures } = this.document, placements = this.tree.place(q);
        const known = lambda.map((x) => (Number.isFinite(x) ? this.plain(x) : 0));
        const found = this.call("wrenches", 6 * closures.length, q, known).slice();
        /** @type {Record<string, number[]>} */
        const loads = {};
        /** @type {Record<string, number>} */
        const sizes = {};
        closures.forEach(({ joint1 }, i) => {
            const own = lambda.subarray(this.starts[i], this.starts[i] + this.given.rows[i]);
            if (!own.some(Number.isFinite)) return;
            ["force", "moment"].forEach((kind, k) => {
                const vector = directionOf(placements, joint1, [...found.subarray(6 * i + 3 * k, 6 * i + 3 * k + 3)]);
                loads[`closure ${i + 1} ${kind}`] = vector;
                sizes[`${kind} in closure ${i + 1}`] = Math.hypot(...vector);
            });
        });
        return { loads, sizes };
    }

    /** What acts from outside: forces and moments in world axes, by key of the loads. */
    pushing() {
        /** @type {Record<string, number[]>} */
        const found = {};
        const set = [...this.changes.wrench].map(([joint, wrench]) => ({ frame: this.body(joint), wrench }));
        for (const { frame, wrench } of [...this.given.external, ...set]) {
            [found[`wrench force ${frame}`], found[`wrench moment ${frame}`]] = [wrench.slice(0, 3), wrench.slice(3)];
        }
        return found;
    }

    /** The arrows of what acts from outside. @returns {import("./types").Load[]} */
    pushes() {
        const set = [...this.changes.wrench].map(([joint, wrench]) => ({ frame: this.body(joint), joint, point: this.centre(joint), wrench }));
        return [...this.given.external, ...set].flatMap(({ frame, joint, point, wrench }) => /** @type {const} */ (["force", "moment"]).flatMap((kind, k) => (
            wrench.slice(3 * k, 3 * k + 3).some((x) => x !== 0)
                ? [{ key: `wrench ${kind} ${frame}`, label: `External ${kind} on ${frame}`, kind, joint, point, frame: "world", group: "wrench", colour: GREY, unit: kind === "force" ? "N" : "N m" }] : [])));
    }

    /** How far forces and accelerations of this page are from those of Pinocchio, in samples of the document. */
    check() {
        const { q, v, tau, a, forces } = this.given.check, count = q.shape[0];
        let most = 0;
        for (let i = 0; i < count; i++) {
            const row = (/** @type {import("./types").Table} */ table) => Float64Array.from(table.data.subarray(i * table.shape[1], (i + 1) * table.shape[1]));
            const at = this.at(row(q)), [speed, wanted, known] = [v, a, forces].map(row);
            const found = this.accelerated(at, speed, row(tau)), back = this.inverse(at, speed, wanted);
            /** @param {Float64Array} one @param {Float64Array} other */
            const apart = (one, other) => largest(one.map((x, k) => x - other[k])) / Math.max(largest(other), 1e-300);
            most = Math.max(most, found ? apart(found.a, wanted) : NaN, known.length ? apart(back, known) : 0);
        }
        return { count, most };
    }
}

/** What a vector has across a direction of length one, or none. @param {number[]} x @param {number[]} along */
function across(x, along) {
    const part = x[0] * along[0] + x[1] * along[1] + x[2] * along[2];
    return x.map((value, k) => value - part * along[k]);
}

/** How a joint moves its body for each unit speed: along and about, in its own axes; `turned`: in those before it. */
/** @param {import("./types").Joint} joint @returns {{along: number[], about: number[], turned?: boolean}[]} */
function motionsOf({ kind, axis = [0, 0, 1], axis2 = [0, 1, 0], pitch = 0 }) {
    const none = [0, 0, 0], base = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
    const slides = base.map((along) => ({ along, about: none })), turns = base.map((about) => ({ along: none, about }));
    switch (kind) {
        case "revolute": case "continuous": return [{ along: none, about: axis }];
        case "prismatic": return [{ along: axis, about: none }];
        case "helical": return [{ along: axis.map((x) => pitch * x), about: axis }];
        case "spherical": return turns;
        case "translation": return slides;
        case "planar": return [slides[0], slides[1], turns[2]];
        case "free": return [...slides, ...turns];
        case "universal": return [{ along: none, about: axis, turned: true }, { along: none, about: axis2 }];
        default: return [];
    }
}

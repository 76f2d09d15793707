// Where the platform goes from one stop to the next: straight lines with blends, as p3dof.design.tasks makes them.
import { plainLine } from "./document.js";

/** A pose of the platform on its way, and what happens there. */
/**
 * @typedef {object} Waypoint
 * @property {string} name
 * @property {number[]} pose y, z [m], theta [rad]; without theta where it is passed and turns from stop to stop
 * @property {number} blend how far before and after it the path leaves its lines [m]; 0: the platform stops
 * @property {number} dwell at a stop [s]
 * @property {number | null} duration of the way from the stop before it [s]
 * @property {number[] | null} wrench on the way to it [N, N m]
 */

/** A way that is not possible; the message says which and why. */
export class TaskError extends Error {
    /** @param {string} text */
    constructor(text) {
        super(plainLine(text));
    }
}

/** @typedef {(time: number) => [number, number, number]} Profile share of the time to share of the way, and its rates */

/** How a way is covered in time, from rest to rest. @type {Record<string, Profile>} */
export const PROFILES = {
    quintic: (t) => [t ** 3 * (10 + t * (6 * t - 15)), 30 * (t * (1 - t)) ** 2, 60 * t * (1 - t) * (1 - 2 * t)],
    septic: (t) => [
        t ** 4 * (35 + t * (-84 + t * (70 - 20 * t))),
        140 * (t * (1 - t)) ** 3,
        420 * (t * (1 - t)) ** 2 * (1 - 2 * t),
    ],
    "s-curve": sCurve,
};

/** Shares of the time at which the jerk of a profile jumps. @type {Record<string, number[]>} */
export const CORNERS = { "s-curve": [1, 2, 3, 4, 5, 6].map((k) => k / 7) };

/** Seven equal parts with constant jerk: up, none, down, none, down, none, up. @type {Profile} */
function sCurve(time) {
    const h = 1 / 7, jerk = 1 / (8 * h ** 3), part = Math.min(6, Math.max(0, Math.trunc(time / h)));
    let [s, v, a] = [0, 0, 0];
    for (let k = 0; k <= part; ++k) {
        const j = jerk * [1, 0, -1, 0, -1, 0, 1][k], x = k < part ? h : time - part * h;
        [s, v, a] = [s + x * (v + x * (a / 2 + (x * j) / 6)), v + x * (a + (x * j) / 2), a + x * j];
    }
    return [s, v, a];
}

const NODES = 24;
/** How far blends may overlap: rounding. */
const TOUCH = 1 + 1e-12;

/** The way of the platform from one stop to the next, with two continuous derivatives (three, of smoothness 3). */
export class Path {
    /**
     * @param {Waypoint[]} waypoints a stop, what is passed, and a stop
     * @param {string[]} names
     * @param {number} turning how long an arc counts that a turn of 1 rad makes [m]
     * @param {number} smoothness
     */
    constructor(waypoints, names, turning, smoothness = 2) {
        const inner = new Set(waypoints.slice(1, -1).map(({ pose }) => pose.length));
        const last = waypoints.length - 1;
        if (inner.size > 1) {
            throw new TaskError(`${names[0]} to ${names[last]}: expected θ at all waypoints between two stops, or at none`);
        }
        /** @type {[number, number] | null} where theta begins and how far it turns, smoothly from stop to stop */
        this.turn = inner.has(2) ? [waypoints[0].pose[2], waypoints[last].pose[2] - waypoints[0].pose[2]] : null;
        const size = this.turn ? 2 : 3;
        const points = waypoints.map(({ pose }) => pose.slice(0, size));
        const legs = points.slice(1).map((point, k) => point.map((x, i) => x - points[k][i]));
        const lengths = legs.map((leg) => Math.hypot(leg[0], leg[1], turning * (leg[2] ?? 0)));
        lengths.forEach((length, k) => {
            if (length === 0) throw new TaskError(`${names[k]} and ${names[k + 1]}: expected two different poses`);
        });
        /** @type {{points: number[][], start: number, end: number}[]} control points of the pieces, and where they are */
        this.pieces = [];
        /** The parameter at every waypoint: for one that is passed, at the middle of its blend. */
        this.atWaypoints = [0];
        this._blend(waypoints.map(({ blend }) => blend), points, legs, lengths, smoothness + 1, names);
        this.end = this.pieces[this.pieces.length - 1].end;
        this.atWaypoints.push(this.end);
        this._ways = [0];
        if (this.turn) for (const { start, end } of this.pieces) this._ways.push(this._ways[this._ways.length - 1] + this._length(start, end));
    }

    /**
     * @param {number[]} blends @param {number[][]} points @param {number[][]} legs @param {number[]} lengths
     * @param {number} half control points on either side of a corner @param {string[]} names
     */
    _blend(blends, points, legs, lengths, half, names) {
        const along = legs.map((leg, k) => leg.map((x) => x / lengths[k]));
        /** @param {number} k @param {number} by @param {number} way */
        const from = (k, by, way) => points[k].map((x, i) => x + by * along[way][i]);
        let at = 0;
        /** @param {number[][]} control @param {number} size */
        const add = (control, size) => void this.pieces.push({ points: control, start: at, end: (at += size) });
        lengths.forEach((leg, k) => {
            if (blends[k] + blends[k + 1] > leg * TOUCH) {
                throw new TaskError(
                    `${names[k]} and ${names[k + 1]}: their blends, ${1e3 * blends[k]} and ${1e3 * blends[k + 1]} mm, overlap: `
                    + `they are ${Number((1e3 * leg).toPrecision(4))} mm apart`,
                );
            }
            const straight = leg - blends[k] - blends[k + 1];
            if (straight > 0) add([from(k, blends[k], k), from(k, blends[k] + straight, k)], straight);
            if (k + 1 >= lengths.length) return;
            const blend = blends[k + 1], shares = Array.from({ length: half }, (_, i) => i / half);
            const before = shares.map((share) => from(k + 1, -blend * (1 - share), k));
            const after = [...shares.slice(1), 1].map((share) => from(k + 1, blend * share, k + 1));
            const start = at;
            add([...before, ...after], ((2 * half - 1) / half) * blend);
            this.atWaypoints.push((start + at) / 2);
        });
    }

    /**
     * Pose and its first two derivatives by the parameter.
     * @param {number} parameter from 0 to `end`
     * @returns {number[][]}
     */
    at(parameter) {
        const found = this._curve(parameter);
        if (!this.turn) return found;
        const [start, turn] = this.turn;
        const [share, slope, bend] = this._share(parameter, found[1], found[2]);
        const [q, rate, change] = PROFILES.quintic(share);
        const angle = [start + turn * q, turn * rate * slope, turn * (change * slope ** 2 + rate * bend)];
        return found.map((row, k) => [...row, angle[k]]);
    }

    /** @param {number} parameter */
    _piece(parameter) {
        let k = this.pieces.length - 1;
        while (k > 0 && parameter < this.pieces[k].start) --k;
        return k;
    }

    /** @param {number} parameter */
    _curve(parameter) {
        const { points, start, end } = this.pieces[this._piece(parameter)];
        return bezier(points, (parameter - start) / (end - start), end - start);
    }

    /** The length in y and z between two parameters of a piece. @param {number} start @param {number} end */
    _length(start, end) {
        const half = (end - start) / 2;
        return half * LEGENDRE.reduce((sum, [node, weight]) => {
            const rate = this._curve(Math.min(start + half * (1 + node), end))[1];
            return sum + weight * Math.hypot(rate[0], rate[1]);
        }, 0);
    }

    /** The share of the length in y and z, and its rates. @param {number} parameter @param {number[]} first @param {number[]} second */
    _share(parameter, first, second) {
        const k = this._piece(parameter), total = this._ways[this._ways.length - 1];
        const speed = Math.hypot(first[0], first[1]);
        const way = this._ways[k] + this._length(this.pieces[k].start, parameter);
        return [way / total, speed / total, (first[0] * second[0] + first[1] * second[1]) / speed / total];
    }
}

/** A Bezier curve and its first two derivatives. @param {number[][]} points @param {number} t from 0 to 1 @param {number} size */
function bezier(points, t, size) {
    const degree = points.length - 1;
    if (degree === 1) {
        const slope = points[0].map((x, i) => (points[1][i] - x) / size);
        return [points[0].map((x, i) => x + t * (points[1][i] - x)), slope, slope.map(() => 0)];
    }
    let row = points;
    /** @type {number[][][]} */
    const levels = [];
    while (row.length > 1) {
        levels.push(row);
        row = row.slice(1).map((point, k) => point.map((x, i) => row[k][i] + t * (x - row[k][i])));
    }
    const [[a, b], [c, d, e]] = [levels[degree - 1], levels[degree - 2]];
    const first = a.map((x, i) => (degree * (b[i] - x)) / size);
    const second = c.map((x, i) => (degree * (degree - 1) * (e[i] - 2 * d[i] + x)) / size ** 2);
    return [row[0], first, second];
}

/** Nodes and weights of Gauss and Legendre. */
const LEGENDRE = Array.from({ length: NODES }, (_, k) => {
    let x = Math.cos((Math.PI * (k + 0.75)) / (NODES + 0.5)), slope = 0;
    for (let round = 0; round < 100; ++round) {
        let [before, now] = [1, x];
        for (let n = 2; n <= NODES; ++n) [before, now] = [now, ((2 * n - 1) * x * now - (n - 1) * before) / n];
        slope = (NODES * (x * now - before)) / (x * x - 1);
        const step = now / slope;
        x -= step;
        if (Math.abs(step) < 1e-16) break;
    }
    return [x, 2 / ((1 - x * x) * slope * slope)];
});

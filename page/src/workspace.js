// Where the platform can be: what keeps a pose from being possible, how far it can move, and a map of a plane.

/** @typedef {import("./engine.js").Engine} Engine */

/** Legs, in the order of all rows of three. */
export const LEGS = ["A", "B", "C"];

/** Closer than this to det J = 0 the sliders do not hold the platform [rad]. */
const SINGULAR = 1e-6;
/** Share of a leg's length by which it must reach farther than a pose demands. */
const REACH = 1e-14;

/**
 * How far a pose is from all that bounds it; negative is beyond. `reach` [m] and `force` [N] of each leg, `low` and
 * `high` of each slider's travel [m], `singular` [rad], `tilt` [rad].
 * @typedef {object} Margins
 * @property {number[]} reach
 * @property {number} singular
 * @property {number[]} low
 * @property {number[]} high
 * @property {number} tilt
 * @property {number[]} force
 * @property {number[]} holding forces that hold the pose [N]
 */

/**
 * Something that bounds poses.
 * @typedef {object} Reason
 * @property {"reach"|"singular"|"travel"|"tilt"|"force"} kind
 * @property {number} leg 0, 1 or 2; -1 if it is none of them
 * @property {number} over by how much it is beyond [m, rad, N]
 */

/**
 * Returns how much longer the legs are than a pose demands of them across the guides [m].
 * @param {{r: number, R: number, L: number}} lengths
 * @param {number} y
 * @param {number} theta
 */
export function reachMargins({ r, R, L }, y, theta) {
    const width = R - r;
    return [L - Math.abs(width + y), L - Math.abs(width - y), L - Math.hypot(y, R - r * Math.cos(theta))];
}

/**
 * Returns by how much the sliders stand above the platform's z [m], and the angle to the singular pose [rad]; NaN
 * out of reach.
 * @param {{r: number, R: number, L: number, h: number}} lengths
 * @param {number} y
 * @param {number} theta
 */
function column({ r, R, L, h }, y, theta) {
    const a = R - r + y, b = R - r - y, c = R - r * Math.cos(theta), u = Math.sqrt((L - y) * (L + y));
    const drop = Math.sqrt((u - c) * (u + c));
    const cos = (Math.cos(theta) * drop - Math.sin(theta) * c) / u;
    return {
        above: [
            Math.sqrt((L - a) * (L + a)) - h,
            Math.sqrt((L - b) * (L + b)) - h,
            Math.sqrt((u - c) * (u + c)) - h + r * Math.sin(theta),
        ],
        angle: Math.asin(Math.min(1, Math.max(-1, cos))),
    };
}

/**
 * Returns the margins of a pose.
 * @param {Engine} engine
 * @param {ArrayLike<number>} pose
 * @returns {Margins}
 */
export function margins(engine, pose) {
    const holding = [...engine.holding([pose[0], pose[1], pose[2]])];
    return { ...ownMargins(engine, pose), force: holding.map((force) => engine.limits.force - Math.abs(force)), holding };
}

/**
 * The margins of a pose but those of the forces.
 * @param {Engine} engine @param {ArrayLike<number>} pose
 * @returns {Margins}
 */
export function ownMargins({ lengths, limits }, pose) {
    const [y, z, theta] = [pose[0], pose[1], pose[2]], { above, angle } = column(lengths, y, theta);
    return {
        reach: reachMargins(lengths, y, theta).map((margin) => margin - REACH * lengths.L),
        singular: angle - SINGULAR,
        low: above.map((over) => z + over - limits.travel[0]),
        high: above.map((over) => limits.travel[1] - (z + over)),
        tilt: Math.min(theta - limits.tilt[0], limits.tilt[1] - theta),
        force: [],
        holding: [],
    };
}

/**
 * Returns what a pose is beyond, the worst first: out of reach is told alone, since nothing else is known then.
 * @param {Margins} found
 * @returns {Reason[]}
 */
export function reasons(found) {
    /** @type {Reason[]} */
    const all = [];
    found.reach.forEach((margin, leg) => margin > 0 || all.push({ kind: "reach", leg, over: -margin }));
    if (all.length) return all;
    if (!(found.singular > 0)) all.push({ kind: "singular", leg: -1, over: -found.singular });
    if (found.tilt < 0) all.push({ kind: "tilt", leg: -1, over: -found.tilt });
    for (const side of [found.low, found.high])
        side.forEach((margin, leg) => margin >= 0 || all.push({ kind: "travel", leg, over: -margin }));
    found.force.forEach((margin, leg) => margin >= 0 || all.push({ kind: "force", leg, over: -margin }));
    return all;
}

/** Whether a pose can be at all, whatever the limits say. @param {Reason[]} found */
export const impossible = (found) => found.some(({ kind }) => kind === "reach" || kind === "singular");

/**
 * Returns a reason in words.
 * @param {Reason} reason
 */
export function told({ kind, leg, over }) {
    const name = LEGS[leg];
    if (kind === "reach") return `leg ${name} is ${shown(1e3 * over)} mm too short`;
    if (kind === "singular") return "the sliders cannot hold the platform's rotation (singular pose)";
    if (kind === "tilt") return `θ is ${shown((180 / Math.PI) * over)}° beyond the tilt limit`;
    if (kind === "travel") return `slider ${name} is ${shown(1e3 * over)} mm beyond its travel`;
    return `${name} needs ${shown(over)} N more than its limit to hold`;
}

/** What ends a move, in few words. @param {Reason} reason */
export function stopped({ kind, leg }) {
    const name = LEGS[leg];
    return {
        reach: `leg ${name} at full reach`,
        singular: "singular pose",
        tilt: "tilt limit",
        travel: `travel of slider ${name}`,
        force: `force limit of ${name}`,
    }[kind];
}

/** @param {number} value */
const shown = (value) => (value >= 100 ? value.toFixed(0) : value >= 0.1 ? value.toFixed(1) : value.toPrecision(1));

const STEPS = 120, HALVINGS = 40;

/**
 * How far the platform can move one way.
 * @typedef {object} WayOut
 * @property {number} axis 0, 1, 2: y, z, theta
 * @property {number} sign
 * @property {number} distance [m, rad]; zero where the pose is beyond already, Infinity where nothing ends it
 * @property {Reason|null} reason what ends it
 */

/**
 * Returns how far the platform can move from a pose along +-y, +-z and +-theta, at rest, and what ends it.
 * @param {Engine} engine
 * @param {ArrayLike<number>} pose
 * @returns {WayOut[]}
 */
export function waysOut(engine, pose) {
    const start = Array.from(pose).slice(0, 3), first = reasons(margins(engine, start));
    return [0, 1, 2].flatMap((axis) => [-1, 1].map((sign) => wayOut(engine, start, axis, sign, first)));
}

/**
 * @param {Engine} engine
 * @param {number[]} start
 * @param {number} axis
 * @param {number} sign
 * @param {Reason[]} first
 * @returns {WayOut}
 */
function wayOut(engine, start, axis, sign, first) {
    if (first.length) return { axis, sign, distance: 0, reason: first[0] };
    const farthest = axis === 2 ? Math.PI : 4 * engine.lengths.L;
    /** @param {number} distance */
    const at = (distance) => reasons(margins(engine, moved(start, axis, sign * distance)));
    let inside = 0, outside = Infinity;
    for (let k = 1; k <= STEPS && outside === Infinity; ++k) {
        const distance = (farthest * k) / STEPS;
        if (at(distance).length) outside = distance;
        else inside = distance;
    }
    if (outside === Infinity) return { axis, sign, distance: Infinity, reason: null };
    for (let k = 0; k < HALVINGS; ++k) {
        const middle = (inside + outside) / 2;
        if (at(middle).length) outside = middle;
        else inside = middle;
    }
    return { axis, sign, distance: inside, reason: at(outside)[0] };
}

/** @param {number[]} pose @param {number} axis @param {number} by */
function moved(pose, axis, by) {
    const found = [...pose];
    found[axis] += by;
    return found;
}

/** What a point of a map is. */
export const POSSIBLE = 0, BEYOND_REACH = 1, BEYOND_SINGULAR = 2, BEYOND_TRAVEL = 3, BEYOND_FORCE = 4, BEYOND_TILT = 5;

/**
 * A map of the poses with one theta: `status` of each point, row of z after row, each along y; by column `margin`,
 * the least reach margin [m], `angle` to the singular pose [rad], and `force`, the largest that holds a pose [N].
 * None of these changes with z, for the guides are vertical; the sliders' travel does, and `room` is how much of
 * it is left at each point [m].
 * @typedef {object} WorkspaceMap
 * @property {number} theta
 * @property {number[]} y least, most [m]
 * @property {number[]} z least, most [m]
 * @property {number} columns
 * @property {number} rows
 * @property {Uint8Array} status
 * @property {Float64Array} margin
 * @property {Float64Array} angle
 * @property {Float64Array} force
 * @property {Float32Array} room
 */

/**
 * Returns a map of the plane in which P moves.
 * @param {Engine} engine
 * @param {number} theta
 * @param {{columns?: number, rows?: number, y?: number[], z?: number[]}} [grid] within what the legs reach without
 * @returns {WorkspaceMap}
 */
export function workspaceMap(engine, theta, grid = {}) {
    const { lengths, limits } = engine, columns = grid.columns ?? 81, rows = grid.rows ?? 61;
    const half = lengths.L - (lengths.R - lengths.r), y = grid.y ?? [-half, half];
    const low = Math.max(limits.travel[0], -lengths.L), high = Math.min(limits.travel[1], lengths.L);
    const poses = new Float64Array(3 * columns), above = new Float64Array(3 * columns);
    const margin = new Float64Array(columns), angle = new Float64Array(columns), force = new Float64Array(columns);
    let lowest = Infinity, highest = -Infinity;
    for (let i = 0; i < columns; ++i) {
        const at = y[0] + ((y[1] - y[0]) * i) / (columns - 1), found = column(lengths, at, theta);
        poses.set([at, 0, theta], 3 * i);
        above.set(found.above, 3 * i);
        margin[i] = Math.min(...reachMargins(lengths, at, theta));
        angle[i] = found.angle;
        if (margin[i] <= REACH * lengths.L) continue;
        lowest = Math.min(lowest, low - Math.min(...found.above));
        highest = Math.max(highest, high - Math.max(...found.above));
    }
    if (!(lowest < highest)) [lowest, highest] = [low, high];
    const z = grid.z ?? [lowest, highest], holding = engine.holding(poses);
    for (let i = 0; i < columns; ++i)
        force[i] = Math.max(Math.abs(holding[3 * i]), Math.abs(holding[3 * i + 1]), Math.abs(holding[3 * i + 2]));
    const status = new Uint8Array(rows * columns), room = new Float32Array(rows * columns);
    const tilted = theta < limits.tilt[0] || theta > limits.tilt[1];
    for (let i = 0; i < columns; ++i) {
        const reach = margin[i] > REACH * lengths.L, held = angle[i] > SINGULAR;
        const a = above[3 * i], b = above[3 * i + 1], c = above[3 * i + 2];
        const least = Math.min(a, b, c), most = Math.max(a, b, c);
        const rest = !reach ? BEYOND_REACH : !held ? BEYOND_SINGULAR : tilted ? BEYOND_TILT : force[i] > limits.force ? BEYOND_FORCE : POSSIBLE;
        for (let k = 0; k < rows; ++k) {
            const at = z[0] + ((z[1] - z[0]) * k) / (rows - 1);
            const left = Math.min(at + least - limits.travel[0], limits.travel[1] - at - most);
            room[k * columns + i] = left;
            const beyond = left < 0 && (rest === POSSIBLE || rest === BEYOND_FORCE);
            status[k * columns + i] = beyond ? BEYOND_TRAVEL : rest;
        }
    }
    return { theta, y, z, columns, rows, status, margin, angle, force, room };
}

// The numbers of a machine of the paper's kind, as the generated C takes them, and what if they were others.

/** How many numbers describe a machine. */
export const NUMBERS = 152;

/** Links in their order; each has mass, mass centre (3) and inertia (6): xx, xy, xz, yy, yz, zz. */
export const LINKS = [
    "slider_a", "leg_a", "slider_b", "leg_b", "slider_c",
    "crossbar_upper", "rod_left", "crossbar_lower", "platform", "rod_right",
];

/** Joints of the tree, as a configuration has them. */
export const JOINTS = [
    "slide_a", "hinge_a", "slide_b", "hinge_b", "slide_c", "hinge_c", "hinge_left", "hinge_lower",
    "hinge_platform", "hinge_right",
];

/** Where the numbers stand. */
export const PLACES = {
    r: 0, R: 1, L: 2, b: 3, gravity: 4, bodies: 7, viscous: 107, coulomb: 120, smoothing: 133,
    travel: 134, speed: 136, force: 137, tilt: 138,
    armature: 140, counterbalance: 143, spring: 146, counterweight: 149,
};

const BODY = 10;
const SLIDES = 3;

/** Length of a leg less R - r, and R - r itself, as shares of the length: what a machine needs at least. */
const PARALLEL = 1e-6;

/** The density of the solids that have the masses of the paper [kg/m^3], and their sizes [m]. */
const STEEL = 7801.0;
const SIZES = { slider_edge: 0.05, rod_radius: 0.01, plate_thickness: 0.05, corner_radius: 0.02 };
const PAPER = { r: 0.1, R: 0.25, L: 0.4, b: 0.05 };

/** @typedef {import("./types").OfSolids} OfSolids */

/** Of documents that say nothing of solids. @type {OfSolids} */
export const STEEL_SOLIDS = { density: { slider: STEEL, leg: STEEL, crossbar: STEEL, platform: STEEL }, dimensions: {} };

/** The densities of solids in words, nothing for steel. @param {OfSolids} solids */
export function densityText({ density }) {
    const all = Object.values(density), [least, most] = [Math.min(...all), Math.max(...all)];
    if (least === STEEL && most === STEEL) return "";
    return `${least === most ? "" : `${short(least)} to `}${short(most)} kg/m³`;
}

/** What solids are made of, with something that follows. @param {OfSolids} solids @param {string} rest */
export function solidsText(solids, rest = "") {
    const density = densityText(solids);
    return density ? `solids${rest} (${density})` : `steel solids${rest}`;
}

/**
 * What is changed of the machine; what is missing is as in the file. Payload [kg] at `below` [m] below P,
 * friction of each slider besides the file's [N s/m, N], lengths [m], gravity [m/s^2]. `bodies` says which bodies
 * a machine of other lengths has: those of the file, or solids that are as long as it.
 * @typedef {object} WhatIf
 * @property {number} [payload]
 * @property {number} [below]
 * @property {number} [viscous]
 * @property {number} [coulomb]
 * @property {number} [L]
 * @property {number} [R]
 * @property {number} [r]
 * @property {"kept"|"solids"} [bodies]
 * @property {number[]} [gravity]
 * @property {number[]} [wrench]
 * @property {number[]} [armature]
 * @property {number[]} [counterbalance]
 * @property {number[]} [spring]
 * @property {number[]} [counterweight]
 */

/** What motors and counterbalances add at the sliders A, B, C, in place of the file's. */
export const ACTUATORS = /** @type {const} */ (["armature", "counterbalance", "spring", "counterweight"]);

/**
 * Returns the numbers of a machine with something changed.
 * @param {ArrayLike<number>} original
 * @param {WhatIf} whatIf
 * @param {OfSolids} [solids]
 * @returns {Float64Array}
 */
export function changed(original, whatIf, solids = STEEL_SOLIDS) {
    const fault = faultOf(original, whatIf), numbers = Float64Array.from(original);
    for (const name of /** @type {const} */ (["r", "R", "L"])) {
        const value = whatIf[name];
        if (value !== undefined) numbers[PLACES[name]] = value;
    }
    if (fault) throw new RangeError(fault.text);
    if (whatIf.gravity) numbers.set(whatIf.gravity, PLACES.gravity);
    for (const kind of ACTUATORS) numbers.set(whatIf[kind] ?? [], PLACES[kind]);
    if (whatIf.bodies === "solids") setSolids(numbers, solids);
    for (const kind of /** @type {const} */ (["viscous", "coulomb"])) {
        const value = whatIf[kind] ?? 0;
        for (let slide = 0; slide < SLIDES; ++slide) numbers[PLACES[kind] + slide] += value;
    }
    const payload = whatIf.payload ?? 0;
    if (payload > 0) carry(numbers, payload, [0, 0, -(whatIf.below ?? 0)]);
    return numbers;
}

/** The largest payload, in moving masses of the machine, and how far from P it may be, in lengths of a leg. */
const HEAVIEST = 1000, FARTHEST = 100;

/**
 * Returns why a machine cannot be, and what of the change is to blame; null where it can.
 * @param {ArrayLike<number>} original
 * @param {WhatIf} whatIf
 * @returns {{text: string, keys: string[]} | null}
 */
export function faultOf(original, whatIf) {
    const [r, R, L] = /** @type {const} */ (["r", "R", "L"]).map((name, k) => whatIf[name] ?? original[k]);
    const lengths = faultOfLengths(r, R, L);
    if (lengths) return { text: `lengths: ${lengths}`, keys: ["r", "R", "L"].filter((name) => whatIf[/** @type {"r"|"R"|"L"} */ (name)] !== undefined) };
    for (const kind of /** @type {const} */ (["viscous", "coulomb"])) {
        const value = whatIf[kind] ?? 0;
        if (!(value >= 0)) return { text: `${kind} friction: expected zero or more, got ${value}`, keys: [kind] };
    }
    for (const kind of ACTUATORS) {
        const values = whatIf[kind] ?? [], massive = kind === "armature" || kind === "counterweight";
        const bad = values.find((value) => !(Number.isFinite(value) && (value >= 0 || !massive)));
        if (bad !== undefined) return { text: `${kind}: expected ${massive ? "zero or more" : "a number"}, got ${bad}`, keys: [kind] };
    }
    const { payload = 0, below = 0 } = whatIf, heaviest = HEAVIEST * LINKS.reduce((sum, link) => sum + original[bodyPlace(link)], 0);
    if (!(payload >= 0)) return { text: `payload: expected zero or more, got ${payload} kg`, keys: ["payload"] };
    if (!(payload <= heaviest)) {
        const text = `payload: expected at most ${HEAVIEST} times the moving mass, ${short(heaviest)} kg, got ${short(payload)} kg`;
        return { text, keys: ["payload"] };
    }
    if (!(Math.abs(below) <= FARTHEST * L)) {
        const text = `payload: expected at most ${FARTHEST} lengths of a leg from P, ${milli(FARTHEST * L)} mm, got ${milli(below)} mm`;
        return { text, keys: ["below"] };
    }
    return null;
}

/** @param {number} r @param {number} R @param {number} L */
function faultOfLengths(r, R, L) {
    const told = `r = ${milli(r)}, R = ${milli(R)}, L = ${milli(L)} mm`;
    if (!(r > 0 && R > 0 && L > 0)) return `expected more than zero, got ${told}`;
    if (!(R - r >= PARALLEL * L)) return `expected a base R larger than the platform r, got ${told}`;
    if (!(R - r < L)) return `the legs L do not bridge R - r = ${milli(R - r)} mm, got ${told}`;
    return "";
}

/** @param {number} length */
const milli = (length) => short(1e3 * length);

/** @param {number} value */
const short = (value) => String(Number(value.toPrecision(6)));

/**
 * Fixes a point mass to the platform.
 * @param {Float64Array} numbers
 * @param {number} mass
 * @param {number[]} place in the platform's frame [m]
 */
function carry(numbers, mass, place) {
    const at = bodyPlace("platform");
    const body = numbers.subarray(at, at + BODY);
    const whole = body[0] + mass, reduced = (body[0] * mass) / whole;
    const [x, y, z] = [0, 1, 2].map((k) => place[k] - body[1 + k]);
    const moments = [y * y + z * z, -x * y, -x * z, x * x + z * z, -y * z, x * x + y * y];
    for (let k = 0; k < 3; ++k) body[1 + k] += (mass / whole) * (place[k] - body[1 + k]);
    for (let k = 0; k < 6; ++k) body[4 + k] += reduced * moments[k];
    body[0] = whole;
}

/** @param {string} link */
const bodyPlace = (link) => PLACES.bodies + BODY * LINKS.indexOf(link);

/**
 * Gives the machine the bodies of solids of its lengths: cubes, round rods and the rounded plate, their other sizes
 * those given, else the paper's times the least ratio of the lengths to the paper's.
 * @param {Float64Array} numbers
 * @param {OfSolids} solids
 */
function setSolids(numbers, { density, dimensions }) {
    const [r, R, L, b] = numbers;
    const ratio = Math.min(L / PAPER.L, r / PAPER.r, b / PAPER.b, (R - r) / (PAPER.R - PAPER.r));
    const size = (/** @type {keyof typeof SIZES} */ name) => dimensions[name] ?? ratio * SIZES[name];
    const edge = size("slider_edge"), mass = density.slider * edge ** 3, cube = (mass * edge * edge) / 6;
    const slider = [mass, 0, 0, 0, cube, 0, 0, cube, 0, cube];
    const leg = cylinder(density.leg, size("rod_radius"), L, 0, 0);
    const crossbar = cylinder(density.crossbar, size("rod_radius"), 2 * b, 1, -b);
    const platform = plate(density.platform, r, size("corner_radius"), size("plate_thickness"));
    for (const link of LINKS) {
        const kind = link.startsWith("slider") ? slider : link.startsWith("crossbar") ? crossbar : leg;
        numbers.set(link === "platform" ? platform : kind, bodyPlace(link));
    }
}

/**
 * Returns a round bar along one of the axes.
 * @param {number} density
 * @param {number} radius
 * @param {number} length
 * @param {number} axis
 * @param {number} start
 */
function cylinder(density, radius, length, axis, start) {
    const mass = density * Math.PI * radius * radius * length;
    const across = (mass * (3 * radius * radius + length * length)) / 12, along = (mass * radius * radius) / 2;
    const body = [mass, 0, 0, 0, across, 0, 0, across, 0, across];
    body[1 + axis] = start + length / 2;
    body[[4, 7, 9][axis]] = along;
    return body;
}

/**
 * Returns the plate: the triangle of the platform's joints, widened all round by a radius.
 * @param {number} density
 * @param {number} size
 * @param {number} radius
 * @param {number} thickness
 */
function plate(density, size, radius, thickness) {
    const corners = [[0, -1], [0, 1], [-1, 0]];
    const pieces = platePieces(corners, size, radius);
    const total = pieces.reduce((sum, piece) => sum + piece.area, 0);
    const centre = [0, 1].map((k) => pieces.reduce((sum, piece) => sum + piece.area * piece.at[k], 0) / total);
    /** @param {number} i @param {number} j */
    const second = (i, j) =>
        pieces.reduce(
            (sum, piece) => sum + piece.own[i][j] + piece.area * (piece.at[i] - centre[i]) * (piece.at[j] - centre[j]),
            0,
        );
    const across = (total * thickness * thickness) / 12, mass = density * thickness;
    const xx = second(1, 1) + across, yy = second(0, 0) + across, zz = second(0, 0) + second(1, 1);
    return [
        mass * total, centre[0], centre[1], 0,
        mass * xx, -mass * second(0, 1), 0, mass * yy, 0, mass * zz,
    ];
}

/**
 * Cuts the widened triangle into triangle, strips along the edges, and sectors at the corners.
 * @param {number[][]} corners counter-clockwise
 * @param {number} size
 * @param {number} radius
 */
function platePieces(corners, size, radius) {
    const points = corners.map((corner) => corner.map((x) => size * x));
    const middle = [0, 1].map((k) => (points[0][k] + points[1][k] + points[2][k]) / 3);
    const edges = points.map((point, k) => [0, 1].map((i) => points[(k + 1) % 3][i] - point[i]));
    const area = (edges[0][0] * edges[1][1] - edges[0][1] * edges[1][0]) / 2;
    const spokes = points.map((point) => [point[0] - middle[0], point[1] - middle[1]]);
    const core = [0, 1].map((i) => [0, 1].map((j) => (area / 12) * spokes.reduce((sum, s) => sum + s[i] * s[j], 0)));
    const pieces = [{ area, at: middle, own: core }];
    const normals = edges.map(([x, y]) => [y / Math.hypot(x, y), -x / Math.hypot(x, y)]);
    for (let k = 0; k < 3; ++k) {
        const [edge, normal, previous] = [edges[k], normals[k], normals[(k + 2) % 3]];
        const strip = Math.hypot(edge[0], edge[1]) * radius;
        pieces.push({
            area: strip,
            at: [0, 1].map((i) => points[k][i] + edge[i] / 2 + (radius * normal[i]) / 2),
            own: [0, 1].map((i) => [0, 1].map((j) => (strip / 12) * (edge[i] * edge[j] + radius ** 2 * normal[i] * normal[j]))),
        });
        pieces.push(sector(points[k], normal, previous, radius));
    }
    return pieces;
}

/**
 * Returns the circular sector at a corner.
 * @param {number[]} corner
 * @param {number[]} normal
 * @param {number[]} previous
 * @param {number} radius
 */
function sector(corner, normal, previous, radius) {
    const half = Math.acos(normal[0] * previous[0] + normal[1] * previous[1]) / 2;
    const sum = [normal[0] + previous[0], normal[1] + previous[1]];
    const axis = sum.map((x) => x / Math.hypot(sum[0], sum[1])), other = [-axis[1], axis[0]];
    const distance = (2 * Math.sin(half)) / (3 * half), wave = Math.sin(half) * Math.cos(half);
    const along = (half + wave) / 4 - half * distance ** 2, across = (half - wave) / 4;
    return {
        area: half * radius ** 2,
        at: [0, 1].map((i) => corner[i] + radius * distance * axis[i]),
        own: [0, 1].map((i) => [0, 1].map((j) => radius ** 4 * (along * axis[i] * axis[j] + across * other[i] * other[j]))),
    };
}

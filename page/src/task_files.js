// Task files (YAML) and motion files (CSV), as p3dof reads and writes them.
import { ACTUATORS, STEEL_SOLIDS, solidsText } from "./machine.js";
import { PROFILES, TaskError } from "./paths.js";
import { YamlError, parseYaml } from "./yaml.js";

/** @typedef {import("./plan.js").Task} Task */
/** @typedef {import("./paths.js").Waypoint} Waypoint */
/** @typedef {import("./machine.js").WhatIf} WhatIf */
/** @typedef {{time: Float64Array, pose: Float64Array, velocity: Float64Array, acceleration: Float64Array}} Motion rows of three */

/** Units by kind: a power of ten, or a factor. @type {Record<string, Record<string, number | string>>} */
const UNITS = {
    mass: { kg: "e0", g: "e-3", lb: 0.45359237 },
    length: { m: "e0", cm: "e-2", mm: "e-3", um: "e-6", "µm": "e-6", km: "e3", in: 0.0254, ft: 0.3048 },
    angle: { rad: "e0", mrad: "e-3", deg: Math.PI / 180, "°": Math.PI / 180 },
    time: { s: "e0", ms: "e-3", min: 60 },
    force: { N: "e0", mN: "e-3", kN: "e3", lbf: 4.4482216152605, kgf: 9.80665 },
    moment: { "N m": "e0", Nm: "e0", "N mm": "e-3", Nmm: "e-3", "kN m": "e3" },
};
const NUMBER = /^\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*?)\s*$/;

/** A number with a unit, in SI units. @param {any} value @param {string} kind @param {string} where @returns {number} */
function quantity(value, kind, where) {
    if (typeof value === "number" && Number.isFinite(value)) return value;
    const found = typeof value === "string" ? NUMBER.exec(value) : null;
    const units = /** @type {Record<string, number | string>} */ ({ "": "e0", ...UNITS[kind] });
    const number = found && Object.hasOwn(units, found[2]) ? scaled(found[1], units[found[2]]) : NaN;
    if (!Number.isFinite(number)) throw new TaskError(`${where}: expected a ${kind}, got ${JSON.stringify(value)}`);
    return number;
}

/** @param {string} text @param {number | string} factor */
function scaled(text, factor) {
    if (typeof factor === "number") return Number(text) * factor;
    const [digits, power] = text.toLowerCase().split("e");
    return Number(`${digits}e${Number(power ?? 0) + Number(factor.slice(1))}`);
}

/** Limits, and what a better path may change, are for `p3dof fastest`: a plan does not depend on them. */
const KNOWN = ["name", "path", "profile", "smoothness", "turning_length", "carrying", "limits", "waypoints"];
const OF_WAYPOINT = ["pose", "name", "blend", "blend_range", "tolerance", "dwell", "duration", "pick_up", "put_down", "wrench"];
const ELSEWHERE = "this page does not plan it; save its motion with `p3dof plan TASK --out motion.csv` and load that";

/** Read a task file. @param {string} text @returns {Task} */
export const readTask = (text) => readFile(text).task;

/** Read a task file, and what the platform carries, if that is a point mass below P. @param {string} text @returns {{task: Task, carrying: WhatIf}} */
export function readFile(text) {
    let data;
    try {
        data = parseYaml(text);
    } catch (error) {
        if (error instanceof RangeError) throw new TaskError("not a task file: nested too deeply");
        if (!(error instanceof YamlError || error instanceof SyntaxError)) throw error;
        throw new TaskError(`not a task file: ${error.message}`);
    }
    return { task: taskOf(data), carrying: carried(data.carrying) };
}

/** @param {any} data @returns {Task} */
function taskOf(data) {
    requireFields(data, KNOWN, "task");
    if (!Array.isArray(data.waypoints)) throw new TaskError("waypoints: expected a list");
    if (data.path !== undefined && data.path !== "straight") throw new TaskError(`path: ${data.path}: ${ELSEWHERE}`);
    const profile = data.profile ?? "quintic", smoothness = data.smoothness ?? 2;
    if (!Object.hasOwn(PROFILES, profile)) throw new TaskError(`profile: expected one of ${Object.keys(PROFILES).join(", ")}, got ${profile}`);
    if (smoothness !== 2 && smoothness !== 3) throw new TaskError(`smoothness: expected 2 or 3, got ${smoothness}`);
    const turning = quantity(data.turning_length ?? 0.1, "length", "turning_length");
    if (!(turning > 0)) throw new TaskError(`turning_length: expected above zero, got ${turning}`);
    return {
        name: String(data.name ?? ""), profile, smoothness, turning,
        waypoints: data.waypoints.map((/** @type {any} */ point, /** @type {number} */ k) => waypoint(point, `waypoint ${k + 1}`)),
    };
}

/** @param {any} data @returns {WhatIf} */
function carried(data) {
    if (!data) return {};
    requireFields(data, ["mass", "com", "inertia"], "carrying");
    const { com, inertia } = data, mass = quantity(data.mass, "mass", "carrying: mass");
    if (!(mass >= 0)) throw new TaskError(`carrying: mass: expected zero or more, got ${mass} kg`);
    if (!Array.isArray(com) || com.length !== 3) throw new TaskError("carrying: com: expected three lengths");
    const [x, y, z] = com.map((value) => quantity(value, "length", "carrying: com"));
    const point = Array.isArray(inertia) && inertia.flat().every((value) => value === 0);
    if (x || y || !point) throw new TaskError(`carrying: other than a point mass below P: ${ELSEWHERE}`);
    return { ...(mass ? { payload: mass } : {}), ...(mass && z ? { below: -z } : {}) };
}

/** @param {any} data @param {string[]} known @param {string} where */
function requireFields(data, known, where) {
    if (data === null || typeof data !== "object" || Array.isArray(data)) throw new TaskError(`${where}: expected the fields ${known.join(", ")}`);
    const strange = Object.keys(data).find((key) => !known.includes(key));
    if (strange) throw new TaskError(`${where}: unknown field ${strange}, expected ${known.join(", ")}`);
}

/** @param {any} data @param {string} where @returns {Waypoint} */
function waypoint(data, where) {
    requireFields(data, OF_WAYPOINT, where);
    if (data.pick_up || data.put_down) throw new TaskError(`${where}: a load that is picked up or put down: ${ELSEWHERE}`);
    const { pose } = data;
    if (!Array.isArray(pose) || pose.length < 2 || pose.length > 3) throw new TaskError(`${where}: pose: expected y, z, θ`);
    const wrench = data.wrench ?? null;
    if (wrench !== null && (!Array.isArray(wrench) || wrench.length !== 6)) throw new TaskError(`${where}: wrench: expected six numbers`);
    /** @type {Waypoint} */
    const found = {
        name: String(data.name ?? ""),
        pose: pose.map((/** @type {any} */ value, /** @type {number} */ k) => quantity(value, k < 2 ? "length" : "angle", `${where}: pose`)),
        blend: quantity(data.blend ?? 0, "length", `${where}: blend`),
        dwell: quantity(data.dwell ?? 0, "time", `${where}: dwell`),
        duration: data.duration == null ? null : quantity(data.duration, "time", `${where}: duration`),
        wrench: wrench && wrench.map((/** @type {any} */ value, /** @type {number} */ k) => quantity(value, k < 3 ? "force" : "moment", `${where}: wrench`)),
    };
    for (const key of /** @type {const} */ (["blend", "dwell"])) if (!(found[key] >= 0)) throw new TaskError(`${where}: ${key}: expected zero or more`);
    if (found.duration !== null && !(found.duration > 0)) throw new TaskError(`${where}: duration: expected above zero`);
    if (found.blend > 0 && (found.dwell > 0 || found.duration !== null)) throw new TaskError(`${where}: it is passed: no dwell and no duration there`);
    if (!found.blend && pose.length < 3) throw new TaskError(`${where}: pose: expected y, z, θ at a stop`);
    return found;
}

/**
 * What is changed of the machine that a task file cannot hold, in words.
 * @param {WhatIf} whatIf @param {Task} task @param {import("./types").OfSolids} [solids] @returns {string[]}
 */
export function leftOut(whatIf, task, solids = STEEL_SOLIDS) {
    const { viscous, coulomb, bodies, gravity, wrench } = whatIf;
    const lengths = /** @type {const} */ (["L", "R", "r"]).filter((key) => whatIf[key] !== undefined);
    return [
        viscous ? `viscous friction of ${viscous} N s/m more` : "",
        coulomb ? `Coulomb friction of ${coulomb} N more` : "",
        lengths.length ? `lengths ${lengths.map((key) => `${key} = ${whatIf[key]} m`).join(", ")}` : "",
        bodies === "solids" ? solidsText(solids, " of these lengths") : "",
        ...ACTUATORS.map((kind) => (whatIf[kind] ? `${kind} (${whatIf[kind].map(short).join(", ")}) of the sliders` : "")),
        gravity ? `gravity (${gravity.map(short).join(", ")}) m/s^2` : "",
        acts(wrench) && task.waypoints.some(({ dwell }) => dwell > 0) ? `the external load (${wrench.map(short).join(", ")}) N, N m during dwells` : "",
    ].filter(Boolean);
}

/** @param {number[] | undefined} wrench @returns {wrench is number[]} */
const acts = (wrench) => Boolean(wrench?.some((x) => x !== 0));
/** @param {number} value */
const short = (value) => String(Number(value.toPrecision(6)));

/** What the platform bears on the way to a waypoint. @param {number[] | null} own @param {number[] | undefined} more */
const together = (own, more) => (acts(more) ? more.map((x, i) => x + (own?.[i] ?? 0)) : own);

/**
 * The text of a task file: `p3dof plan` makes the same motion of it, and the same forces but for what is `leftOut`.
 * @param {Task} task @param {(number | null)[]} durations of the way to each waypoint [s] @param {WhatIf} whatIf
 * @param {import("./types").OfSolids} [solids]
 */
export function writeTask(task, durations, whatIf = {}, solids = STEEL_SOLIDS) {
    const { payload, below, wrench: load } = whatIf, missing = leftOut(whatIf, task, solids);
    const rows = task.waypoints.map((point, k) => {
        const duration = point.duration ?? durations[k] ?? null, wrench = k ? together(point.wrench, load) : point.wrench;
        const parts = [
            point.name ? `name: ${JSON.stringify(point.name)}` : "",
            `pose: [${point.pose.map(number).join(", ")}]`,
            point.blend ? `blend: ${number(point.blend)}` : "",
            point.dwell ? `dwell: ${number(point.dwell)}` : "",
            duration !== null && !point.blend ? `duration: ${number(duration)}` : "",
            wrench ? `wrench: [${wrench.map(number).join(", ")}]` : "",
        ];
        return `- {${parts.filter(Boolean).join(", ")}}`;
    });
    return [
        "# p3dof task: m, rad, s, kg, N, N m", ...missing.map((what) => `# left out, as a task has no field for it: ${what}`), `name: ${JSON.stringify(task.name)}`, "path: straight", `profile: ${task.profile}`,
        `smoothness: ${task.smoothness}`, `turning_length: ${number(task.turning)}`,
        ...(payload ? [`carrying: {mass: ${number(payload)}, com: [0, 0, ${number(-(below ?? 0))}], inertia: [0, 0, 0]}`] : []),
        "waypoints:", ...rows, "",
    ].join("\n");
}

/** A number that all readers of YAML take for one. @param {number} value */
const number = (value) => String(value).replace(/^(-?\d+)e/, "$1.0e");

const COLUMNS = ["t", "y", "z", "theta", "ydot", "zdot", "thetadot", "yddot", "zddot", "thetaddot"];
const WRITTEN = ["s", "m", "m", "rad", "m/s", "m/s", "rad/s", "m/s^2", "m/s^2", "rad/s^2"];

/** Read a motion file with velocities and accelerations. @param {string} text @returns {Motion} */
export function readMotion(text) {
    const lines = text.split(/\r?\n/).map((line, k) => ({ line: line.trim(), number: k + 1 })).filter(({ line }) => line && !line.startsWith("#"));
    const factors = header(lines[0]?.line ?? "");
    const count = lines.length - 1, time = new Float64Array(count);
    if (count < 2) throw new TaskError("expected two lines of numbers or more after the header");
    const rows = [0, 1, 2].map(() => new Float64Array(3 * count));
    lines.slice(1).forEach(({ line, number: at }, i) => {
        const fields = line.split(",");
        if (fields.length !== 10) throw new TaskError(`line ${at}: expected 10 columns, got ${fields.length}`);
        fields.forEach((field, k) => {
            const value = field.trim() === "" ? NaN : factors[k](Number(field));
            if (!Number.isFinite(value)) throw new TaskError(`line ${at}, column ${COLUMNS[k]}: expected a number, got ${field.trim() || "nothing"}`);
            if (k === 0) time[i] = value;
            else rows[Math.floor((k - 1) / 3)][3 * i + ((k - 1) % 3)] = value;
        });
        if (i && !(time[i] > time[i - 1])) throw new TaskError(`line ${at}, column t: expected a time after ${time[i - 1]}, got ${time[i]}`);
    });
    return { time, pose: rows[0], velocity: rows[1], acceleration: rows[2] };
}

/** What takes each column to SI units. @param {string} line @returns {((value: number) => number)[]} */
function header(line) {
    const fields = line.split(",").map((field) => /^\s*"?([^"[]*?)\s*(?:\[(.*?)\]\s*"?)?\s*$/.exec(field));
    const names = fields.map((field) => field?.[1] ?? "");
    if (names.length === 4 && COLUMNS.slice(0, 4).every((name, k) => names[k] === name)) {
        throw new TaskError("a motion of poses alone: this page needs velocities and accelerations too, as `p3dof plan --out` writes them");
    }
    if (COLUMNS.some((name, k) => names[k] !== name) || names.length !== 10) {
        throw new TaskError(`expected the columns ${COLUMNS.join(",")}: not a motion file`);
    }
    return fields.map((field, k) => {
        const base = k === 0 ? "time" : k % 3 === 0 ? "angle" : "length", dots = k ? Math.floor((k - 1) / 3) : 0;
        const unit = (field?.[2] ?? WRITTEN[k]).trim().replace("²", "^2"), suffix = ["", "/s", "/s^2"][dots];
        const name = unit.endsWith(suffix) ? unit.slice(0, unit.length - suffix.length) : "";
        if (!["s", "ms", "m", "mm", "rad", "deg"].includes(name) || !(name in UNITS[base])) throw new TaskError(`column ${COLUMNS[k]}: unknown unit [${unit}]`);
        const factor = UNITS[base][name];
        return typeof factor === "number" ? (value) => value * factor : (value) => value / 10 ** -Number(factor.slice(1));
    });
}

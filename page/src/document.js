// Reads a document: JSON whose arrays are base64, checked, with typed arrays in their places.
/** @typedef {import("./types").Document} Document */
/** @typedef {import("./types").Table} Table */

export const FORMAT = 1;

const TYPES = /** @type {const} */ ({
    float64: Float64Array, float32: Float32Array,
    int8: Int8Array, uint8: Uint8Array, int16: Int16Array, uint16: Uint16Array, int32: Int32Array, uint32: Uint32Array,
});

/** What every document has where it is needed: kinds of values, how many numbers, the form of each item. */
const FORM = {
    title: "string",
    scene: {
        centre: 3, radius: "number",
        joints: [{ name: "string", parent: "number", placement: 7, kind: "string" }],
        solids: [{ name: "string", joint: "number", placement: 7, shape: { kind: "string" } }],
        labels: [{ text: "string", at: 3 }],
        lines: [{ points: "table" }],
        layers: [{ name: "string", label: "string" }],
    },
    closures: [{ joint1: "number", placement1: 7, joint2: "number", placement2: 7 }],
    inputs: [{ key: "string" }],
    engine: { kind: "string" },
    machine: { name: "string" },
    limits: {},
};
const OF_RUN = {
    name: "string", time: "table", q: "table",
    curves: [{ key: "string", group: "string", values: "table" }],
    loads: [{ key: "string", kind: "string", joint: "number", point: 3 }],
    notes: ["string"],
};

const OF_SOLIDS = { density: { slider: "number", leg: "number", crossbar: "number", platform: "number" }, dimensions: {} };

const OF_NEAREST = { points: "table", distances: "table", pairs: "table", names: ["string"], required: "number" };

/** A document that cannot be shown; the message says why, in one line. */
export class DocumentError extends Error {
    /** @param {string} text */
    constructor(text) {
        super(plainLine(text));
    }
}

/** A text as one line that is not too long, without what would control a terminal or turn text round. @param {string} text */
export const plainLine = (text) => text.slice(0, 1000).replace(/[\p{C}\u2028\u2029]/gu, "\ufffd");

/**
 * Read a document.
 * @param {string | object} source JSON, or what JSON.parse made of it
 * @returns {Document}
 */
export function read(source) {
    try {
        return whole(typeof source === "string" ? parsed(source) : source);
    } catch (error) {
        if (error instanceof RangeError) return fail("the document is nested too deeply, or too large");
        throw error;
    }
}

/** @param {any} raw @returns {Document} */
function whole(raw) {
    if (raw === null || typeof raw !== "object" || !("format" in raw)) fail("this is no document of p3dof");
    const format = Number(raw.format);
    if (format !== FORMAT) {
        fail(`the document has format ${raw.format}, this page reads format ${FORMAT}: make it again with p3dof`);
    }
    const document = /** @type {Document} */ (decoded(raw, "document"));
    complete(document);
    document.runs.forEach((run, i) => checkRun(run, `runs[${i}]`, document));
    document.scene.joints.forEach((joint, i) => {
        if (!(joint.parent < i)) fail(`scene.joints[${i}]: its parent ${joint.parent} does not come before it`);
    });
    return document;
}

/** Read one run of a document that was read. @param {object} raw @param {number} i @param {Document} document */
export function readRun(raw, i, document) {
    const run = decoded(raw, `runs[${i}]`);
    checkRun(run, `runs[${i}]`, document);
    return /** @type {import("./types").Run} */ (run);
}

/** Decode one array: base64, or the bytes themselves. @param {any} value @param {string} where @returns {Table} */
export function decode(value, where = "array") {
    const Type = Object.hasOwn(TYPES, value.dtype) && TYPES[/** @type {keyof typeof TYPES} */ (value.dtype)];
    if (!Type) fail(`${where}: numbers of type ${value.dtype} are not known`);
    const { shape } = value;
    if (!Array.isArray(shape) || !shape.every((n) => Number.isSafeInteger(n) && n >= 0)) fail(`${where}: its shape is no list of sizes`);
    const bytes = value.bytes ?? bytesOf(value.base64, where);
    const count = shape.reduce((/** @type {number} */ a, /** @type {number} */ b) => a * b, 1);
    if (bytes.length !== count * Type.BYTES_PER_ELEMENT) {
        fail(`${where}: ${bytes.length} bytes for shape (${shape.join(", ")}) of ${value.dtype}`);
    }
    return { shape, data: new Type(bytes.buffer) };
}

/** @param {string} text @param {string} [where] */
export function bytesOf(text, where = "base64") {
    let binary;
    try {
        binary = atob(text);
    } catch {
        return fail(`${where}: this is no base64`);
    }
    const bytes = new Uint8Array(binary.length);
    for (let i = 0; i < binary.length; i++) bytes[i] = binary.charCodeAt(i);
    return bytes;
}

/** @param {string} text */
function parsed(text) {
    try {
        return JSON.parse(text);
    } catch (error) {
        return fail(`this is no document of p3dof: ${/** @type {Error} */ (error).message}`);
    }
}

/** @param {any} value @param {string} where @returns {any} */
function decoded(value, where) {
    if (value === null || typeof value !== "object") return value;
    if (Array.isArray(value)) return value.map((item, i) => decoded(item, `${where}[${i}]`));
    if ("base64" in value || value.bytes instanceof Uint8Array) return decode(value, where);
    return Object.fromEntries(Object.entries(value).map(([key, item]) => [key, decoded(item, `${where}.${key}`)]));
}

/** @param {any} document */
function complete(document) {
    for (const key of ["title", "scene", "runs"]) if (!(key in document)) fail(`the document has no "${key}"`);
    document.machine ??= { name: document.title, hash: "" };
    document.generator ??= {};
    document.closures ??= [];
    document.inputs ??= [];
    document.limits ??= {};
    document.engine ??= { kind: "none" };
    const scene = document.scene;
    if (scene !== null && typeof scene === "object") {
        for (const key of ["joints", "solids", "labels", "lines", "layers"]) scene[key] ??= [];
    }
    require(document, FORM, "document");
    if (document.engine.solids !== undefined) require(document.engine.solids, OF_SOLIDS, "document.engine.solids");
    require(document.runs, [{}], "runs");
}

/**
 * Refuse what has another form. @param {any} value @param {any} form as of FORM @param {string} where
 */
function require(value, form, where) {
    if (form === "table") {
        if (!value?.shape?.length || !value.data) fail(`${where}: expected an array of numbers`);
    } else if (typeof form === "number") {
        const numbers = Array.isArray(value) && value.length === form && value.every((x) => typeof x === "number");
        if (!numbers) fail(`${where}: expected ${form} numbers`);
    } else if (typeof form === "string") {
        if (typeof value !== form) fail(`${where}: expected a ${form}`);
    } else if (Array.isArray(form)) {
        if (!Array.isArray(value)) return fail(`${where}: expected a list`);
        value.forEach((item, i) => require(item, form[0], `${where}[${i}]`));
    } else {
        if (value === null || typeof value !== "object" || Array.isArray(value)) fail(`${where}: expected fields`);
        for (const [key, inner] of Object.entries(form)) require(value[key], inner, `${where}.${key}`);
    }
}

/** @param {any} run @param {string} where @param {Document} document */
function checkRun(run, where, document) {
    run.curves ??= [];
    run.loads ??= [];
    run.notes ??= [];
    const { curves, ...rest } = OF_RUN;
    require(run, { ...rest, curves: [{ key: "string" }] }, where);
    const samples = run.time.shape[0];
    if (!samples) fail(`${where}: it has no samples`);
    /** @type {[string, Table | undefined][]} */
    const tables = [["q", run.q], ["pose", run.pose], ["velocity", run.velocity], ["acceleration", run.acceleration],
        ["wrench", run.wrench]];
    for (const curve of run.curves) {
        if (curve.column) curve.values = columnOf(run, curve, `${where}: curve ${curve.key}`);
        tables.push([`curve ${curve.key}`, curve.values]);
    }
    require(run.curves, curves, `${where}.curves`);
    for (const load of run.loads) tables.push([`load ${load.key}`, load.values]);
    if (run.solids !== undefined) require(run.solids, OF_SOLIDS, `${where}.solids`);
    if (run.nearest) {
        require(run.nearest, OF_NEAREST, `${where}.nearest`);
        const { points, distances, pairs, names } = run.nearest;
        tables.push(["nearest points", points], ["distances", distances], ["nearest pairs", pairs]);
        if (points.shape[1] !== 6) fail(`${where}: nearest points have ${points.shape[1]} columns, expected 6`);
        if (pairs.data.some((/** @type {number} */ pair) => !(pair in names))) fail(`${where}: a nearest pair has no name`);
    }
    for (const [name, table] of Object.entries(run.placed ?? {})) tables.push([`placed ${name}`, table]);
    for (const [name, table] of tables) {
        if (table && table.shape?.[0] !== samples) {
            fail(`${where}: ${name} has ${table.shape?.[0]} samples, time has ${samples}`);
        }
    }
    const needed = document.scene.joints.reduce((n, joint) => Math.max(n, joint.q ? joint.q[0] + joint.q[1] : 0), 0);
    const width = run.q?.shape[1] ?? 0;
    if (width < needed) fail(`${where}: q has ${width} columns, the joints need ${needed}`);
    const keys = new Set(run.curves.map((/** @type {{key: string}} */ curve) => curve.key));
    for (const load of run.loads) {
        if (load.curve && !keys.has(load.curve)) fail(`${where}: load ${load.key} has no curve ${load.curve}`);
    }
}

/**
 * The values of a curve that are a column of an array which the run has anyway.
 * @param {any} run @param {{column: [string, number]}} curve @param {string} where @returns {Table}
 */
function columnOf(run, curve, where) {
    const [name, column] = Array.isArray(curve.column) ? curve.column : ["", -1];
    const table = /** @type {Table | undefined} */ (run[name]);
    const width = table?.shape?.[1] ?? 0;
    if (!table || !(Number.isInteger(column) && column >= 0 && column < width)) fail(`${where}: the run has no column ${column} of ${name}`);
    const count = table.shape[0];
    const data = new Float64Array(count);
    for (let i = 0; i < count; i++) data[i] = table.data[i * width + column];
    return { shape: [count], data };
}

/** @param {string} text @returns {never} */
function fail(text) {
    throw new DocumentError(text);
}

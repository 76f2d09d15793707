// Damaged documents, task files, motion files, messages and links: each is read, or refused in one sentence.
// P3DOF_FUZZ is how many of each are tried, P3DOF_SEED what the damages depend on.
import assert from "node:assert/strict";
import { test } from "node:test";
import { DocumentError, read } from "../src/document.js";
import { wanted } from "../src/links.js";
import { unpacked } from "../src/messages.js";
import { TaskError } from "../src/paths.js";
import { readFile, readMotion } from "../src/task_files.js";
import { carriage } from "./documents.mjs";

const COUNT = Number(process.env.P3DOF_FUZZ ?? 400);
let seed = Number(process.env.P3DOF_SEED ?? 1) >>> 0;

/** From 0 to 1. */
function random() {
    seed = (seed + 0x6d2b79f5) >>> 0;
    let t = Math.imul(seed ^ (seed >>> 15), 1 | seed);
    t = (t + Math.imul(t ^ (t >>> 7), 61 | t)) ^ t;
    return ((t ^ (t >>> 14)) >>> 0) / 2 ** 32;
}
/** @param {number} n */
const below = (n) => Math.floor(random() * n);
/** @template T @param {readonly T[]} list @returns {T} */
const one = (list) => list[below(list.length)];

const VALUES = [
    null, true, {}, [], "", "x", "\u001b[2J", "a\nb", -1, 0, 1e308, 1e-320, 1.5, 2 ** 53, "9".repeat(400), [0, 0], [[]], { base64: "?" },
    { shape: [-1], dtype: "float64", base64: "" }, { shape: [1e9], dtype: "float64", base64: "" }, { shape: "x", dtype: "int8", base64: "AA==" },
    { shape: null, dtype: "int8", base64: 5 }, { shape: [1], dtype: "__proto__", base64: "AA==" }, { shape: [2], dtype: "uint8", base64: "AAA=" },
];
const WORDS = [
    "nan", "inf", ".nan", "1e999", "9".repeat(400), "-1", "0x1f", "1_0", "é", "\u202e", "\u0000", "\u001b[31m", "[", "{", "}", "]", ":", ",", "'", "\"",
    "- ", "\n", "\t", "#", "&a", "*a", "!!js", "\u2028", "__proto__", "constructor", "[".repeat(5000), "{a: ".repeat(5000), "- ".repeat(3000), "mm", "kg",
];

/** A text with a few damages. @param {string} text */
function ofText(text) {
    for (let k = one([1, 1, 1, 2, 5]); k > 0; k--) {
        const at = below(text.length + 1), end = at + below(4), lines = text.split("\n"), kind = below(6);
        if (kind === 0) text = text.slice(0, at);
        else if (kind === 1) text = text.slice(0, at) + text.slice(end + below(30));
        else if (kind === 2) text = text.slice(0, at) + one(WORDS) + text.slice(end);
        else if (kind === 3) text = [...lines.slice(0, below(lines.length)), one(lines), ...lines.slice(below(lines.length))].join("\n");
        else if (kind === 4) text = text.replace(/-?\d+\.?\d*/g, (number) => (random() < 0.1 ? one(WORDS) : number));
        else text = text.slice(0, at) + String.fromCharCode(below(0x300)) + text.slice(at + 1);
    }
    return text;
}

/** Plain data with a few values changed, lost or renamed. @param {any} data */
function ofTree(data) {
    /** @type {[any, string][]} */
    const places = [];
    const walk = (/** @type {any} */ value) => {
        for (const key of Object.keys(value)) {
            places.push([value, key]);
            if (value[key] && typeof value[key] === "object") walk(value[key]);
        }
    };
    walk(data);
    for (let k = one([1, 1, 1, 2, 4]); k > 0; k--) {
        const [inside, key] = one(places), kind = below(5), [other, there] = one(places);
        if (kind === 0) delete inside[key];
        else if (kind === 1 && !Array.isArray(inside)) inside[one(["", "__proto__", "x"])] = inside[key];
        else if (kind === 2) inside[key] = structuredClone(other[there] ?? null);
        else inside[key] = structuredClone(one(VALUES));
    }
    return data;
}

/** @param {() => unknown} act @param {new (...of: any[]) => Error} kind @param {string} what */
function readOrRefused(act, kind, what) {
    const begun = process.cpuUsage();
    try {
        act();
    } catch (error) {
        const { message } = /** @type {Error} */ (error);
        assert.ok(error instanceof kind, `${what}: ${/** @type {Error} */ (error).stack}`);
        assert.ok(message && message.length < 2000 && !/[\u0000-\u001f\u007f-\u009f\u2028\u2029]/.test(message), `${what}: ${JSON.stringify(message)}`);
    }
    const spent = process.cpuUsage(begun);
    assert.ok(spent.user + spent.system < 5e6, what);
}

const TASK = `# a task
name: pick and place
profile: septic
turning_length: 120 mm
carrying: {mass: 200 g, com: [0, 0, -40 mm], inertia: [0, 0, 0]}
waypoints:
  - {name: home, pose: [0, 0, 0 deg]}
  - name: "pick: it"
    pose: [-150 mm, 0,
           -15 deg]
    dwell: 200 ms
  - {pose: [-150 mm, 25 mm], blend: 25 mm}
  - {name: 'the ''end''', pose: [1.5e-1, 0, .1], duration: 1.5, wrench: [0, 10 N, -0.05 kN, 0, 0, 1 N m]}
`;
const MOTION = "# from elsewhere\nt [ms],y [mm],z,theta [deg],ydot [mm/s],zdot,thetadot,yddot [mm/s^2],zddot,thetaddot [deg/s²]\n0,120,0,90,5,0,0,7,0,180\n10,1,1,1,1,1,1,1,1,1\n";

test("damaged documents", () => {
    for (let k = 0; k < COUNT; k++) {
        const tree = JSON.stringify(ofTree(carriage()));
        const text = one([tree, tree, ofText(JSON.stringify(carriage()))]);
        readOrRefused(() => read(text), DocumentError, text);
    }
});

test("damaged task files", () => {
    for (let k = 0; k < COUNT; k++) {
        const text = ofText(TASK);
        readOrRefused(() => readFile(text), TaskError, text);
    }
});

test("damaged motion files", () => {
    for (let k = 0; k < COUNT; k++) {
        const text = ofText(MOTION);
        readOrRefused(() => readMotion(text), TaskError, text);
    }
});

test("damaged messages", () => {
    const json = JSON.stringify({ type: "run", first: { shape: [3], dtype: "float64", offset: 0 }, q: [{ shape: [1, 3], dtype: "int16", offset: 24 }] });
    for (let k = 0; k < COUNT; k++) {
        const body = Buffer.from(one([ofText(json), JSON.stringify(ofTree(JSON.parse(json)))]));
        const head = Buffer.alloc(8);
        head.write("P3D1");
        head.writeUInt32LE(one([body.length, body.length, body.length, below(2 ** 32)]), 4);
        const all = Buffer.concat([head, body, Buffer.alloc(one([0, 32, 32, 1000]))]).subarray(0, one([1e6, 1e6, 1e6, 12]));
        readOrRefused(() => unpacked(all.buffer.slice(all.byteOffset, all.byteOffset + all.length)), DocumentError, String(all));
    }
});

test("damaged links", () => {
    for (let k = 0; k < COUNT; k++) {
        const hash = ofText("#run=2&t=0.35"), found = wanted(hash, /** @type {any} */ ([{}, {}, {}]));
        assert.ok(found.time === undefined || Number.isFinite(found.time), hash);
        assert.ok(found.run === undefined || [0, 1, 2].includes(found.run), hash);
        assert.ok((found.missing ?? "").length <= 20, hash);
    }
});

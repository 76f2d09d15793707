import assert from "node:assert/strict";
import { test } from "node:test";
import { read } from "../src/document.js";
import { unpacked } from "../src/messages.js";
import { carriage } from "./documents.mjs";

/** As `p3dof.viewer.session` packs it. @param {object} json @param {ArrayBufferView[]} arrays */
function packed(json, ...arrays) {
    let text = JSON.stringify(json);
    text += " ".repeat((8 - (new TextEncoder().encode(text).length % 8)) % 8);
    const head = Buffer.alloc(8);
    head.write("P3D1");
    const body = Buffer.from(text);
    head.writeUInt32LE(body.length, 4);
    const tail = arrays.flatMap((a) => {
        const bytes = Buffer.from(a.buffer, a.byteOffset, a.byteLength);
        return [bytes, Buffer.alloc((8 - (bytes.length % 8)) % 8)];
    });
    const all = Buffer.concat([head, body, ...tail]);
    return all.buffer.slice(all.byteOffset, all.byteOffset + all.length);
}

test("arrays behind a message are read bit by bit", () => {
    const message = packed(
        { type: "run", words: "θ", first: { shape: [3], dtype: "float64", offset: 0 }, second: { shape: [1, 3], dtype: "int16", offset: 24 } },
        Float64Array.of(Math.PI, NaN, -0), Int16Array.of(1, -2, 3),
    );
    const found = unpacked(message);
    assert.equal(found.words, "θ");
    assert.ok(Object.is(new Float64Array(found.first.bytes.buffer)[2], -0));
    assert.deepEqual([...new Int16Array(found.second.bytes.buffer)], [1, -2, 3]);
});

test("a document of a message is the document of a file", () => {
    const raw = carriage();
    const run = raw.runs[0];
    /** @type {any[]} */
    const arrays = [];
    let offset = 0;
    /** @param {any} value @returns {any} */
    const moved = (value) => {
        if (value === null || typeof value !== "object") return value;
        if (Array.isArray(value)) return value.map(moved);
        if (!("base64" in value)) return Object.fromEntries(Object.entries(value).map(([k, v]) => [k, moved(v)]));
        const bytes = Buffer.from(value.base64, "base64");
        arrays.push(bytes);
        offset += bytes.length;
        return { shape: value.shape, dtype: value.dtype, offset: offset - bytes.length };
    };
    const message = packed({ document: { ...raw, runs: [moved(run)] } }, ...arrays);
    assert.deepEqual(read(unpacked(message).document), read(raw));
});

test("what is no message says so", () => {
    assert.throws(() => unpacked(new ArrayBuffer(16)), /no message of p3dof/);
});

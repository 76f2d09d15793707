import assert from "node:assert/strict";
import { test } from "node:test";
import { DocumentError, decode, read } from "../src/document.js";
import { carriage, table } from "./documents.mjs";

test("a document's arrays become typed arrays", () => {
    const document = read(JSON.stringify(carriage()));
    assert.deepEqual([...document.runs[0].time.data], [0, 1, 3]);
    assert.deepEqual(document.runs[0].q.shape, [3, 3]);
    assert.ok(Number.isNaN(document.runs[0].curves[0].values.data[2]));
    assert.equal(decode({ shape: [2], dtype: "int16", base64: Buffer.from(Int16Array.of(-2, 300).buffer).toString("base64") }).data[1], 300);
});

test("a curve may be a column of an array that the run has", () => {
    /** @type {any} */
    const document = carriage();
    document.runs[0].curves[0] = { ...document.runs[0].curves[0], values: undefined, column: ["q", 1] };
    const run = read(document).runs[0];
    assert.deepEqual([...run.curves[0].values.data], [1, 4, 7].map((i) => run.q.data[i]));
});

/** @type {[string, (document: any) => any, RegExp][]} */
const broken = [
    ["nothing of ours", () => ({ some: "thing" }), /no document of p3dof/],
    ["a newer format", (document) => ({ ...document, format: 2 }), /has format 2, this page reads format 1/],
    ["bytes that do not fit", (document) => (document.runs[0].time.shape = [4], document), /runs\[0\].time: 24 bytes for shape \(4\)/],
    ["a column too few", (document) => (document.runs[0].q = table([3, 2], [0, 0, 0, 0, 0, 0]), document), /q has 2 columns, the joints need 3/],
    ["a sample too few", (document) => (document.runs[0].curves[0].values = table([2], [0, 0]), document), /curve force has 2 samples, time has 3/],
    ["a child before its parent", (document) => (document.scene.joints[0].parent = 1, document), /parent 1 does not come before it/],
    ["a column that is not there", (document) => (document.runs[0].curves[0].column = ["q", 9], document), /curve force: the run has no column 9 of q/],
    ["an unknown type", (document) => (document.runs[0].time.dtype = "int64", document), /int64 are not known/],
    ["solids without a density", (document) => (document.engine = { kind: "p3dof", parameters: table([1], [0]), solids: { density: { leg: 1 }, dimensions: {} } }, document), /engine.solids.density.slider: expected a number/],
    ["solids of a run that are none", (document) => (document.runs[0].solids = 3, document), /runs\[0\].solids: expected fields/],
    ["a load without its curve", (document) => (document.runs[0].curves = [], document), /load force has no curve force/],
];
for (const [name, change, message] of broken) {
    test(`a document with ${name} is refused in one sentence`, () => {
        assert.throws(() => read(change(carriage())), (/** @type {Error} */ error) => error instanceof DocumentError && message.test(error.message));
    });
}
test("text that is no JSON is refused", () => assert.throws(() => read("{"), DocumentError));

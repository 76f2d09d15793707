import assert from "node:assert/strict";
import { test } from "node:test";
import { DocumentError, read } from "../src/document.js";
import { gapAt, gapOf, told } from "../src/nearest.js";
import { createState } from "../src/state.js";
import { carriage, table } from "./documents.mjs";

/** The carriage with three pairs of points; the last pair is another one. */
const near = () => {
    const document = carriage();
    return { ...document, runs: [{ ...document.runs[0], nearest: {
        points: table([3, 6], [0, 0, 0, 0, 0, 0.4, 0, 1, 0, 0, 1, 0.2, 5, 5, 5, 5, 5, 4.9]),
        distances: table([3], [0.4, 0.2, -0.1]), pairs: table([3], [1, 1, 0]), names: ["wheel and wall", "body and wall"], required: 0.25,
    } }] };
};

test("between two samples of one pair the points are half-way, of two pairs those of the nearer sample", () => {
    const [run] = read(near()).runs;
    assert.deepEqual(gapAt(run, 0.5), { from: [0, 0.5, 0], to: [0, 0.5, 0.30000000000000004], distance: 0.30000000000000004, names: "body and wall", near: false });
    assert.deepEqual(gapAt(run, 1.5), { from: [0, 1, 0], to: [0, 1, 0.2], distance: 0.2, names: "body and wall", near: true });
    assert.deepEqual(gapAt(run, 2.5), { from: [5, 5, 5], to: [5, 5, 4.9], distance: -0.1, names: "wheel and wall", near: true });
    assert.equal(gapAt(run, 3)?.distance, -0.1);
    assert.equal(gapAt(read(carriage()).runs[0], 1), null);
});

test("what is near is told in the units of the page, an overlap as one", () => {
    const [run] = read(near()).runs;
    assert.equal(told(/** @type {any} */ (gapAt(run, 0)), "mm"), "body and wall 400.0 mm");
    assert.equal(told(/** @type {any} */ (gapAt(run, 3)), "SI"), "wheel and wall overlap by 0.1000 m");
});

test("in a hand nobody knows what is near", () => {
    const state = createState(read(near()));
    assert.equal(gapOf(state)?.distance, 0.4);
    state.set({ hand: { q: [0, 1, 0] } });
    assert.equal(gapOf(state), null);
});

test("nearest parts that do not fit the run are refused", () => {
    /** @type {[Record<string, any>, RegExp][]} */
    const bad = [
        [{ points: table([3, 3], new Array(9).fill(0)) }, /nearest points have 3 columns, expected 6/],
        [{ points: table([2, 6], new Array(12).fill(0)) }, /nearest points has 2 samples, time has 3/],
        [{ distances: table([2], [0, 0]) }, /distances has 2 samples/],
        [{ pairs: table([3], [0, 1, 2]) }, /a nearest pair has no name/],
        [{ pairs: table([3], [0, 0.5, 0]) }, /a nearest pair has no name/],
        [{ names: [1] }, /names\[0\]: expected a string/],
        [{ required: null }, /required: expected a number/],
    ];
    for (const [change, words] of bad) {
        const document = near();
        Object.assign(document.runs[0].nearest, change);
        assert.throws(() => read(document), (error) => error instanceof DocumentError && words.test(error.message));
    }
});

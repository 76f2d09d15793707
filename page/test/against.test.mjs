// Curves over another curve: ranges, lines with gaps, and the sample that is nearest to a pointer.
import assert from "node:assert/strict";
import { test } from "node:test";
import { nearest, pointAt, reach, trace } from "../src/against.js";

const TURN = 2 * Math.PI;
const time = Float64Array.from({ length: 101 }, (_, k) => k / 100);
/** A circle of radius 2 around (1, -1), once in a second. @returns {any} */
const circle = () => ({ time, x: time.map((t) => 1 + 2 * Math.cos(TURN * t)), values: time.map((t) => -1 + 2 * Math.sin(TURN * t)) });
const same = (/** @type {number} */ value) => value;

test("ranges are those of the span, of all lines together, and none where nothing is", () => {
    const found = reach([circle()], [0, 1]);
    assert.deepEqual(found.x, [-1, 3]);
    assert.deepEqual(found.y, [-3, 1]);
    const upper = reach([circle()], [0, 0.25]);
    assert.ok(Math.abs(upper.x[0] - 1) < 1e-15 && upper.x[1] === 3 && Math.abs(upper.y[0] + 1) < 1e-15 && upper.y[1] === 1);
    const moved = circle();
    moved.x = moved.x.map((/** @type {number} */ value) => value + 10);
    assert.deepEqual(reach([circle(), moved], [0, 1]).x, [-1, 13]);
    assert.deepEqual(reach([{ ...circle(), x: [] }], [0, 1]).x, [NaN, NaN]);
});

test("a line leaves out what falls on a pixel, and breaks where a value is missing", () => {
    /** @type {[string, number, number][]} */
    const calls = [];
    const ctx = /** @type {any} */ ({
        moveTo: (/** @type {number} */ x, /** @type {number} */ y) => calls.push(["move", x, y]),
        lineTo: (/** @type {number} */ x, /** @type {number} */ y) => calls.push(["line", x, y]),
    });
    const line = /** @type {any} */ ({ time: [0, 1, 2, 3, 4, 5], x: [0, 0.1, 5, NaN, 9, 12], values: [0, 0.1, 5, 6, 9, 12] });
    trace(ctx, line, [0, 5], same, same);
    assert.deepEqual(calls, [["move", 0, 0], ["line", 5, 5], ["move", 9, 9], ["line", 12, 12]]);
});

test("the nearest sample is found within the span, however the curve turns", () => {
    const line = circle();
    for (const k of [0, 13, 50, 99]) {
        const [x, y] = pointAt(line, time[k]);
        const out = [1 + 1.2 * (x - 1), -1 + 1.2 * (y + 1)]; // outside of the circle, in the same direction
        const found = nearest([line], [0, 0.995], same, same, out[0], out[1]);
        assert.equal(found, time[k]);
    }
    assert.equal(nearest([line], [0.5, 1], same, same, 3, -0.9), 1);
    assert.equal(nearest([{ ...line, x: [] }], [0, 1], same, same, 0, 0), null);
});

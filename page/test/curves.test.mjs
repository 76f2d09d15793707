import assert from "node:assert/strict";
import { test } from "node:test";
import { axisOf, difference, groupsOf, indexAt, peakOf, rangeOf, resample, samplesIn, shortened, stepFrom, valueAt } from "../src/curves.js";
import { aligned, thinned } from "../src/lines.js";
import { placed, shared } from "../src/peak_labels.js";
import { contrast, readable, rgbOf } from "../src/themes.js";
import { clock, decimals, decimalsOf, fixed, roundStep, shown, titled } from "../src/units.js";

const time = [0, 1, 3, 4];

test("a value between samples lies on the line from one to the next, and outside the run there is none", () => {
    const values = [10, 20, 40, 0];
    assert.equal(valueAt(time, values, 2), 30);
    assert.equal(valueAt(time, values, 4), 0);
    assert.ok(Number.isNaN(valueAt(time, values, 4.001)) && Number.isNaN(valueAt(time, values, -0.1)));
    assert.deepEqual([-1, 0, 0.5, 1, 3.9, 4, 9].map((t) => indexAt(time, t)), [0, 0, 0, 1, 2, 3, 3]);
});

test("a peak is the first sample of largest magnitude, within a span only those in it", () => {
    assert.deepEqual(peakOf(time, [1, -7, 7, 2]), { index: 1, time: 1, value: -7 });
    assert.deepEqual(peakOf(time, [9, 1, NaN, 2], [0.5, 4]), { index: 3, time: 4, value: 2 });
    assert.equal(peakOf(time, [NaN, NaN, NaN, NaN]), null);
    assert.deepEqual(samplesIn(time, [0.5, 3]), [1, 3]);
    assert.deepEqual(samplesIn(time, [1.2, 1.3]), [2, 2]);
    assert.deepEqual(samplesIn(time, null), [0, 4]);
});

test("gaps count neither as zero nor at all", () => {
    assert.deepEqual(rangeOf([/** @type {any} */ ([null, 5, NaN, 7])], 0, 4), [5, 7]);
    assert.ok(Number.isNaN(rangeOf([[NaN]], 0, 1)[0]));
});

test("an axis has room around the values, and goes out to a limit that is half reached", () => {
    const [low, high] = axisOf([-40, 120], [[-500, 500]]);
    assert.ok(low < -40 && low > -80 && high > 120 && high < 160);
    assert.ok(axisOf([0, 260], [[-500, 500]])[1] > 500);
    assert.ok(axisOf([-260, 0], [[-500, 500]])[0] < -500);
    const still = axisOf([3, 3], []);
    assert.ok(still[0] < 3 && still[1] > 3);
    const noise = axisOf([-1e-16, 2e-16], [], 1);
    assert.ok(noise[0] < -1e-3 && noise[1] > 1e-3, "what only rounding moves is drawn straight");
    assert.ok(axisOf([NaN, NaN], []).every(Number.isFinite));
});

test("two runs with other times differ as their lines do", () => {
    const slow = [0, 2, 4];
    assert.deepEqual([...resample(slow, [0, 20, 40], [0, 1, 3, 4, 5])], [0, 10, 30, 40, NaN]);
    assert.deepEqual([...difference(time, [1, 11, 31, 41], slow, [0, 20, 40])], [1, 1, 1, 1]);
});

test("lines with other times share one axis, with gaps where a line has no value", () => {
    const line = (/** @type {number[]} */ own, /** @type {number[]} */ values) =>
        ({ key: "k", label: "", colour: "#000000", kind: /** @type {const} */ ("now"), time: own, values, scale: 1 });
    const [axis, a, b] = /** @type {any[]} */ (aligned([line([0, 1, 2], [0, 1, 2]), line([1, 1.5], [5, 6])]));
    assert.deepEqual([...axis], [0, 1, 1.5, 2]);
    assert.deepEqual([...a], [0, 1, 1.5, 2]);
    assert.deepEqual([...b], [null, 5, 6, null]);
});

test("many samples are drawn by the lowest and the highest of each column, so that no peak is lost", () => {
    const count = 10_001;
    const axis = Float64Array.from({ length: count }, (_, i) => i);
    const values = Float64Array.from({ length: count }, (_, i) => (i === 4321 ? 100 : i === 7777 ? -50 : Math.sin(i)));
    const [time, thin] = /** @type {any[]} */ (thinned([axis, values], [0, count - 1], 200));
    assert.equal(time.length, 400);
    assert.equal(Math.max(...thin), 100);
    assert.equal(Math.min(...thin), -50);
    assert.ok(Math.abs(time[thin.indexOf(100)] - 4321) <= count / 200);
    assert.ok(time.every((/** @type {number} */ t, /** @type {number} */ i) => i === 0 || t > time[i - 1]));
    const few = /** @type {any} */ ([axis, values]);
    assert.equal(thinned(few, [0, 700], 200), few);
    const gap = Array.from(values, (value, i) => (i < 5000 ? null : value));
    const [, holed] = /** @type {any[]} */ (thinned([axis, gap], [0, count - 1], 200));
    assert.ok(holed[0] === null && holed[198] === null && holed[201] !== null);
});

test("a group has one unit, and its labels lose the words that all begin with", () => {
    const curve = (/** @type {string} */ group, /** @type {string} */ unit) => /** @type {any} */ ({ key: `${group}${unit}`, label: `Value of ${unit}`, group, unit });
    const groups = groupsOf(/** @type {any} */ ({ curves: [curve("Pose", "m"), curve("Forces", "N"), curve("Pose", "rad")] }));
    assert.deepEqual(groups.map(({ name, unit }) => [name, unit]), [["Pose", "m"], ["Pose: rad", "rad"], ["Forces", "N"]]);
    assert.deepEqual(shortened(["Power A", "Power B", "Power, sum"]), ["A", "B", "sum"]);
    assert.deepEqual(shortened(["joint_1", "joint_2"]), ["joint_1", "joint_2"]);
    assert.deepEqual(shortened(["Velocity of y", "Velocity of z"]), ["y", "z"]);
    assert.deepEqual(shortened(["Force A"]), ["Force A"]);
});

test("a step always moves, to a sample", () => {
    assert.deepEqual([stepFrom(time, 1, 1), stepFrom(time, 1, -1), stepFrom(time, 2, 1), stepFrom(time, 2, -1)], [3, 0, 3, 1]);
    assert.deepEqual([stepFrom(time, 4, 1), stepFrom(time, 0, -1)], [4, 0]);
});

test("labels of peaks cover neither each other nor any dot, and stay in the plot", () => {
    const plot = { x: 0, y: 0, width: 300, height: 100 };
    const dots = [[295, 5], [294, 9], [290, 14], [296, 60], [150, 50], [152, 51]].map(([x, y], i) => ({ x, y, width: 34, height: 13, up: i % 2 === 0 }));
    const boxes = placed(dots, plot);
    boxes.forEach((box, i) => {
        assert.ok(box.x >= 0 && box.y >= 0 && box.x + box.width <= 300 && box.y + box.height <= 100);
        boxes.slice(i + 1).forEach((other) => assert.equal(shared(box, other), 0));
        dots.forEach(({ x, y }) => assert.equal(shared(box, { x: x - 3, y: y - 3, width: 6, height: 6 }), 0));
    });
});

test("units are converted where lengths and angles are, numbers have a true minus", () => {
    assert.deepEqual(shown("m/s", "mm"), { unit: "mm/s", factor: 1000 });
    assert.deepEqual(shown("rad/s^2", "mm"), { unit: "°/s²", factor: 180 / Math.PI });
    assert.deepEqual(shown("m/s²", "SI"), { unit: "m/s²", factor: 1 });
    assert.deepEqual(shown("m rad", "mm"), { unit: "mm °", factor: (1000 * 180) / Math.PI });
    assert.deepEqual(shown("m² rad", "mm"), { unit: "mm² °", factor: (1e6 * 180) / Math.PI });
    assert.deepEqual(shown("m² rad", "SI"), { unit: "m² rad", factor: 1 });
    assert.deepEqual(shown("m^2 rad/(s^6 N^3)", "mm"), { unit: "m² rad/(s^6 N³)", factor: 1 });
    assert.deepEqual(["N", "N m", "W", "1", "mol"].map((unit) => shown(unit, "mm").factor), [1, 1, 1, 1, 1]);
    assert.deepEqual([fixed(-1.5e-7, -3), fixed(0, -3), fixed(2e8, -1)], ["−1.500e-7", "0", "2.0e+8"]);
    assert.equal(titled("Forces", "N", "mm"), "Forces [N]");
    assert.deepEqual([fixed(-0.04, 1), fixed(-1.25, 2), fixed(NaN, 1)], ["0.0", "−1.25", "–"]);
    assert.deepEqual([118.5, 1103, 0.02, 0, 1e9, 1e-6].map(decimals), [1, 0, 5, 1, -3, -3]);
    assert.equal(clock(0.35, 1e-3), "0.350 s");
    assert.equal(clock(0.35, 1e-5), "0.35000 s");
});

test("ticks are round in the unit that is shown, and written exactly", () => {
    assert.deepEqual([0.025, 0.1, 20, 0.3, 2.5].map(decimalsOf), [3, 1, 0, 1, 1]);
    assert.deepEqual([0.9, 1.1, 2.2, 3, 6, 573].map(roundStep), [1, 2, 2.5, 5, 10, 1000]);
});

test("every colour can be read on light and on dark", () => {
    for (const colour of ["#0072b2", "#d55e00", "#009e73", "#222222", "#ffff00", "#ffffff", "#808080"]) {
        assert.ok(contrast(rgbOf(readable(colour, "light")), [255, 255, 255]) >= 4.5);
        assert.ok(contrast(rgbOf(readable(colour, "dark")), [27, 33, 40]) >= 4.5);
    }
});

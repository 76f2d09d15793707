// The engine against numbers of Python, in the file that P3DOF_REFERENCE names: tests/viewer/test_page_engine.py writes it.
import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { test } from "node:test";
import { decode } from "../src/document.js";
import { Engine } from "../src/engine.js";
import { JOINTS } from "../src/machine.js";
import { durationsOf, planned, stretchesOf } from "../src/plan.js";
import { margins } from "../src/workspace.js";

const file = process.env.P3DOF_REFERENCE;
const reference = file ? JSON.parse(readFileSync(file, "utf8")) : null;
const options = { skip: reference ? false : "P3DOF_REFERENCE names no file: pytest tests/viewer/test_page_engine.py writes one" };
const SHARE = 1e-12;

/** @param {number[]} numbers @param {import("../src/types").OfSolids} [solids] */
const engineOf = (numbers, solids) =>
    new Engine(new WebAssembly.Instance(new WebAssembly.Module(readFileSync(reference.wasm))), numbers, solids);
/** @param {any} table */
const numbers = (table) => /** @type {Float64Array} */ (decode(table).data);

/**
 * All as they are to be, to a share of the largest; NaN in the same places.
 * @param {ArrayLike<number>} got @param {any} table @param {string} what @param {number} [share]
 */
function same(got, table, what, share = SHARE) {
    const wanted = numbers(table);
    assert.equal(got.length, wanted.length, what);
    let [largest, worst] = [0, 0];
    for (let k = 0; k < wanted.length; ++k) {
        assert.equal(Number.isNaN(got[k]), Number.isNaN(wanted[k]), `${what}: NaN at ${k}`);
        if (Number.isNaN(wanted[k])) continue;
        largest = Math.max(largest, Math.abs(wanted[k]));
        worst = Math.max(worst, Math.abs(got[k] - wanted[k]));
    }
    assert.ok(worst <= share * largest, `${what}: off by ${worst} of ${largest}`);
    return worst / largest;
}

/** @param {Engine} engine @param {any} wanted */
function compare(engine, wanted) {
    const [pose, velocity, acceleration] = [wanted.pose, wanted.velocity, wanted.acceleration].map(numbers);
    const wrench = wanted.wrench ? numbers(wanted.wrench) : null;
    const found = engine.solve({ pose, velocity, acceleration, wrench });
    /** @type {Record<string, number>} */
    const worst = {};
    /** @param {string} what @param {ArrayLike<number>} got */
    const check = (what, got) => void (worst[what] = same(got, wanted[what], `${wanted.name}: ${what}`));
    check("forces", found.forces);
    check("sliders", found.sliders);
    check("speeds", found.speeds);
    check("power", found.power);
    check("holding", engine.holding(pose, wrench));
    check("jacobian", engine.jacobian(pose));
    check("mass", engine.massMatrix(pose));
    check("joints", engine.joints(pose));
    check("slider_accelerations", engine.sliderAccelerations({ pose, velocity, acceleration }));
    const moved = engine.accelerations({ pose, velocity, forces: numbers(wanted.forces), wrench });
    worst.accelerations = same( // to what forces of the machine can tell: the masses are small near singular poses
        engine.solve({ pose, velocity, acceleration: moved, wrench }).forces, wanted.forces, `${wanted.name}: accelerations`,
    );
    check("poses", engine.poses(found.sliders));
    for (let i = 0; i < 100; ++i) {
        const row = margins(engine, pose.subarray(3 * i, 3 * i + 3));
        const serial = numbers(wanted.serial).subarray(3 * i, 3 * i + 3);
        serial.forEach((margin, leg) => assert.ok(Math.abs(row.reach[leg] - margin) < 1e-13));
    }
    return worst;
}

test("the engine is Python to 1e-12, for several machines, with NaN out of reach", options, (context) => {
    for (const wanted of reference.machines) {
        const worst = compare(engineOf(wanted.parameters), wanted);
        context.diagnostic(`${wanted.name}: ${JSON.stringify(worst)}`);
    }
});

test("what is changed of a machine is what Python makes of it", options, (context) => {
    for (const wanted of reference.changes) {
        const engine = engineOf(reference.machines[0].parameters, wanted.solids);
        engine.set(wanted.what_if);
        engine.numbers.forEach((value, k) => {
            const off = Math.abs(value - wanted.parameters[k]);
            assert.ok(off <= 1e-14 * Math.abs(value) + 1e-17, `${wanted.name}: number ${k} is ${value}, not ${wanted.parameters[k]}`);
        });
        const worst = compare(engine, wanted);
        context.diagnostic(`${wanted.name}: ${JSON.stringify(worst)}`);
    }
});

test("numbers that are no machine are refused with a reason, and the machine before stays", options, () => {
    const engine = engineOf(reference.machines[0].parameters), before = [...engine.holding([0, 0, 0.1])];
    /** @type {[import("../src/machine.js").WhatIf, RegExp][]} */
    const refused = [
        [{ R: 0.05 }, /base R larger than the platform r, got r = 100, R = 50, L = 400 mm/],
        [{ L: 0.1 }, /do not bridge R - r = 150 mm/],
        [{ payload: -1 }, /payload: expected zero or more, got -1 kg/],
        [{ viscous: -2 }, /viscous friction/],
        [{ armature: [0, -1, 0] }, /armature: expected zero or more, got -1/],
        [{ spring: [NaN, 0, 0] }, /spring: expected a number, got NaN/],
        [{ r: NaN }, /more than zero/],
        [{ gravity: [0, 0, NaN] }, /not those of a machine/],
    ];
    for (const [whatIf, told] of refused) assert.throws(() => engine.set(whatIf), told);
    assert.deepEqual([...engine.holding([0, 0, 0.1])], before);
    assert.throws(() => engineOf([1, 2, 3]), /expected 152 numbers of a machine, got 3/);
});

test("tasks become the motions that Python plans", options, () => {
    for (const wanted of reference.tasks) {
        const stretches = stretchesOf(wanted.task);
        const durations = durationsOf(wanted.task, stretches, wanted.duration);
        const plan = planned(wanted.task, stretches, durations, wanted.samples);
        for (const what of /** @type {const} */ (["time", "pose", "velocity", "acceleration", "times"])) {
            same(plan[what], wanted[what], `${wanted.task.name}: ${what}`, 1e-11);
        }
    }
});

test("joints have the names of the tree", options, () => assert.deepEqual(JOINTS, reference.joints));

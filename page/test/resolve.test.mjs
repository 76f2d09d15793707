import assert from "node:assert/strict";
import { test } from "node:test";
import { changed } from "../src/machine.js";
import { PROFILES, Path } from "../src/paths.js";
import { durationsOf, planned, stretchesOf } from "../src/plan.js";
import { wrongPace, wrongWaits } from "../src/planning.js";
import { reasons, told } from "../src/workspace.js";

const stop = (/** @type {number[]} */ pose, blend = 0, dwell = 0) => ({ name: "", pose, blend, dwell, duration: null, wrench: null });
const task = (/** @type {import("../src/paths.js").Waypoint[]} */ waypoints) => (
    { name: "", profile: "quintic", smoothness: 2, turning: 0.1, waypoints });

test("profiles go from rest to rest, and their rates are their derivatives", () => {
    for (const [name, profile] of Object.entries(PROFILES)) {
        assert.deepEqual(profile(0), [0, 0, 0], name);
        profile(1).forEach((value, k) => assert.ok(Math.abs(value - [1, 0, 0][k]) < 1e-12, name));
        for (const t of [0.2, 0.5, 0.83]) {
            const [before, , after] = [t - 1e-6, t, t + 1e-6].map(profile);
            assert.ok(Math.abs((after[0] - before[0]) / 2e-6 - profile(t)[1]) < 1e-7, name);
            assert.ok(Math.abs((after[1] - before[1]) / 2e-6 - profile(t)[2]) < 1e-5, name);
        }
    }
});

test("a path has two continuous derivatives at its blends, and passes beside the waypoint", () => {
    const points = [stop([0, 0, 0]), stop([0.1, 0, 0], 0.03), stop([0.1, 0.1, 0.2])];
    const path = new Path(points, ["a", "b", "c"], 0.1);
    for (const { end } of path.pieces.slice(0, -1)) {
        const [before, after] = [path.at(end - 1e-12), path.at(end + 1e-12)];
        before.forEach((row, k) => row.forEach((x, i) => assert.ok(Math.abs(x - after[k][i]) < 1e-7)));
    }
    const [pose] = path.at(path.atWaypoints[1]);
    assert.ok(Math.hypot(pose[0] - 0.1, pose[1]) > 0.005 && Math.hypot(pose[0] - 0.1, pose[1]) < 0.03);
});

test("ways that are not possible say which and why", () => {
    /** @type {[import("../src/paths.js").Waypoint[], RegExp][]} */
    const broken = [
        [[stop([0, 0, 0])], /two waypoints or more/],
        [[stop([0, 0, 0]), stop([0, 0, 0])], /waypoint 1 and waypoint 2: expected two different poses/],
        [[stop([0, 0, 0]), stop([0.1, 0, 0], 0.02)], /a stop at the beginning and at the end/],
        [[stop([0, 0, 0]), stop([0.1, 0, 0], 0.2), stop([0.1, 0.1, 0])], /blends, 0 and 200 mm, overlap: they are 100 mm apart/],
    ];
    for (const [waypoints, message] of broken) assert.throws(() => stretchesOf(task(waypoints)), message);
    const given = task([stop([0, 0, 0], 0, 1), stop([0.1, 0, 0])]);
    assert.throws(() => durationsOf(given, stretchesOf(given), 0.5), /expected more than the 1 s/);
});

test("samples are evenly spaced, with the ends of all pieces and none twice", () => {
    const points = task([stop([0, 0, 0], 0, 0.1), stop([0.1, 0, 0], 0, 0.25), stop([0, 0, 0.1])]);
    const stretches = stretchesOf(points), durations = durationsOf(points, stretches, 2);
    const { time, times, pose } = planned(points, stretches, durations, 101);
    for (let k = 1; k < time.length; ++k) assert.ok(time[k] - time[k - 1] > 1e-9);
    for (const at of [0.1, ...times, 2]) assert.ok(time.includes(at) || time.some((t) => Math.abs(t - at) < 1e-12), `${at}`);
    assert.deepEqual([...pose.slice(-3)], [0, 0, 0.1]);
});

test("each way has its own samples, however long the waits between are", () => {
    for (const dwell of [0, 5, 50, 500]) {
        const points = task([stop([0, 0, 0], 0, dwell), stop([0.1, 0, 0], 0, dwell), stop([0, 0, 0.1])]);
        const stretches = stretchesOf(points), { time, velocity } = planned(points, stretches, [0.7, 0.4]);
        const inside = (/** @type {number} */ start, /** @type {number} */ end) => time.filter((t) => t > start && t < end).length;
        for (const [start, end] of [[dwell, dwell + 0.7], [2 * dwell + 0.7, 2 * dwell + 1.1]]) {
            assert.ok(inside(start, end) >= 279, `${dwell}: ${inside(start, end)} samples of a way`);
        }
        const most = Math.max(...velocity.filter((_, k) => k % 3 === 0)); // of a quintic: 15/8 of the mean, exactly in the middle
        assert.ok(Math.abs(most - (15 / 8) * (0.1 / 0.7)) < 1e-5 * most, `${dwell}: ${most}`);
        assert.ok(time.length < 2000, `${time.length}`);
        for (let k = 1; k < time.length; ++k) assert.ok(time[k] - time[k - 1] > 1e-12 * time[time.length - 1]);
    }
});

test("limits and waits that are none are refused, each by its name", () => {
    const own = { force: 500, speed: 1 }, none = { fastest: true, duration: null, force: null, speed: null, power: null };
    const points = task([stop([0, 0, 0]), stop([0.1, 0, 0], 0, -1)]), good = task([stop([0, 0, 0]), stop([0.1, 0, 0], 0, 2)]);
    const told = (/** @type {object} */ pace, machine = own) => wrongPace(good, { ...none, ...pace }, machine).map(({ at, text }) => `${at}: ${text}`);
    assert.deepEqual(told({}), []);
    assert.deepEqual(told({ power: NaN, force: 200 }), []); // no limit of power is one
    assert.deepEqual(told({ force: NaN }, { ...own, force: Infinity }), []);
    assert.deepEqual(told({ force: 0, speed: NaN, power: -3 }), [
        "force: most force of each actuator: expected more than zero N, got 0; the machine's own is 500 N",
        "speed: most speed of each actuator: expected more than zero m/s, got nothing; the machine's own is 1 m/s",
        "power: most power of each actuator: expected more than zero W, got -3",
    ]);
    assert.deepEqual(told({ fastest: false, force: 0 }), []);
    assert.deepEqual(told({ fastest: false, duration: 0 }), ["duration: time in all: expected more than zero seconds, got 0"]);
    assert.deepEqual(wrongWaits(good), []);
    assert.deepEqual(wrongWaits(points), [{ at: 1, text: "waypoint 2: dwell: expected zero seconds or more, got -1" }]);
    assert.deepEqual(wrongWaits(task([stop([0, 0, 0], 0, NaN), stop([1, 0, 0])])), [{ at: 0, text: "waypoint 1: dwell: expected zero seconds or more, got nothing" }]);
});

test("a pose's reasons name what is beyond, out of reach alone", () => {
    const free = { reach: [1, 1, 1], singular: 1, low: [1, 1, 1], high: [1, 1, 1], tilt: 1, force: [1, 1, 1], holding: [0, 0, 0] };
    assert.deepEqual(reasons(free), []);
    assert.deepEqual(reasons({ ...free, reach: [1, -0.012, 1], tilt: -1 }).map(told), ["leg B is 12.0 mm too short"]);
    assert.deepEqual(reasons({ ...free, high: [1, 1, -0.003], force: [-20, 1, 1] }).map(told),
        ["slider C is 3.0 mm beyond its travel", "A needs 20.0 N more than its limit to hold"]);
});

test("a point mass below P moves the platform's mass centre", () => {
    const numbers = new Float64Array(152);
    numbers.set([0.1, 0.25, 0.4, 0.05, 0, 0, -9.806]);
    numbers[87] = 6;
    const more = changed(numbers, { payload: 2, below: 0.4 });
    assert.equal(more[87], 8);
    assert.ok(Math.abs(more[90] + 0.1) < 1e-15);
    assert.ok(Math.abs(more[91] - 1.5 * 0.16) < 1e-15);
});

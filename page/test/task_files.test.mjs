import assert from "node:assert/strict";
import { test } from "node:test";
import { motionCsv } from "../src/csv.js";
import { leftOut, readFile, readMotion, readTask, writeTask } from "../src/task_files.js";
import { parseYaml } from "../src/yaml.js";

const TASK = `# a task
name: pick and place      # its name
profile: septic
turning_length: 120 mm
waypoints:
  - {name: home, pose: [0, 0, 0 deg]}
  - name: "pick: it"
    pose: [-150 mm, 0,
           -15 deg]
    dwell: 200 ms
  - {pose: [-150 mm, 25 mm], blend: 25 mm}          # passed
  - pose:
    - 0.15
    - 25 mm
    blend: 2.5 cm
  - {name: 'the ''end''', pose: [1.5e-1, 0, .1], duration: 1.5, wrench: [0, 10 N, -0.05 kN, 0, 0, 1 N m]}
`;

test("a task file is read as people write it", () => {
    const task = readTask(TASK);
    assert.equal(task.name, "pick and place");
    assert.equal(task.profile, "septic");
    assert.equal(task.turning, 0.12);
    assert.deepEqual(task.waypoints.map(({ name }) => name), ["home", "pick: it", "", "", "the 'end'"]);
    assert.deepEqual(task.waypoints[1].pose, [-0.15, 0, (-15 * Math.PI) / 180]);
    assert.equal(task.waypoints[1].dwell, 0.2);
    assert.deepEqual(task.waypoints[3], { name: "", pose: [0.15, 0.025], blend: 0.025, dwell: 0, duration: null, wrench: null });
    assert.deepEqual(task.waypoints[4].wrench, [0, 10, -50, 0, 0, 1]);
});

test("what is written is read back to the same numbers", () => {
    const task = readTask(TASK);
    assert.deepEqual(readTask(writeTask(task, [])), task);
    task.waypoints[0].pose = [1e-7, 1e21, 0.1 + 0.2];
    assert.deepEqual(readTask(writeTask(task, [])), task);
});

test("a payload is carried in the file, an external load acts on its ways, and what it cannot hold is named", () => {
    const task = readTask(TASK), whatIf = { payload: 3, below: 0.05, wrench: [0, 5, 0, 0, 0, 0] };
    const text = writeTask(task, [], whatIf), read = readFile(text);
    assert.deepEqual(parseYaml(text).carrying, { mass: 3, com: [0, 0, -0.05], inertia: [0, 0, 0] });
    assert.deepEqual(read.carrying, { payload: 3, below: 0.05 });
    assert.deepEqual(read.task.waypoints.map(({ wrench }) => wrench && wrench.slice(0, 3)), [null, ...Array(3).fill([0, 5, 0]), [0, 15, -50]]);
    assert.deepEqual(leftOut(whatIf, task), ["the external load (0, 5, 0, 0, 0, 0) N, N m during dwells"]);
    const other = { viscous: 20, coulomb: 2, L: 0.45, bodies: /** @type {const} */ ("solids"), gravity: [0, 0, -1.62], armature: [3, 0, 0] }, lines = writeTask(task, [], other);
    assert.deepEqual(readFile(lines), { task, carrying: {} });
    const told = ["viscous friction of 20 N s/m more", "Coulomb friction of 2 N more", "lengths L = 0.45 m", "steel solids of these lengths", "armature (3, 0, 0) of the sliders", "gravity (0, 0, -1.62) m/s^2"];
    assert.deepEqual(leftOut(other, task), told);
    const light = { slider: 2700, leg: 2700, crossbar: 2700, platform: 2700 };
    assert.ok(leftOut(other, task, { density: light, dimensions: {} }).includes("solids of these lengths (2700 kg/m³)"));
    assert.ok(writeTask(task, [], other, { density: { ...light, leg: 7801 }, dimensions: {} }).includes("solids of these lengths (2700 to 7801 kg/m³)"));
    for (const what of told) assert.ok(lines.includes(`\n# left out, as a task has no field for it: ${what}\n`), what);
    assert.throws(() => readTask("carrying: {mass: 1, com: [0.1, 0, 0], inertia: [0, 0, 0]}\nwaypoints: []"), /other than a point mass below P/);
    assert.deepEqual(readFile("carrying: {mass: 200 g, com: [0, 0, -40 mm], inertia: [0, 0, 0]}\nwaypoints: []").carrying, { payload: 0.2, below: 0.04 });
});

/** @type {[string, string, RegExp][]} */
const broken = [
    ["no list", "waypoints: 3", /waypoints: expected a list/],
    ["an unknown field", "waypoint: []", /unknown field waypoint/],
    ["a unit of another kind", "waypoints: [{pose: [1 s, 0, 0]}]", /waypoint 1: pose: expected a length, got "1 s"/],
    ["a spline", "path: spline\nwaypoints: []", /path: spline: this page does not plan it; save its motion with/],
    ["a load", "waypoints: [{pose: [0, 0, 0], pick_up: {mass: 1}}]", /waypoint 1: a load that is picked up/],
    ["no theta at a stop", "waypoints: [{pose: [0, 0]}]", /expected y, z, θ at a stop/],
    ["a key twice", "name: a\nname: b\nwaypoints: []", /line 2: name is there twice/],
    ["an anchor", "name: &a b\nwaypoints: []", /line 1: &a b: this page reads no anchors/],
    ["an open bracket", "waypoints: [1, 2", /not a task file: line 1/],
    ["a text", "hello", /task: expected the fields/],
    ["a dwell where it is passed", "waypoints: [{pose: [0, 0, 0], blend: 0.1, dwell: 1}]", /no dwell and no duration/],
];
for (const [name, text, message] of broken) {
    test(`${name} is refused with a reason`, () => assert.throws(() => readTask(text), message));
}

test("yaml of a dump is read", () => {
    const text = "a:\n- b: [1, 2.5, -3.0e-05]\n  c: {d: 'x', e: null, f: true}\n- - 1\n  - 2\ng: \"\\u00e9 # no comment\"\nh:\ni: text with spaces\n";
    assert.deepEqual(parseYaml(text), { a: [{ b: [1, 2.5, -3e-5], c: { d: "x", e: null, f: true } }, [1, 2]], g: "é # no comment", h: null, i: "text with spaces" });
});

test("a motion file is read back to the same bits, and in other units", () => {
    const rows = (/** @type {number} */ seed) => Float64Array.from({ length: 9 }, (_, k) => Math.sin(seed + k) * 10 ** -k);
    const motion = { time: Float64Array.of(0, 0.1, 0.1 + 0.2), pose: rows(1), velocity: rows(2), acceleration: rows(3) };
    const run = /** @type {any} */ (Object.fromEntries(Object.entries(motion).map(([key, data]) => [key, { shape: key === "time" ? [3] : [3, 3], data }])));
    assert.deepEqual(readMotion(motionCsv(/** @type {any} */ ({}), run) ?? ""), motion);
    const text = "# from elsewhere\nt [ms],y [mm],z,theta [deg],ydot [mm/s],zdot,thetadot,yddot [mm/s^2],zddot,thetaddot [deg/s²]\n0,120,0,90,5,0,0,7,0,180\n10,1,1,1,1,1,1,1,1,1\n";
    const read = readMotion(text);
    assert.deepEqual([read.time[1], read.pose[0], read.pose[2], read.velocity[0], read.acceleration[2]], [0.01, 0.12, Math.PI / 2, 0.005, Math.PI]);
    assert.throws(() => readMotion("t,y,z,theta\n0,0,0,0\n1,0,0,0\n"), /poses alone/);
    assert.throws(() => readMotion("a,b\n1,2\n"), /not a motion file/);
    assert.throws(() => readMotion(text.replace("10,1,1", "0,1,1")), /line 4, column t: expected a time after 0, got 0/);
    assert.throws(() => readMotion(text.replace("10,1,1", "10,x,1")), /line 4, column y: expected a number, got x/);
});

test("inches and pounds are read, and what only the fastest motion needs", () => {
    const { task, carrying } = readFile(`
carrying: {mass: 3 lb, com: [0, 0, -2 in], inertia: [0, 0, 0]}
limits: {force: 300 N, jerk: 500}
waypoints:
  - {pose: [0, 0, 0], wrench: [1 lbf, 0, 0, 0, 0, 0]}
  - {pose: [4 in, 0], blend: 1 in, blend_range: [5 mm, 25 mm]}
  - {pose: [6 in, 1 in, 10 deg]}
`);
    assert.ok(Math.abs(Number(carrying.payload) - 1.36077711) < 1e-15);
    assert.ok(Math.abs(Number(carrying.below) - 0.0508) < 1e-15);
    assert.ok(Math.abs(task.waypoints[1].pose[0] - 0.1016) < 1e-15);
    assert.ok(Math.abs(Number(task.waypoints[0].wrench?.[0]) - 4.4482216152605) < 1e-15);
});

import assert from "node:assert/strict";
import { test } from "node:test";
import { Group, Vector3, Vector4 } from "three";
import { largest } from "../src/arrows.js";
import { Cameras, DIRECTIONS } from "../src/cameras.js";
import { read } from "../src/document.js";
import { Eye, partInside } from "../src/eye.js";
import { angleAt, under } from "../src/handles.js";
import { shown } from "../src/labels.js";
import { carriage } from "./documents.mjs";

/** Points that a random generator with a seed puts in a box. @param {number} seed @param {number} count */
function points(seed, count) {
    let x = seed;
    const next = () => ((x = (x * 16807) % 2147483647) / 2147483647 - 0.5);
    return Array.from({ length: count }, () => new Vector3(1.4 * next(), 2 * next(), 1.2 * next()));
}

/** Left, right, top, bottom: 45, 90, 50 and 25 pixels of a picture of 900 x 500. @type {[number, number, number, number]} */
const MARGINS = [0.1, 0.2, 0.2, 0.1];

/** @param {"3d" | "front" | "side" | "top"} view @param {boolean} parallel @param {number} width @param {number} height */
function seen(view, parallel, width = 900, height = 500) {
    const cameras = new Cameras();
    const target = new Vector3();
    cameras.resize(width, height);
    cameras.use(parallel, target);
    const all = points(7, 60);
    cameras.fit(all, new Vector3(...DIRECTIONS[view]), target, MARGINS);
    const world = new Group();
    world.updateMatrixWorld(true);
    return { eye: new Eye(cameras.used, world, width, height), all, cameras, target };
}

for (const view of /** @type {const} */ (["3d", "front", "side", "top"])) {
    for (const parallel of [false, true]) {
        test(`${view}, ${parallel ? "parallel" : "perspective"}: all is in the picture, and fills it`, () => {
            const { eye, all } = seen(view, parallel);
            const pixels = all.map((point) => eye.pixel(point));
            const [xs, ys] = [0, 1].map((i) => pixels.map((pixel) => pixel[i]));
            const rooms = [Math.min(...xs) - 45, 810 - Math.max(...xs), Math.min(...ys) - 50, 475 - Math.max(...ys)];
            assert.ok(rooms.every((room) => room > -0.01), String(rooms));
            assert.ok(Math.max(rooms[0], rooms[1]) < 0.01 || Math.max(rooms[2], rooms[3]) < 0.01, String(rooms)); // it is full
            const [x, y] = [rooms[0] - rooms[1], rooms[2] - rooms[3]];
            if (parallel) assert.ok(Math.hypot(x, y) < 0.02, "it is in the middle of what is left");
        });

        test(`${view}, ${parallel ? "parallel" : "perspective"}: P is brought under the pointer`, () => {
            const { eye } = seen(view, parallel);
            const P = new Vector3(0, 0.1, -0.2);
            const [x, y] = eye.pixel(P);
            const goal = under(P, x + 23, y - 17, eye);
            assert.ok(Math.abs(goal.x) < 1e-9, "P stays in its plane");
            const [u, v] = eye.pixel(goal);
            if (view !== "side") assert.ok(Math.abs(u - x - 23) < 0.1, `${u - x}`);
            if (view !== "top") assert.ok(Math.abs(v - y + 17) < 0.1, `${v - y}`);
        });
    }
}

test("an angle in the plane of the ring is that of a turn about y", () => {
    const { eye } = seen("side", true);
    const P = new Vector3(0, 0.1, -0.2);
    for (const theta of [-2, -0.3, 0, 1]) {
        const [x, y] = eye.pixel(P.clone().add(new Vector3(0.2, 0, 0).applyAxisAngle(new Vector3(0, 1, 0), theta)));
        assert.ok(Math.abs(angleAt(P, x, y, eye) - theta) < 1e-9);
    }
});

test("changing between perspective and parallel keeps the size of what is looked at", () => {
    const { cameras, target } = seen("3d", false);
    const world = new Group();
    const side = target.clone().add(new Vector3(0.45, 0.85, 0).normalize().multiplyScalar(0.1));
    const before = new Eye(cameras.used, world, 900, 500).pixel(side);
    assert.ok(cameras.use(true, target));
    const between = new Eye(cameras.used, world, 900, 500).pixel(side);
    assert.ok(cameras.use(false, target));
    const after = new Eye(cameras.used, world, 900, 500).pixel(side);
    assert.ok(Math.hypot(before[0] - between[0], before[1] - between[1]) < 2);
    assert.ok(Math.hypot(before[0] - after[0], before[1] - after[1]) < 1e-6);
});

test("a line is cut where it leaves the picture", () => {
    const inside = [0.8, 0.8, 0.5, 0.9];
    const start = new Vector4(0, 0, 0, 1);
    assert.equal(partInside(start, new Vector4(0.5, 0.5, 0, 0), inside), 1);
    assert.equal(partInside(start, new Vector4(1.6, 0, 0, 0), inside), 0.5);
    assert.equal(partInside(start, new Vector4(0, -2, 0, 0), inside), 0.25);
    assert.equal(partInside(new Vector4(2, 0, 0, 1), new Vector4(0.1, 0, 0, 0), inside), 0);
    assert.ok(partInside(start, new Vector4(0.5, 0, 0, -1), inside) < 0.8, "towards the eye it leaves the picture too");
});

test("arrows are as long as their loads are large, over all runs", () => {
    const document = read(carriage());
    assert.deepEqual(largest(document.runs), { N: 20 });
    document.runs[0].loads[0].layer = "reactions";
    assert.deepEqual(largest(document.runs, { reactions: true }), { N: 20 });
    assert.deepEqual(largest(document.runs, { reactions: false }), {}, "what is hidden takes no part");
});

test("values are written in three digits or a few more", () => {
    assert.deepEqual([0, -3.14159, 12.34, 118.46, 2.5e6, NaN].map((value) => shown(value, "N")),
        ["0 N", "−3.1 N", "12.3 N", "118 N", "2.50e+6 N", "undetermined"]);
});

import assert from "node:assert/strict";
import { test } from "node:test";
import { read } from "../src/document.js";
import { instant, locate } from "../src/instant.js";
import { createState, within } from "../src/state.js";
import { Tree, matrixOf } from "../src/tree.js";
import { carriage } from "./documents.mjs";

const fresh = () => createState(read(carriage()));

test("between two samples everything is at the same part of the way", () => {
    const state = fresh();
    state.set({ time: 0.5 });
    const now = instant(state);
    assert.equal(now.q[0], 1);
    assert.ok(Math.abs(now.q[1] - Math.SQRT1_2) < 1e-15 && Math.abs(now.q[2] - Math.SQRT1_2) < 1e-15);
    assert.equal(now.values.force, 15);
    assert.deepEqual(now.loads[0].at, [0, 1, 1.1]);
    assert.deepEqual(now.loads[0].vector, [0, 0, 15]);
    assert.deepEqual([...now.placements.subarray(28, 31)], [0.5, 1, 1]); // the wheel
    assert.ok(Math.abs(now.placements[16 + 6] - Math.SQRT1_2) < 1e-15);
    state.set({ time: 2 });
    assert.ok(Number.isNaN(instant(state).values.force), "a value that is not known is not made up");
    state.set({ time: 1 });
    assert.equal(instant(state).values.force, 20, "a sample beside one that is not known is known");
});

test("an instant is computed once for each change", () => {
    const state = fresh();
    assert.equal(instant(state), instant(state));
    const before = instant(state);
    state.set({ time: 1 });
    assert.notEqual(instant(state), before);
});

test("changes are shown together, once, and a part that fails leaves the others working", async (t) => {
    const state = fresh();
    const said = t.mock.method(console, "error", () => undefined);
    /** @type {string[][]} */
    const seen = [];
    state.subscribe(() => { throw new Error("broken"); });
    state.subscribe((_, changed) => void seen.push([...changed].sort()));
    state.set({ time: 1 });
    state.set({ speed: 2, time: 2 });
    await new Promise((resolve) => setImmediate(resolve));
    assert.deepEqual(seen, [["speed", "time"]]);
    assert.equal(said.mock.callCount(), 1);
});

test("a time is kept within the run", () => {
    const state = fresh();
    assert.equal(within(state, 7), 3);
    assert.equal(within(state, -7), 0);
    assert.deepEqual(locate([0, 1, 3], 3), { i: 2, part: 0 });
    assert.deepEqual(locate([0, 1, 3], 2), { i: 1, part: 0.5 });
});

test("what is held by hand has no stored forces without an engine", () => {
    const state = fresh();
    state.set({ hand: { q: [0.25, 1, 0] } });
    assert.equal(instant(state).q[0], 0.25);
    assert.ok(Number.isNaN(instant(state).loads[0].value));
    assert.ok(instant(state).byHand);
});

test("joints of every kind are where their positions say", () => {
    const half = Math.SQRT1_2;
    /** @type {[any, number[], number[]][]} kind, q, where a point at (1, 0, 0) of the joint goes */
    const cases = [
        [{ kind: "revolute", axis: [0, 0, 1], q: [0, 1] }, [Math.PI / 2], [0, 1, 0]],
        [{ kind: "continuous", axis: [0, 1, 0], q: [0, 2] }, [0, 1], [0, 0, -1]],
        [{ kind: "prismatic", axis: [0, 1, 0], q: [0, 1] }, [2], [1, 2, 0]],
        [{ kind: "helical", axis: [0, 0, 1], pitch: 0.5, q: [0, 1] }, [Math.PI], [-1, 0, Math.PI / 2]],
        [{ kind: "spherical", q: [0, 4] }, [0, 0, half, half], [0, 1, 0]],
        [{ kind: "translation", q: [0, 3] }, [1, 2, 3], [2, 2, 3]],
        [{ kind: "planar", q: [0, 4] }, [1, 2, 0, 1], [1, 3, 0]],
        [{ kind: "free", q: [0, 7] }, [1, 2, 3, 0, half, 0, half], [1, 2, 2]],
        [{ kind: "universal", axis: [0, 0, 1], axis2: [0, 1, 0], q: [0, 2] }, [Math.PI / 2, Math.PI / 2], [0, 0, -1]],
        [{ kind: "fixed" }, [], [1, 0, 0]],
    ];
    for (const [joint, q, expected] of cases) {
        const tree = new Tree([{ name: "j", parent: -1, placement: [0, 0, 0, 0, 0, 0, 1], ...joint }]);
        const m = tree.place(q);
        const found = [0, 1, 2].map((k) => m[k] + m[12 + k]);
        found.forEach((x, k) => assert.ok(Math.abs(x - expected[k]) < 1e-15, `${joint.kind}: ${found}`));
    }
    const tree = new Tree([{ name: "p", parent: -1, placement: [0, 0, 0, 0, 0, 0, 1], kind: "placed" }]);
    assert.deepEqual([...tree.place([], () => [1, 2, 3, 0, 0, half, half])], [...matrixOf([1, 2, 3, 0, 0, half, half])]);
});

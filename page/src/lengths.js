// The scene of the paper's machine with other lengths, by the names of its joints and solids.
import { Quaternion, Vector3 } from "three";

/** @typedef {{r: number, R: number, L: number}} Lengths [m] */
/** @typedef {import("./types").Scene} Scene */

/** How much what is fixed moves along x and y when R grows by 1. */
/** @type {Record<string, [number, number]>} */
const OUTWARD = {
    slide_a: [0, -1], slide_b: [0, 1], slide_c: [-1, 0], rail_a: [0, -1], rail_b: [0, 1], rail_c: [-1, 0],
    base_link_0: [0, -1], base_link_1: [0, 1], base_link_2: [-1, 0], base_link_4: [-0.5, 0],
    A: [0, -1], B: [0, 1], C: [-1, 0],
};
/** How much beams of the frame grow along x and y. */
/** @type {Record<string, [number, number]>} */
const BEAMS = { base_link_3: [0, 2], base_link_4: [1, 0] };
const RODS = ["leg_a_0", "leg_b_0", "rod_left_0", "rod_right_0"];
/** Where the legs go from their sliders, horizontally, at home. */
/** @type {Record<string, [number, number]>} */
const INWARD = { hinge_a: [0, 1], hinge_b: [0, -1], hinge_left: [1, 0], hinge_right: [1, 0] };

/**
 * The scene with other lengths.
 * @param {Scene} scene @param {Lengths} from those of the scene @param {Lengths} to
 * @returns {Scene}
 */
export function withLengths(scene, from, to) {
    const [grownR, grownL, grownr] = [to.R - from.R, to.L - from.L, to.r - from.r];
    const moved = (/** @type {string} */ name, /** @type {number[]} */ place) => {
        const [x, y] = OUTWARD[name] ?? [0, 0];
        return [place[0] + x * grownR, place[1] + y * grownR, ...place.slice(2)];
    };
    const turned = turnOf(scene, from, to);
    const joints = scene.joints.map((joint) => {
        const placement = moved(joint.name, joint.placement);
        if (joint.name === "hinge_lower") placement[0] += grownL;
        return { ...joint, placement: [...placement.slice(0, 3), ...(turned[joint.name] ?? placement.slice(3))] };
    });
    const solids = scene.solids.map((solid) => {
        const placement = moved(solid.name, solid.placement);
        let { shape } = solid;
        if (RODS.includes(solid.name) && shape.kind === "cylinder") {
            placement[0] += grownL / 2;
            shape = { ...shape, length: shape.length + grownL };
        } else if (solid.name in BEAMS && shape.kind === "box") {
            shape = { ...shape, size: shape.size.map((size, i) => size + (BEAMS[solid.name][i] ?? 0) * grownR) };
        } else if (solid.name === "platform" && shape.kind === "mesh") {
            shape = { ...shape, positions: widened(shape.positions, from.r, grownr) };
        }
        if (joints[solid.joint]?.name === "hinge_platform") placement[0] += grownr;
        return { ...solid, placement, shape };
    });
    const labels = scene.labels.map((label) => ({ ...label, at: moved(label.text, label.at) }));
    const traced = scene.traced && { ...scene.traced, point: [scene.traced.point[0] + grownr, ...scene.traced.point.slice(1)] };
    const floor = scene.floor === null ? null : scene.floor - (heightOf(to) - heightOf(from)) - grownr;
    return { ...scene, joints, solids, labels, traced, floor };
}

/** A closure with other lengths: tips of legs, and corners of the platform. */
/** @param {import("./types").Closure} closure @param {Lengths} from @param {Lengths} to @returns {import("./types").Closure} */
export function closedWith(closure, from, to) {
    const tip = (/** @type {number[]} */ [x, ...rest]) => [x === from.L ? to.L : x, ...rest];
    const corner = (/** @type {number[]} */ [x, y, ...rest]) => [(x * to.r) / from.r, (y * to.r) / from.r, ...rest];
    const placement2 = Math.abs(closure.placement2[0]) === from.r ? corner(closure.placement2) : closure.placement2;
    return { ...closure, placement1: tip(closure.placement1), placement2 };
}

/** How far the platform hangs below the sliders at home. @param {Lengths} lengths */
const heightOf = ({ r, R, L }) => Math.sqrt((L - (R - r)) * (L + (R - r)));

/** How the joints whose legs lean otherwise are turned. @param {Scene} scene @param {Lengths} from @param {Lengths} to */
function turnOf(scene, from, to) {
    /** @type {Record<string, number[]>} */
    const found = {};
    for (const { name, placement } of scene.joints) {
        if (!(name in INWARD)) continue;
        const [before, after] = [from, to].map((lengths) => {
            const [x, y] = INWARD[name].map((part) => part * (lengths.R - lengths.r));
            return new Vector3(x, y, -heightOf(lengths)).normalize();
        });
        const q = new Quaternion().setFromUnitVectors(before, after).multiply(new Quaternion(...placement.slice(3)));
        found[name] = q.toArray();
        if (name === "hinge_left") found.hinge_platform = q.clone().conjugate().toArray(); // level at home
    }
    return found;
}

/** Corners of the platform moved outward; they are at (0, r), (-r, 0) and (0, -r). */
/** @param {import("./types").Table} positions @param {number} r @param {number} grown */
function widened({ shape, data }, r, grown) {
    const moved = Float64Array.from(data);
    for (let i = 0; i < moved.length; i += 3) {
        if (moved[i] < -r / 2) moved[i] -= grown;
        else moved[i + 1] += Math.sign(moved[i + 1]) * grown;
    }
    return { shape, data: moved };
}

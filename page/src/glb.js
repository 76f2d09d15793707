// Scene and motion as binary glTF: a node for each joint, named after it, with its solids below.
import { instantOf, runOf, sceneOf } from "./instant.js";
import { geometryOf } from "./solids.js";
import { rgbOf } from "./themes.js";

/** @typedef {import("./types").State} State */

/** Instants of the animation, evenly; between them a reader interpolates. */
const KEYS = 241;
const FLOAT = 5126;
const UNSIGNED = 5125;

/** @param {State} state @returns {Uint8Array<ArrayBuffer>} */
export function glb(state) {
    const { document } = state;
    const run = runOf(state);
    const file = new File();
    const scene = sceneOf(state);
    const { joints, solids } = scene;
    /** @type {any[]} */
    const nodes = [{ name: document.title, rotation: [-Math.SQRT1_2, 0, 0, Math.SQRT1_2], children: [] }]; // glTF is y-up
    /** @param {number} joint */
    const parentOf = (joint) => nodes[joint < 0 ? 0 : joint + 1];
    for (const { name } of joints) nodes.push({ name });
    joints.forEach(({ parent }, i) => (parentOf(parent).children ??= []).push(i + 1));
    for (const solid of solids) {
        (parentOf(solid.joint).children ??= []).push(nodes.length);
        const [x, y, z, ...rotation] = solid.placement;
        nodes.push({ name: solid.name, translation: [x, y, z], rotation, mesh: file.mesh(solid) });
    }
    const animation = run && joints.length ? file.animation(nodes, joints, tracksOf(scene, run)) : null;
    return file.bytes({
        asset: { version: "2.0", generator: `p3dof ${document.generator.p3dof ?? ""}`.trim() },
        scene: 0, scenes: [{ nodes: [0] }], nodes,
        ...(animation?.channels.length ? { animations: [{ name: run.name || "run", ...animation }] } : {}),
    });
}

/** @typedef {{time: Float32Array, places: Float32Array[], turns: Float32Array[]}} Tracks placements in the parent */

/** @param {import("./types").Scene} scene @param {import("./types").Run} run @returns {Tracks} */
function tracksOf(scene, run) {
    const { joints } = scene;
    const { data } = run.time;
    const count = Math.min(KEYS, data.length);
    const [start, end] = [data[0], data[data.length - 1]];
    const time = Float32Array.from({ length: count }, (_, i) => (count > 1 ? (i * (end - start)) / (count - 1) : 0));
    const places = joints.map(() => new Float32Array(3 * count));
    const turns = joints.map(() => new Float32Array(4 * count));
    for (let key = 0; key < count; key++) {
        const { placements } = instantOf(scene, run, count > 1 ? start + (key * (end - start)) / (count - 1) : start);
        joints.forEach(({ parent }, i) => {
            const local = relative(placements, parent, i);
            places[i].set(local.slice(12, 15), 3 * key);
            turns[i].set(continued(quaternion(local), turns[i], 4 * (key - 1)), 4 * key);
        });
    }
    return { time, places, turns };
}

/** A joint's matrix in its parent. @param {Float64Array} m @param {number} parent @param {number} joint */
function relative(m, parent, joint) {
    const own = m.slice(16 * joint, 16 * joint + 16);
    if (parent < 0) return own;
    const p = m.subarray(16 * parent, 16 * parent + 16);
    const found = new Float64Array(16);
    for (let column = 0; column < 4; column++) {
        for (let row = 0; row < 3; row++) {
            let sum = 0;
            for (let k = 0; k < 3; k++) sum += p[4 * row + k] * (own[4 * column + k] - (column === 3 ? p[12 + k] : 0));
            found[4 * column + row] = sum;
        }
    }
    return found;
}

/** @param {Float64Array} m 4x4 in columns @returns {number[]} x y z w */
export function quaternion(m) {
    const trace = m[0] + m[5] + m[10];
    const squares = [1 + m[0] - m[5] - m[10], 1 - m[0] + m[5] - m[10], 1 - m[0] - m[5] + m[10], 1 + trace];
    const largest = squares.indexOf(Math.max(...squares));
    const [a, b, c] = [m[6] - m[9], m[8] - m[2], m[1] - m[4]];
    const [d, e, f] = [m[1] + m[4], m[2] + m[8], m[6] + m[9]];
    const q = [[squares[0], d, e, a], [d, squares[1], f, b], [e, f, squares[2], c], [a, b, c, squares[3]]][largest];
    const norm = Math.hypot(...q);
    return q.map((part) => part / norm);
}

/** The one of q and -q that is nearer to the last. @param {number[]} q @param {Float32Array} turns @param {number} last */
function continued(q, turns, last) {
    if (last < 0) return q;
    const dot = q.reduce((sum, part, k) => sum + part * turns[last + k], 0);
    return dot < 0 ? q.map((part) => -part) : q;
}

class File {
    constructor() {
        /** @type {Uint8Array[]} */
        this.parts = [];
        this.length = 0;
        /** @type {any[]} */
        this.views = [];
        /** @type {any[]} */
        this.accessors = [];
        /** @type {any[]} */
        this.meshes = [];
        /** @type {any[]} */
        this.materials = [];
    }

    /** @param {Float32Array | Uint32Array} array @param {number} width @param {boolean} [bounds] @returns {number} */
    accessor(array, width, bounds = false) {
        this.views.push({ buffer: 0, byteOffset: this.length, byteLength: array.byteLength });
        this.parts.push(new Uint8Array(array.buffer, array.byteOffset, array.byteLength));
        this.length += array.byteLength;
        const ends = bounds ? { min: extreme(array, width, Math.min), max: extreme(array, width, Math.max) } : {};
        return this.accessors.push({
            bufferView: this.views.length - 1, componentType: array instanceof Uint32Array ? UNSIGNED : FLOAT,
            count: array.length / width, type: ["", "SCALAR", "", "VEC3", "VEC4"][width], ...ends,
        }) - 1;
    }

    /** @param {import("./types").Solid} solid @returns {number} */
    mesh({ name, shape, colour, opacity = 1 }) {
        const geometry = geometryOf(shape);
        const attributes = {
            POSITION: this.accessor(Float32Array.from(geometry.getAttribute("position").array), 3, true),
            NORMAL: this.accessor(units(Float32Array.from(geometry.getAttribute("normal").array)), 3),
        };
        const index = geometry.getIndex();
        const indices = index ? { indices: this.accessor(Uint32Array.from(index.array), 1) } : {};
        geometry.dispose();
        return this.meshes.push({ name, primitives: [{ attributes, ...indices, material: this.material(colour, opacity) }] }) - 1;
    }

    /** @param {string} colour @param {number} opacity @returns {number} */
    material(colour, opacity) {
        const name = `${colour} ${opacity}`;
        const found = this.materials.findIndex((material) => material.name === name);
        if (found >= 0) return found;
        const linear = rgbOf(colour).map((part) => (part / 255) ** 2.2);
        return this.materials.push({
            name, doubleSided: true, pbrMetallicRoughness: { baseColorFactor: [...linear, opacity], metallicFactor: 0, roughnessFactor: 0.7 },
            ...(opacity < 1 ? { alphaMode: "BLEND" } : {}),
        }) - 1;
    }

    /** Places of the first instant in the nodes, tracks for those that move. */
    /** @param {any[]} nodes @param {import("./types").Joint[]} joints @param {Tracks} tracks */
    animation(nodes, joints, { time, places, turns }) {
        /** @type {any[]} */
        const channels = [];
        /** @type {any[]} */
        const samplers = [];
        let input = -1;
        joints.forEach((_, i) => {
            nodes[i + 1].translation = [...places[i].subarray(0, 3)];
            nodes[i + 1].rotation = [...turns[i].subarray(0, 4)];
            for (const [path, track, width] of /** @type {[string, Float32Array, number][]} */ ([["translation", places[i], 3], ["rotation", turns[i], 4]])) {
                if (track.every((value, k) => Math.abs(value - track[k % width]) < 1e-7)) continue;
                if (input < 0) input = this.accessor(time, 1, true);
                samplers.push({ input, output: this.accessor(track, width), interpolation: "LINEAR" });
                channels.push({ sampler: samplers.length - 1, target: { node: i + 1, path } });
            }
        });
        return { channels, samplers };
    }

    /** @param {any} json @returns {Uint8Array<ArrayBuffer>} */
    bytes(json) {
        const { views, accessors, meshes, materials } = this;
        const all = { ...json, ...(views.length ? { buffers: [{ byteLength: this.length }], bufferViews: views, accessors } : {}), ...(meshes.length ? { meshes, materials } : {}) };
        const text = new TextEncoder().encode(JSON.stringify(all));
        const padded = Math.ceil(text.length / 4) * 4;
        const file = new Uint8Array(20 + padded + (this.length ? 8 + this.length : 0));
        const view = new DataView(file.buffer);
        [0x46546c67, 2, file.length, padded, 0x4e4f534a].forEach((value, i) => view.setUint32(4 * i, value, true));
        file.fill(0x20, 20, 20 + padded);
        file.set(text, 20);
        if (!this.length) return file;
        view.setUint32(20 + padded, this.length, true);
        view.setUint32(24 + padded, 0x004e4942, true);
        this.parts.reduce((at, part) => (file.set(part, at), at + part.length), 28 + padded);
        return file;
    }
}

/** @param {Float32Array | Uint32Array} array @param {number} width @param {(...values: number[]) => number} which */
function extreme(array, width, which) {
    const found = [...array.subarray(0, width)];
    for (let i = width; i < array.length; i++) found[i % width] = which(found[i % width], array[i]);
    return found;
}

/** Normals of length one, as the format asks; where there is none, up. @param {Float32Array} normals */
function units(normals) {
    for (let i = 0; i < normals.length; i += 3) {
        const length = Math.hypot(normals[i], normals[i + 1], normals[i + 2]);
        normals.set(length > 0 ? [normals[i] / length, normals[i + 1] / length, normals[i + 2] / length] : [0, 0, 1], i);
    }
    return normals;
}

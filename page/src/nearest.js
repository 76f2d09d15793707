// The two points of a machine's parts that are nearest to each other now: a line between them, and how far they are apart.
import { BufferAttribute, BufferGeometry, Group, LineBasicMaterial, LineSegments, Mesh, MeshBasicMaterial, SphereGeometry, Vector3 } from "three";
import { locate, sceneOf, sceneOfRun } from "./instant.js";
import { Text } from "./labels.js";
import { decimals, fixed, shown } from "./units.js";

/** @typedef {import("./types").State} State */
/** @typedef {import("./types").Run} Run */
/** @typedef {{from: number[], to: number[], distance: number, names: string, near: boolean}} Gap near: less than is required */

const FREE = "#7b1fa2", NEAR = "#d32f2f";
/** Of the dots; how far the text is from them [pixels]. */
const DOT = 3, ASIDE = 40, LETTER = 15;

/**
 * What comes nearest at a time of a run; null where nobody looked. Between two samples with the same pair it is half-way;
 * else it is that of the sample that is nearer.
 * @param {Run} run @param {number} time @returns {Gap | null}
 */
export function gapAt({ nearest, time: instants }, time) {
    if (!nearest) return null;
    const { points, distances, pairs, names, required } = nearest, { i, part } = locate(instants.data, time);
    const j = Math.min(i + 1, pairs.data.length - 1), same = pairs.data[i] === pairs.data[j];
    const share = same ? part : Math.round(part);
    const at = (/** @type {import("./types").Numbers} */ data, /** @type {number} */ width, /** @type {number} */ k) =>
        (share === 1 ? 0 : (1 - share) * data[i * width + k]) + (share === 0 ? 0 : share * data[j * width + k]);
    const [from, to] = [0, 3].map((first) => [0, 1, 2].map((k) => at(points.data, 6, first + k)));
    const distance = at(distances.data, 1, 0), pair = pairs.data[share < 0.5 ? i : j];
    return { from, to, distance, names: names[pair], near: distance < required };
}

/** What comes nearest in the picture; null where it is not known: in a hand, and with other lengths. @param {State} state @returns {Gap | null} */
export function gapOf(state) {
    const { document, hand, time } = state, run = document.runs[state.run];
    if (!run || hand || sceneOf(state) !== sceneOfRun(document, run)) return null;
    return gapAt(run, time);
}

/** A distance in words. @param {Gap} gap @param {import("./units.js").System} units */
export function told({ distance, names }, units) {
    const { unit, factor } = shown("m", units), size = Math.abs(distance * factor);
    return `${names} ${distance < 0 ? "overlap by " : ""}${fixed(size, decimals(size))} ${unit}`;
}

export class Nearest {
    constructor() {
        this.group = new Group();
        this.text = new Text("", FREE);
        this.ball = new MeshBasicMaterial({ color: FREE });
        this.line = new LineBasicMaterial({ color: FREE });
        const sphere = new SphereGeometry(1, 16, 12);
        this.ends = [0, 1].map(() => new Mesh(sphere, this.ball));
        this.geometry = new BufferGeometry();
        this.geometry.setAttribute("position", new BufferAttribute(new Float32Array(12), 3)); // between them, and to the text
        const lines = new LineSegments(this.geometry, this.line);
        lines.frustumCulled = false;
        this.group.add(...this.ends, lines);
    }

    /** @param {State} state @param {import("./eye.js").Eye} eye @param {{tint: (colour: string) => string, halo: string}} look */
    show(state, eye, look) {
        const gap = state.layers.nearest ? gapOf(state) : null;
        this.group.visible = this.text.sprite.visible = gap !== null;
        if (!gap) return;
        const ink = look.tint(gap.near ? NEAR : FREE);
        const [from, to] = [gap.from, gap.to].map(([x, y, z]) => new Vector3(x, y, z)), middle = from.clone().lerp(to, 0.5);
        const metre = eye.metre(middle), aside = this._aside(eye, middle).multiplyScalar(ASIDE * metre), at = middle.clone().add(aside);
        this.ball.color.set(ink);
        this.line.color.set(ink);
        [from, to].forEach((place, k) => {
            this.ends[k].position.copy(place);
            this.ends[k].scale.setScalar(DOT * metre);
        });
        const places = this.geometry.attributes.position;
        [from, to, middle, at].forEach(({ x, y, z }, k) => places.setXYZ(k, x, y, z));
        places.needsUpdate = true;
        this.text.write(told(gap, state.units), ink, look.halo);
        this.text.sprite.position.copy(at.addScaledVector(aside, LETTER / ASIDE)).applyMatrix4(eye.world.matrixWorld);
        this.text.resize(LETTER * eye.unitAt(this.text.sprite.position));
    }

    /** The direction in which the text stands, upwards in the picture. @param {import("./eye.js").Eye} eye @param {Vector3} middle */
    _aside(eye, middle) {
        const [x, y] = eye.pixel(middle), near = eye.ray(x, y), above = eye.ray(x, y - 1), depth = middle.clone().sub(near.start).dot(near.along);
        return above.start.addScaledVector(above.along, depth).sub(middle).normalize();
    }
}

// Forces and moments as arrows in proportion to them, each with its value at the tip.
import { ConeGeometry, CylinderGeometry, Group, Mesh, MeshLambertMaterial, Quaternion, Vector3 } from "three";
import { Text, shown } from "./labels.js";

/** @typedef {import("./types").ShownLoad} ShownLoad */

/** Length of the arrow of the largest load, in radii of the scene. */
const LONGEST = 0.5;
/** Radius of a shaft, in radii of the scene. */
const SHAFT = 0.011;
const HEAD = 4.4, HEAD_RADIUS = 2.3, SLIMMEST = 0.35, SECOND = 0.75; // in radii of the shaft, in heads
/** More loads than these have no values beside them. */
const CROWD = 16;
/** A load below this share of the largest of its unit is rounding, or zero: it has no value beside it. */
const NEGLIGIBLE = 1e-6;
const LETTERS = 13, GAP = 4, EDGE = 6; // pixels
const UP = new Vector3(0, 0, 1);

const shaft = new CylinderGeometry(1, 1, 1, 16).rotateX(Math.PI / 2).translate(0, 0, 0.5);
const cone = new ConeGeometry(1, 1, 22).rotateX(Math.PI / 2).translate(0, 0, 0.5);

/** The nearest height where a text lies over no other and in the picture. @param {number[]} box x, y and half its width and height @param {number[][]} others @param {number} height */
function free(box, others, height) {
    const [x, wanted, half, high] = box;
    const inside = (/** @type {number} */ y) => Math.min(Math.max(y, high + EDGE), height - high - EDGE);
    for (let step = 0; step <= 2 * others.length; step++) {
        const y = inside(wanted + (step % 2 ? -1 : 1) * Math.ceil(step / 2) * (2 * high - 2));
        if (!others.some((o) => Math.abs(o[0] - x) < o[2] + half - 4 && Math.abs(o[1] - y) < o[3] + high - 3)) return y;
    }
    return inside(wanted);
}

/**
 * The largest load of each unit over runs, of those that are to be seen.
 * @param {import("./types").Run[]} runs @param {Record<string, boolean>} [layers]
 */
export function largest(runs, layers = {}) {
    /** @type {Record<string, number>} */
    const found = {};
    for (const run of runs) {
        const curves = new Map(run.curves.map((curve) => [curve.key, curve.values.data]));
        for (const load of run.loads) {
            if (!seen(load, layers)) continue;
            const { curve, values, unit } = load;
            const data = curve ? curves.get(curve) : values?.data;
            const step = curve ? 1 : 3;
            for (let i = 0; data && i < data.length; i += step) {
                const size = step === 1 ? Math.abs(data[i]) : Math.hypot(data[i], data[i + 1], data[i + 2]);
                if (size > (found[unit] ?? 0)) found[unit] = size;
            }
        }
    }
    return found;
}

/** Whether a load is to be seen. @param {{layer?: string}} load @param {Record<string, boolean>} layers */
export const seen = ({ layer }, layers) => layer === undefined || layers[layer] !== false;

/** One arrow: a shaft and a head, of a moment two heads. */
class Arrow {
    /** @param {boolean} double */
    constructor(double) {
        this.material = new MeshLambertMaterial();
        this.group = new Group();
        this.shaft = new Mesh(shaft, this.material);
        this.heads = (double ? [0, 1] : [0]).map(() => new Mesh(cone, this.material));
        this.group.add(this.shaft, ...this.heads);
        this.text = new Text();
    }

    /** @param {Vector3} start @param {Vector3} along one long @param {number} length @param {number} radius */
    place(start, along, length, radius) {
        this.group.position.copy(start);
        this.group.quaternion.copy(new Quaternion().setFromUnitVectors(UP, along));
        const head = Math.min(length, HEAD * radius);
        this.shaft.scale.set(radius, radius, Math.max(length - head, 1e-9));
        const wide = HEAD_RADIUS * Math.max(head / HEAD, SLIMMEST * radius); // a short arrow is a small one, not a flat one
        this.heads.forEach((mesh, i) => {
            mesh.scale.set(wide, wide, head);
            mesh.position.set(0, 0, Math.max(length - head - i * SECOND * head, 0));
        });
    }
}

/** All loads of an instant. */
export class Arrows {
    /** @param {number} radius of the scene [m] */
    constructor(radius) {
        this.radius = radius;
        this.group = new Group(); // in metres
        this.texts = new Group(); // in the units of the picture's space
        /** @type {Map<string, Arrow>} */
        this.arrows = new Map();
        /** @type {Record<string, number>} */
        this.scales = {};
        /** What is drawn, for tests and readers: value, length in the scale, whether it is cut off, place in the picture. */
        /** @type {{key: string, value: number, length: number, drawn: number, cut: boolean, tip: number[], text: number[], words: string}[]} */
        this.drawn = [];
    }

    /** How long the arrow of a load is [m]. @param {number} value @param {string} unit */
    length(value, unit) {
        return (LONGEST * this.radius * Math.abs(value)) / (this.scales[unit] || 1);
    }

    /**
     * Draw the loads of an instant as they are seen from a camera.
     * @param {ShownLoad[]} loads @param {import("./eye.js").Eye} eye
     * @param {{halo: string, tint: (colour: string) => string}} look @param {boolean} [known] whether loads that are not
     * determined are so, and not just unknown to the page
     */
    show(loads, eye, look, known = true) {
        const seen = new Set();
        this.drawn = [];
        for (const shownLoad of loads) {
            seen.add(shownLoad.load.key);
            this._show(shownLoad, eye, look, loads.length <= CROWD && (known || !Number.isNaN(shownLoad.value)));
        }
        for (const [key, arrow] of this.arrows) {
            if (!seen.has(key)) arrow.group.visible = arrow.text.sprite.visible = false;
        }
        this._spread(eye);
    }

    /** @param {ShownLoad} shownLoad @param {import("./eye.js").Eye} eye @param {{halo: string, tint: (colour: string) => string}} look @param {boolean} spoken */
    _show({ load, at, vector, value }, eye, look, spoken) {
        const arrow = this._arrow(load);
        const colour = look.tint(load.colour ?? "#5f6b76");
        const start = new Vector3(at[0], at[1], at[2]);
        const size = Math.hypot(vector[0], vector[1], vector[2]);
        const known = Number.isFinite(size);
        const length = known ? this.length(size, load.unit) : 0;
        const along = known && size > 0 ? new Vector3(vector[0], vector[1], vector[2]).divideScalar(size) : UP.clone();
        const part = eye.reach(start, along.clone().multiplyScalar(length));
        const drawn = Math.max(part, 0) * length;
        arrow.material.color.set(colour);
        arrow.group.visible = drawn > 1e-6 * this.radius;
        if (arrow.group.visible) arrow.place(start, along, drawn, SHAFT * this.radius);
        const tip = start.clone().addScaledVector(along, drawn);
        const cut = known && part < 1 && length > 1e-6 * this.radius;
        const words = Number.isNaN(value) ? "undetermined" : `${shown(value, load.unit)}${cut ? " ⋯" : ""}`;
        const counts = Math.abs(value) >= NEGLIGIBLE * (this.scales[load.unit] ?? 0) || Number.isNaN(value);
        arrow.text.sprite.visible = spoken && counts && (known || Number.isNaN(value));
        arrow.text.write(words, colour, look.halo);
        const [x, y] = eye.pixel(tip);
        const [x2, y2] = eye.pixel(tip.clone().addScaledVector(along, 0.02 * this.radius));
        const run = Math.hypot(x2 - x, y2 - y); // of its direction in the picture: none where it points at the eye
        const head = run > 0.5 ? 0 : (HEAD_RADIUS * SHAFT * this.radius) / eye.metre(tip);
        const away = LETTERS / 2 + GAP + (cut ? LETTERS / 2 : 0) + head;
        const [dx, dy] = run > 0.5 ? [(x2 - x) / run, (y2 - y) / run] : [0, -1];
        const half = (arrow.text.aspect * LETTERS * 60) / 44 / 2;
        this.drawn.push({
            key: load.key, value, length, drawn, cut, words, tip: [x, y],
            text: [x + dx * (away + Math.abs(dx) * (half - LETTERS / 2)), y + dy * away, half, LETTERS / 2 + 2],
        });
    }

    /** Move values apart that lie over each other, and into the picture. @param {import("./eye.js").Eye} eye */
    _spread(eye) {
        /** @type {number[][]} */
        const placed = [];
        for (const entry of this.drawn) {
            const arrow = /** @type {Arrow} */ (this.arrows.get(entry.key));
            if (!arrow.text.sprite.visible) continue;
            const box = entry.text;
            const half = box[2];
            box[0] = Math.min(Math.max(box[0], half + EDGE), eye.width - half - EDGE);
            box[1] = free(box, placed, eye.height);
            placed.push(box);
            arrow.text.sprite.position.copy(eye.facing(box[0], box[1]));
            arrow.text.resize(LETTERS * eye.unit);
        }
    }

    /** @param {import("./types").Load} load */
    _arrow(load) {
        let arrow = this.arrows.get(load.key);
        if (!arrow) {
            arrow = new Arrow(load.kind === "moment");
            this.arrows.set(load.key, arrow);
            this.group.add(arrow.group);
            this.texts.add(arrow.text.sprite);
        }
        return arrow;
    }
}

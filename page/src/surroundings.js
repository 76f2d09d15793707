// What stands still around a machine: floor, lights, and lines, labels and pictures of a document.
import {
    BufferAttribute, BufferGeometry, DataTexture, DirectionalLight, DoubleSide, Group, HemisphereLight, LineBasicMaterial,
    LineSegments, Mesh, MeshBasicMaterial, NearestFilter, PlaneGeometry, SRGBColorSpace,
} from "three";
import { Text } from "./labels.js";

/** Light from above, and a lamp that goes with the eye. @param {import("three").Scene} scene */
export function lighten(scene) {
    const lamp = new DirectionalLight("#ffffff", 1.9);
    scene.add(new HemisphereLight("#ffffff", "#b9c2cc", 2.0), lamp);
    return lamp;
}

/** Points as a line. @param {ArrayLike<number>} points x y z of each, NaN for a gap @param {string} colour */
export function lineOf(points, colour) {
    const geometry = new BufferGeometry();
    /** @type {number[]} */
    const pairs = [];
    for (let i = 3; i + 2 < points.length; i += 3) {
        const pair = [];
        for (let k = i - 3; k < i + 3; k++) pair.push(points[k]);
        if (pair.every(Number.isFinite)) pairs.push(...pair);
    }
    geometry.setAttribute("position", new BufferAttribute(new Float32Array(pairs), 3));
    return new LineSegments(geometry, new LineBasicMaterial({ color: colour }));
}

/** A square grid. @param {number} radius of the scene [m] @param {number[]} centre @param {number} height [m] */
export function floorOf(radius, centre, height) {
    const power = 10 ** Math.floor(Math.log10(radius / 4));
    const mesh = power * Math.max(...[1, 2, 5].filter((step) => step * power <= radius / 4));
    const count = Math.ceil((1.7 * radius) / mesh);
    const [x, y] = [0, 1].map((i) => mesh * Math.round(centre[i] / mesh));
    const reach = count * mesh;
    const places = [];
    for (let i = -count; i <= count; i++) {
        places.push(x + i * mesh, y - reach, height, x + i * mesh, y + reach, height);
        places.push(x - reach, y + i * mesh, height, x + reach, y + i * mesh, height);
    }
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(new Float32Array(places), 3));
    return new LineSegments(geometry, new LineBasicMaterial());
}

/** The labels of a document, in groups like those of its solids. */
export class Labels {
    /** @param {import("./types").Scene} scene */
    constructor(scene) {
        this.group = new Group();
        this.all = scene.labels.map((label) => {
            const text = new Text(label.text, label.colour);
            this.group.add(text.sprite);
            return { label, text };
        });
    }

    /**
     * Put them where they belong.
     * @param {(joint: number, at: number[]) => number[]} place of a point, in the fixed frame [m]
     * @param {import("./eye.js").Eye} eye @param {Record<string, boolean>} layers
     * @param {{tint: (colour: string) => string, halo: string, ink: string}} look @param {number} radius
     */
    show(place, eye, layers, look, radius) {
        for (const { label, text } of this.all) {
            text.sprite.visible = layers[label.layer ?? ""] ?? true;
            if (!text.sprite.visible) continue;
            const [x, y, z] = place(label.joint ?? -1, label.at);
            text.sprite.position.set(x, y, z).applyMatrix4(eye.world.matrixWorld);
            text.write(label.text, look.tint(label.colour ?? look.ink), look.halo);
            const apparent = eye.unitAt(text.sprite.position);
            text.resize(Math.min(Math.max(label.height / radius, 11 * apparent), 30 * apparent));
        }
    }
}

/** A coloured picture in the plane x = 0. */
export class MapPicture {
    constructor() {
        this.material = new MeshBasicMaterial({ transparent: true, side: DoubleSide, depthWrite: false });
        this.mesh = new Mesh(new PlaneGeometry(1, 1), this.material);
        this.mesh.quaternion.set(0.5, 0.5, 0.5, 0.5); // its x, y, z along y, z, x
        this.mesh.visible = false;
        /** @type {import("./types").Picture | null} */
        this.shown = null;
    }

    /** @param {import("./types").Picture | null} picture @param {boolean} wanted */
    show(picture, wanted) {
        this.mesh.visible = wanted && picture !== null;
        if (!picture || picture === this.shown) return;
        this.shown = picture;
        const { y, z, width, height, rgba } = picture;
        const old = /** @type {DataTexture | null} */ (this.material.map);
        if (old && old.image.width === width && old.image.height === height) {
            old.image.data = rgba;
            old.needsUpdate = true;
        } else {
            old?.dispose();
            this.material.map = new DataTexture(rgba, width, height);
            this.material.map.colorSpace = SRGBColorSpace;
            this.material.map.magFilter = NearestFilter;
            this.material.map.needsUpdate = true;
            this.material.needsUpdate = true;
        }
        this.mesh.scale.set(y[1] - y[0], z[1] - z[0], 1);
        this.mesh.position.set(0, (y[0] + y[1]) / 2, (z[0] + z[1]) / 2);
    }
}


// What a camera sees: between metres, the space of the picture and pixels.
import { Vector3, Vector4 } from "three";

/** Room that is kept for a value at the tip of an arrow [pixels]: left, right, bottom, top. */
const ROOM = [34, 34, 24, 24];

/** A camera and a picture of so many pixels; the scene is drawn in a group, in metres. */
export class Eye {
    /** @param {import("three").Camera} camera @param {import("three").Object3D} world @param {number} width @param {number} height */
    constructor(camera, world, width, height) {
        this.camera = camera;
        this.world = world;
        this.width = width;
        this.height = height;
    }

    /** Where a point [m] is in the picture [pixels], from its upper left corner. @param {Vector3} point @returns {number[]} */
    pixel(point) {
        const seen = point.clone().applyMatrix4(this.world.matrixWorld).project(this.camera);
        return [((seen.x + 1) / 2) * this.width, ((1 - seen.y) / 2) * this.height];
    }

    /** How much of a line from a start [m] is in the picture. @param {Vector3} start @param {Vector3} line */
    reach(start, line) {
        const [a, b] = [start, start.clone().add(line)].map((p) => {
            const { x, y, z } = p.clone().applyMatrix4(this.world.matrixWorld);
            return new Vector4(x, y, z, 1).applyMatrix4(this.camera.matrixWorldInverse).applyMatrix4(this.camera.projectionMatrix);
        });
        const sizes = [this.width, this.width, this.height, this.height];
        const out = [-a.x, a.x, -a.y, a.y].map((x) => x / a.w); // to each side
        const limits = sizes.map((size, i) => Math.max(1 - (2 * ROOM[i]) / size, 0.2));
        return partInside(a, b.sub(a), limits.map((limit, i) => (out[i] > limit ? 1 : limit)));
    }

    /** The point of the picture's space that is seen at a pixel, near the eye. @param {number} x @param {number} y */
    facing(x, y) {
        return new Vector3((2 * x) / this.width - 1, 1 - (2 * y) / this.height, FACING).unproject(this.camera);
    }

    /** Size of a pixel there. */
    get unit() {
        return this.facing(0, 0).distanceTo(this.facing(0, this.height)) / this.height;
    }

    /** Size of a pixel at a point of the picture's space. @param {Vector3} point */
    unitAt(point) {
        const { z } = point.clone().project(this.camera);
        const [a, b] = [-1, 1].map((y) => new Vector3(0, y, z).unproject(this.camera));
        return a.distanceTo(b) / this.height;
    }

    /** How many metres a pixel is at a point [m]. @param {Vector3} point */
    metre(point) {
        return this.unitAt(point.clone().applyMatrix4(this.world.matrixWorld)) / this.world.scale.x;
    }

    /** The ray through a pixel [m]. @param {number} x @param {number} y */
    ray(x, y) {
        const inverse = this.world.matrixWorld.clone().invert();
        const [near, far] = [-1, 1].map((z) =>
            new Vector3((2 * x) / this.width - 1, 1 - (2 * y) / this.height, z).unproject(this.camera).applyMatrix4(inverse));
        return { start: near, along: far.sub(near).normalize() };
    }
}

/** Depth of texts that face the eye, from -1 to 1. */
const FACING = -0.5;

/**
 * How much of a line from a start lies in the picture, from its start: 1 all, 0 nothing.
 * @param {Vector4} a start in clip coordinates @param {Vector4} b what is added to it at the end
 * @param {number[]} limits how far to left, right, bottom and top one may go, 1: to the edge
 */
export function partInside(a, b, [left, right, bottom, top]) {
    let part = 1;
    for (const [p, q] of [
        [right * a.w - a.x, right * b.w - b.x], [left * a.w + a.x, left * b.w + b.x],
        [top * a.w - a.y, top * b.w - b.y], [bottom * a.w + a.y, bottom * b.w + b.y],
    ]) {
        if (p < 0) return 0;
        if (p + part * q < 0) part = Math.min(part, -p / q);
    }
    return part;
}

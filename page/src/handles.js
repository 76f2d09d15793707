// What the hand takes hold of in the picture: P, and a ring around it for the tilt.
import { Group, Mesh, MeshBasicMaterial, SphereGeometry, TorusGeometry, Vector3 } from "three";

/** Radius of the ring, in radii of the scene. */
const RING = 0.26;
const COLOUR = "#7c3aed";
/** How near the pointer must be [pixels]. */
const NEAR = { mouse: 12, touch: 26 };
/** The ring is used where the cosine between it and the eye is more than this. */
const EDGE_ON = 0.3;

export class Handles {
    /** @param {number} radius of the scene [m] @param {import("./types").Traced} traced */
    constructor(radius, traced) {
        this.radius = RING * radius;
        this.traced = traced;
        this.group = new Group();
        const ink = new MeshBasicMaterial({ color: COLOUR });
        this.ink = ink;
        const ball = new SphereGeometry(1, 20, 14);
        this.P = new Mesh(ball, ink);
        this.knob = new Mesh(ball, ink);
        this.ring = new Mesh(
            new TorusGeometry(this.radius, 0.012 * radius, 10, 72).rotateX(Math.PI / 2), // around y
            new MeshBasicMaterial({ color: COLOUR, transparent: true, opacity: 0.45 }),
        );
        this.group.add(this.P, this.knob, this.ring);
        /** Whether the ring is seen from the side, so that a bar is in its place. */
        this.edgeOn = false;
    }

    /** @param {(colour: string) => string} tint */
    tint(tint) {
        for (const material of [this.ink, this.ring.material]) material.color.set(tint(COLOUR));
    }

    /** @param {Vector3} P [m] @param {number} theta @param {import("./eye.js").Eye} eye */
    show(P, theta, eye) {
        this.P.position.copy(P);
        this.ring.position.copy(P);
        this.knob.position.copy(this.onRing(P, theta));
        const at = eye.pixel(P);
        const { along } = eye.ray(at[0], at[1]);
        this.edgeOn = Math.abs(along.y) < EDGE_ON;
        this.ring.visible = this.knob.visible = !this.edgeOn;
        for (const [mesh, pixels] of /** @type {[Mesh, number][]} */ ([[this.P, 6.5], [this.knob, 6.5]])) {
            mesh.scale.setScalar(pixels * eye.metre(mesh.position));
        }
    }

    /** Where the knob is: the ring turns with the platform, about y. @param {Vector3} P @param {number} theta */
    onRing(P, theta) {
        return P.clone().add(new Vector3(Math.cos(theta), 0, -Math.sin(theta)).multiplyScalar(this.radius));
    }

    /**
     * What is under the pointer.
     * @param {number} x @param {number} y [pixels] @param {string} kind of pointer @param {import("./eye.js").Eye} eye
     * @returns {"P" | "theta" | null}
     */
    hit(x, y, kind, eye) {
        const near = kind === "mouse" || kind === "pen" ? NEAR.mouse : NEAR.touch;
        const away = (/** @type {Vector3} */ point) => Math.hypot(...eye.pixel(point).map((u, i) => u - [x, y][i]));
        const toP = away(this.P.position);
        const toKnob = this.edgeOn ? Infinity : away(this.knob.position);
        if (Math.min(toP, toKnob) < near) return toP <= toKnob ? "P" : "theta";
        if (this.edgeOn) return null;
        let least = Infinity;
        for (let i = 0; i < 72; i++) least = Math.min(least, away(this.onRing(this.P.position, (i * Math.PI) / 36)));
        return least < 0.7 * near ? "theta" : null;
    }
}

/**
 * Where P must go so that it is seen at a pixel; along what is seen of y and z where their plane is edge-on.
 * @param {Vector3} P [m] @param {number} x @param {number} y [pixels] @param {import("./eye.js").Eye} eye
 */
export function under(P, x, y, eye) {
    const { start, along } = eye.ray(x, y);
    if (Math.abs(along.x) > 0.12) return start.addScaledVector(along, (P.x - start.x) / along.x);
    const found = P.clone();
    const step = 1e-3 / eye.world.scale.x;
    for (let turn = 0; turn < 4; turn++) {
        const here = eye.pixel(found);
        const slopes = [new Vector3(0, 1, 0), new Vector3(0, 0, 1)].map((axis) => {
            const there = eye.pixel(found.clone().addScaledVector(axis, step));
            return [0, 1].map((i) => (there[i] - here[i]) / step);
        });
        const sizes = slopes.map(([u, v]) => u * u + v * v);
        const i = sizes[0] > sizes[1] ? 0 : 1;
        const move = ((x - here[0]) * slopes[i][0] + (y - here[1]) * slopes[i][1]) / sizes[i];
        if (i === 0) found.y += move;
        else found.z += move;
    }
    return found;
}

/** Angle about y of a ray's point in the plane of the ring. @param {Vector3} P @param {number} x @param {number} y @param {import("./eye.js").Eye} eye */
export function angleAt(P, x, y, eye) {
    const { start, along } = eye.ray(x, y);
    const point = start.addScaledVector(along, (P.y - start.y) / along.y).sub(P);
    return Math.atan2(-point.z, point.x);
}

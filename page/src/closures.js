// Where loops are closed: both frames of each closure, and a line between them where they are apart.
import { BufferAttribute, BufferGeometry, Group, LineBasicMaterial, LineSegments, Mesh, MeshBasicMaterial, SphereGeometry } from "three";
import { pointOf } from "./tree.js";

const COLOURS = ["#db2777", "#f59e0b"];

export class Closures {
    /** @param {import("./types").Closure[]} closures @param {number} radius of the scene [m] */
    constructor(closures, radius) {
        this.closures = closures;
        this.group = new Group();
        const ball = new SphereGeometry(1, 16, 12);
        const inks = COLOURS.map((color) => new MeshBasicMaterial({ color, transparent: true, opacity: 0.75 }));
        this.ends = closures.map(() => inks.map((ink, i) => {
            const mesh = new Mesh(ball, ink);
            mesh.scale.setScalar((i ? 0.011 : 0.016) * radius);
            this.group.add(mesh);
            return mesh;
        }));
        this.geometry = new BufferGeometry();
        this.geometry.setAttribute("position", new BufferAttribute(new Float32Array(6 * closures.length), 3));
        const lines = new LineSegments(this.geometry, new LineBasicMaterial({ color: COLOURS[0] }));
        lines.frustumCulled = false;
        this.group.add(lines);
    }

    /** @param {Float64Array} placements @param {boolean} wanted */
    show(placements, wanted) {
        this.group.visible = wanted && this.closures.length > 0;
        if (!this.group.visible) return;
        const places = this.geometry.attributes.position;
        this.closures.forEach((closure, i) => {
            [[closure.joint1, closure.placement1], [closure.joint2, closure.placement2]].forEach(([joint, placement], k) => {
                const at = pointOf(placements, /** @type {number} */ (joint), /** @type {number[]} */ (placement));
                this.ends[i][k].position.set(at[0], at[1], at[2]);
                places.setXYZ(2 * i + k, at[0], at[1], at[2]);
            });
        });
        places.needsUpdate = true;
    }
}

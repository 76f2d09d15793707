// The solids of a document's scene as meshes of three.js, one group for each joint.
import {
    BoxGeometry, BufferAttribute, BufferGeometry, CapsuleGeometry, Color, CylinderGeometry, DoubleSide, FrontSide, Group, Mesh,
    MeshLambertMaterial, SphereGeometry,
} from "three";
import { toCreasedNormals } from "three/examples/jsm/utils/BufferGeometryUtils.js";

/** @typedef {import("./types").Solid} Solid */

const CREASE = Math.PI / 5;
/** Larger meshes keep smooth normals: what is sharp is not looked for in them. */
const LARGE = 60000;
export const ALARM = "#d9101f";

/** Draws all solids of a document; `place` moves them. */
export class Solids {
    /** @param {import("./types").Scene} scene */
    constructor(scene) {
        this.group = new Group();
        this.joints = scene.joints.map(() => still(new Group()));
        this.fixed = new Group();
        this.group.add(this.fixed, ...this.joints);
        this.meshes = scene.solids.map((solid) => this._mesh(solid));
    }

    /** @param {Solid} solid */
    _mesh(solid) {
        const opacity = solid.opacity ?? 1;
        const material = new MeshLambertMaterial({ color: solid.colour, opacity, transparent: opacity < 1, depthWrite: opacity === 1 });
        const mesh = new Mesh(geometryOf(solid.shape), material);
        const [x, y, z, qx, qy, qz, qw] = solid.placement;
        mesh.position.set(x, y, z);
        mesh.quaternion.set(qx, qy, qz, qw);
        mesh.updateMatrix();
        mesh.matrixAutoUpdate = false;
        mesh.name = solid.name;
        mesh.userData = { solid, colour: new Color(solid.colour) };
        (solid.joint < 0 ? this.fixed : this.joints[solid.joint]).add(mesh);
        return mesh;
    }

    /** Take the same solids with other sizes and places. @param {import("./types").Scene} scene */
    adopt(scene) {
        scene.solids.forEach((solid, i) => {
            const mesh = this.meshes[i], was = mesh.userData.solid;
            if (solid.shape !== was.shape) {
                mesh.geometry.dispose(); // a ghost that still draws it takes it up again
                mesh.geometry = geometryOf(solid.shape);
            }
            if (solid.placement !== was.placement) {
                const [x, y, z, qx, qy, qz, qw] = solid.placement;
                mesh.position.set(x, y, z);
                mesh.quaternion.set(qx, qy, qz, qw);
                mesh.updateMatrix();
                mesh.matrixWorldNeedsUpdate = true;
            }
            mesh.userData.solid = solid;
        });
    }

    /** Move all joints. @param {Float64Array} placements 4x4 in columns */
    place(placements) {
        this.joints.forEach((joint, i) => {
            for (let k = 0; k < 16; k++) joint.matrix.elements[k] = placements[16 * i + k];
            joint.matrixWorldNeedsUpdate = true;
        });
    }

    /** @param {Record<string, boolean>} layers */
    show(layers) {
        for (const mesh of this.meshes) mesh.visible = layers[mesh.userData.solid.layer ?? ""] ?? true;
    }

    /** Turn legs red, and the others back to their colours. @param {string[]} legs */
    mark(legs) {
        for (const mesh of this.meshes) {
            const { solid, colour } = mesh.userData;
            const marked = solid.leg !== undefined && legs.includes(solid.leg);
            mesh.material.color.set(marked ? ALARM : colour);
            mesh.material.emissive.set(marked ? "#500008" : "#000000");
        }
    }

    /** Take away what is before planes; the frame stays whole. @param {import("three").Plane[] | null} planes */
    cut(planes) {
        for (const { material, userData } of this.meshes) {
            if (userData.solid.joint < 0) continue;
            material.clippingPlanes = planes;
            material.side = planes ? DoubleSide : FrontSide;
            material.onBeforeCompile = planes ? capped : () => {};
            material.customProgramCacheKey = () => (planes ? "cut" : "whole");
            material.needsUpdate = true;
        }
    }
}

/** The moving solids once more, see-through, for a run that is compared. */
export class Ghost {
    /** @param {Solids} solids */
    constructor(solids) {
        this.group = new Group();
        this.material = new MeshLambertMaterial({ color: "#7c8794", opacity: 0.28, transparent: true, depthWrite: false });
        this.joints = solids.joints.map((joint) => {
            const group = still(new Group());
            for (const child of joint.children) {
                const mesh = new Mesh(/** @type {Mesh} */ (child).geometry, this.material);
                mesh.matrix.copy(child.matrix);
                mesh.matrixAutoUpdate = false;
                group.add(mesh);
            }
            return group;
        });
        this.group.add(...this.joints);
        this.place = Solids.prototype.place;
    }
}

/** Paint what is seen of the inside of a cut solid in one colour, as if it were full. @param {{fragmentShader: string}} shader */
function capped(shader) {
    const inside = "if (!gl_FrontFacing) gl_FragColor = vec4(0.35 * diffuse + 0.08, 1.0);";
    shader.fragmentShader = shader.fragmentShader.replace("#include <opaque_fragment>", `#include <opaque_fragment>\n${inside}`);
}

/** A group whose matrix is set, not composed. @param {Group} group */
function still(group) {
    group.matrixAutoUpdate = false;
    return group;
}

/** @param {import("./types").Shape} shape @returns {BufferGeometry} */
export function geometryOf(shape) {
    switch (shape.kind) {
        case "box": return new BoxGeometry(shape.size[0], shape.size[1], shape.size[2]);
        case "cylinder": return new CylinderGeometry(shape.radius, shape.radius, shape.length, 28).rotateX(Math.PI / 2);
        case "capsule": return new CapsuleGeometry(shape.radius, shape.length, 8, 24).rotateX(Math.PI / 2);
        case "sphere": return new SphereGeometry(shape.radius, 28, 18);
        case "mesh": return meshOf(shape);
        default: throw new Error(`a solid of kind ${/** @type {any} */ (shape).kind} is not known`);
    }
}

/** @param {Extract<import("./types").Shape, {kind: "mesh"}>} shape */
function meshOf({ positions, indices, scale, offset }) {
    const factor = typeof scale === "number" ? [scale, scale, scale] : scale ?? [1, 1, 1];
    const start = offset ?? [0, 0, 0];
    const places = Float32Array.from(positions.data, (x, i) => x * factor[i % 3] + start[i % 3]);
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(places, 3));
    geometry.setIndex(new BufferAttribute(Uint32Array.from(indices.data), 1));
    if (indices.data.length < LARGE) return toCreasedNormals(geometry, CREASE);
    geometry.computeVertexNormals();
    return geometry;
}

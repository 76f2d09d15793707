// Makes three.js's objects of what MeshCat's commands describe: JSON in the form of three.js, arrays as bytes.
import {
    BoxGeometry, BufferAttribute, BufferGeometry, CanvasTexture, CapsuleGeometry, Color, ConeGeometry, CylinderGeometry,
    Group, Line, LineBasicMaterial, LineLoop, LineSegments, Mesh, MeshBasicMaterial, MeshLambertMaterial,
    MeshPhongMaterial, PlaneGeometry, Points, PointsMaterial, SphereGeometry, Sprite, SpriteMaterial, TorusGeometry,
} from "three";
import { OBJLoader } from "three/examples/jsm/loaders/OBJLoader.js";
import { STLLoader } from "three/examples/jsm/loaders/STLLoader.js";

/** @typedef {Record<string, any>} Data */

/** @type {Record<string, (d: Data) => BufferGeometry>} */
const GEOMETRIES = {
    Box: (d) => new BoxGeometry(d.width, d.height, d.depth),
    Sphere: (d) => new SphereGeometry(d.radius, d.widthSegments ?? 32, d.heightSegments ?? 20),
    Cylinder: (d) => new CylinderGeometry(d.radiusTop, d.radiusBottom, d.height, d.radialSegments ?? 32),
    Cone: (d) => new ConeGeometry(d.radius, d.height, d.radialSegments ?? 32),
    Capsule: (d) => new CapsuleGeometry(d.radius, d.length ?? d.height, 8, d.radialSegments ?? 24),
    Plane: (d) => new PlaneGeometry(d.width, d.height, d.widthSegments, d.heightSegments),
    Torus: (d) => new TorusGeometry(d.radius, d.tube, d.radialSegments, d.tubularSegments, d.arc),
};

/** @type {Record<string, new (...of: any[]) => any>} */
const OBJECTS = { Mesh, Points, Line, LineSegments, LineLoop };

/** @type {Record<string, new (...of: any[]) => any>} */
const MATERIALS = {
    MeshBasicMaterial, MeshLambertMaterial, MeshPhongMaterial, MeshToonMaterial: MeshLambertMaterial,
    MeshStandardMaterial: MeshPhongMaterial, LineBasicMaterial, PointsMaterial,
};

/** What is drawn of a `set_object`; throws an Error for what this page does not draw. @param {Data} data */
export function objectOf(data) {
    const { object } = data;
    const by = (/** @type {string} */ list) => new Map((data[list] ?? []).map((/** @type {Data} */ one) => [one.uuid, one]));
    return built(object, by("geometries"), by("materials"), by("textures"));
}

/** @param {Data} object @param {Map<string, Data>} geometries @param {Map<string, Data>} materials @param {Map<string, Data>} textures @returns {any} */
function built(object, geometries, materials, textures) {
    const material = materials.get(object.material);
    let made;
    if (object.type === "Sprite") made = letters(material ?? {}, textures);
    else if (object.type === "Group" || object.type === "Object3D" || object.type === "Scene") made = new Group();
    else if (OBJECTS[object.type]) {
        made = new OBJECTS[object.type](geometryOf(geometries.get(object.geometry)), materialOf(material ?? {}));
    } else throw new Error(`a ${object.type} of MeshCat is not drawn`);
    if (object.matrix) {
        made.matrix.fromArray(object.matrix);
        made.matrix.decompose(made.position, made.quaternion, made.scale);
    }
    for (const child of object.children ?? []) made.add(built(child, geometries, materials, textures));
    return made;
}

/** @param {Data | undefined} data @returns {BufferGeometry} */
function geometryOf(data) {
    const type = String(data?.type);
    if (data && type === "BufferGeometry") return buffer(data.data);
    if (data && type.startsWith("_meshfile")) return meshFile(data);
    const make = GEOMETRIES[type.replace(/(Buffer)?Geometry$/, "")];
    if (!data || !make) throw new Error(`a ${type} of MeshCat is not drawn`);
    return make(data);
}

/** @param {Data} data */
function buffer({ attributes, index }) {
    const geometry = new BufferGeometry();
    for (const [name, one] of Object.entries(/** @type {Record<string, Data>} */ (attributes))) {
        geometry.setAttribute(name, new BufferAttribute(one.array, one.itemSize, Boolean(one.normalized)));
    }
    if (index) geometry.setIndex(new BufferAttribute(index.array, 1));
    if (!geometry.hasAttribute("normal")) geometry.computeVertexNormals();
    return geometry;
}

/** @param {Data} data */
function meshFile({ format, data }) {
    if (format === "stl") {
        const bytes = typeof data === "string" ? data : data.buffer.slice(data.byteOffset, data.byteOffset + data.byteLength);
        return new STLLoader().parse(bytes);
    }
    if (format === "obj") {
        const text = typeof data === "string" ? data : new TextDecoder().decode(data);
        const found = new OBJLoader().parse(text).children.find((child) => child instanceof Mesh);
        if (found instanceof Mesh) return found.geometry;
    }
    throw new Error(`a mesh in .${format} of MeshCat is not drawn`);
}

/** @param {Data} data */
function materialOf(data) {
    const Type = MATERIALS[data.type] ?? MeshPhongMaterial;
    const { color, side, transparent, opacity, wireframe, size } = data;
    const given = { color, side, transparent, opacity, wireframe, size, vertexColors: Boolean(data.vertexColors) };
    if (Type === LineBasicMaterial || Type === PointsMaterial) delete given.wireframe;
    if (Type !== PointsMaterial) delete given.size;
    return new Type(Object.fromEntries(Object.entries(given).filter(([, value]) => value !== undefined && value !== null)));
}

/** A text that faces the eye. @param {Data} material @param {Map<string, Data>} textures */
function letters(material, textures) {
    const texture = textures.get(material.map);
    if (texture?.type !== "_text") throw new Error("a picture of MeshCat is not drawn");
    const canvas = document.createElement("canvas");
    [canvas.width, canvas.height] = [256, 256];
    const pen = canvas.getContext("2d");
    if (pen) {
        pen.textAlign = "center";
        pen.textBaseline = "middle";
        pen.font = `${texture.font_size}px ${texture.font_face}`;
        pen.fillText(texture.text, 128, 128, 250);
    }
    return new Sprite(new SpriteMaterial({ map: new CanvasTexture(canvas), transparent: true, depthTest: material.depthTest ?? true }));
}

/** Give all that is below a node a colour, as MeshCat's property does. @param {any} node @param {number[]} rgba */
export function paint(node, rgba) {
    node.traverse((/** @type {any} */ one) => {
        if (!one.material) return;
        one.material.color = new Color(rgba[0], rgba[1], rgba[2]);
        one.material.opacity = rgba[3] ?? 1;
        one.material.transparent = one.material.opacity < 1;
        one.material.needsUpdate = true;
    });
}

/** Free what a node takes in the graphics card. @param {any} node */
export function disposed(node) {
    node.traverse((/** @type {any} */ one) => {
        one.geometry?.dispose();
        one.material?.map?.dispose();
        one.material?.dispose();
    });
}

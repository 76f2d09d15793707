// Everything that is drawn of a document's scene, at the instant of the state.
import { Group, Plane, Scene, Vector3 } from "three";
import { Arrows, largest, seen } from "./arrows.js";
import { Closures } from "./closures.js";
import { Handles } from "./handles.js";
import { closuresOf, instant, instantOf, runOf, sceneOf, treeOf, sceneOfRun } from "./instant.js";
import { Nearest } from "./nearest.js";
import { Ghost, Solids } from "./solids.js";
import { Labels, MapPicture, floorOf, lighten, lineOf } from "./surroundings.js";
import { pointOf } from "./tree.js";

/** @typedef {import("./types").State} State */
/** @typedef {{halo: string, ink: string, grid: string, ground: string, tint: (colour: string) => string}} Look */

/** How many instants of a run the camera frames. */
const FRAMED = 24;

export class Contents {
    /** @param {State} state @param {Group} guests what others draw, in metres */
    constructor(state, guests) {
        const { engine } = state.document;
        const scene = sceneOf(state);
        this.state = state;
        this.of = scene;
        this.radius = scene.radius;
        /** In metres, drawn in radii of the scene about its centre. */
        this.world = this._metres();
        /** The same, in front of all. */
        this.overlay = this._metres();
        this.back = new Scene();
        this.front = new Scene();
        this.lamps = [lighten(this.back), lighten(this.front)];
        this.solids = new Solids(scene);
        this.floor = scene.floor === null ? null : floorOf(this.radius, scene.centre, scene.floor);
        /** The height that its lines are made for [m]. */
        this.depth = scene.floor ?? 0;
        this.map = new MapPicture();
        this.labels = new Labels(scene);
        this.arrows = new Arrows(this.radius);
        this.closures = new Closures(closuresOf(state), this.radius);
        this.nearest = new Nearest();
        this.lines = scene.lines.map((line) => {
            const drawn = lineOf(line.points.data, line.colour ?? "#5f6b76");
            const joint = line.joint ?? -1;
            (joint < 0 ? this.solids.fixed : this.solids.joints[joint]).add(drawn);
            return { line, drawn };
        });
        this.handles = scene.traced && engine.kind === "p3dof" ? new Handles(this.radius, scene.traced) : null;
        this.section = new Plane(new Vector3(-1, 0, 0), 0);
        this.sectionAt = new Vector3();
        this.cut = false;
        /** @type {Ghost | null} */
        this.ghost = null;
        /** @type {import("./types").Scene | null} */
        this.ghostOf = null;
        /** @type {{run: object, line: ReturnType<typeof lineOf>} | null} */
        this.trace = null;
        /** @type {{run: object, points: Vector3[]} | null} */
        this.known = null;
        this.world.add(this.solids.group, this.map.mesh, guests);
        if (this.floor) this.world.add(this.floor);
        this.overlay.add(this.arrows.group, this.closures.group, this.nearest.group);
        if (this.handles) this.overlay.add(this.handles.group);
        this.back.add(this.world);
        this.front.add(this.overlay, this.labels.group, this.arrows.texts, this.nearest.text.sprite);
    }

    /** Take the same scene with other lengths; false where it is another one. @param {import("./types").Scene} scene */
    adopt(scene) {
        const { of } = this;
        const same = scene.layers === of.layers && scene.lines === of.lines && scene.solids.length === of.solids.length
            && scene.labels.length === of.labels.length && scene.radius === of.radius;
        if (!same) return false;
        this.of = scene;
        this.solids.adopt(scene);
        scene.labels.forEach((label, i) => void (this.labels.all[i].label = label));
        if (this.floor && scene.floor !== null) this.floor.position.z = scene.floor - this.depth;
        if (this.handles && scene.traced) this.handles.traced = scene.traced;
        this.closures.closures = closuresOf(this.state);
        this.known = null;
        return true;
    }

    _metres() {
        const group = new Group();
        const { centre, radius } = this.of;
        group.scale.setScalar(1 / radius);
        group.position.set(centre[0], centre[1], centre[2]).divideScalar(-radius);
        group.updateMatrixWorld(true);
        return group;
    }

    /** All that should be in the picture: what the run needs, and what is shown now. */
    points() {
        const all = this._ofRun();
        return this.state.hand ? [...all, ...this._at(instant(this.state), true)] : all;
    }

    /** Corners of solids, the ring, labels and arrows, at some instants of the run. */
    _ofRun() {
        const run = runOf(this.state);
        if (this.known?.run === run) return this.known.points;
        this.measure();
        const { data } = run.time;
        const points = [];
        for (let i = 0; i <= FRAMED; i++) {
            points.push(...this._at(instantOf(this.of, run, data[0] + ((data[data.length - 1] - data[0]) * i) / FRAMED), i % 4 === 0));
        }
        for (const { label } of this.labels.all) {
            if ((label.joint ?? -1) < 0) points.push(new Vector3(label.at[0], label.at[1], label.at[2] + label.height / 2).applyMatrix4(this.world.matrixWorld));
        }
        this.known = { run, points };
        return points;
    }

    /** Corners of what is shown at an instant. @param {import("./types").Instant} now @param {boolean} solid whether solids are among them */
    _at(now, solid) {
        if (!there(now)) return [];
        const loads = now.loads.filter(({ load }) => seen(load, this.state.layers));
        const points = loads.flatMap((load) => this._ends(load));
        if (solid) {
            this.solids.place(now.placements);
            points.push(...corners(this.solids));
        }
        if (this.handles && now.pose) {
            const [x, y, z] = pointOf(now.placements, this.handles.traced.joint, this.handles.traced.point);
            for (let i = 0; i < 12; i++) points.push(this.handles.onRing(new Vector3(x, y, z), (i * Math.PI) / 6));
        }
        return points.map((point) => point.applyMatrix4(this.world.matrixWorld));
    }

    /** Where the arrow of a load starts and ends. @param {import("./types").ShownLoad} shown */
    _ends({ load, at, vector }) {
        const start = new Vector3(at[0], at[1], at[2]);
        const along = new Vector3(vector[0], vector[1], vector[2]);
        const size = along.length();
        if (!(size > 0) || !Number.isFinite(size)) return [];
        const length = this.arrows.length(size, load.unit) + 0.06 * this.radius;
        return [start, start.clone().addScaledVector(along, length / size)];
    }

    /** Scale the arrows for the largest load of the document's runs: what is recomputed is drawn in the same scale. */
    measure() {
        this.arrows.scales = largest(this.state.document.runs, this.state.layers);
    }

    /** Put everything where it is at the instant of the state. */
    place() {
        const { state, solids, arrows } = this;
        const now = instant(state);
        if (there(now)) solids.place(now.placements); // out of reach the machine stays where it was, its legs red
        solids.show(state.layers);
        solids.mark(state.refused?.legs ?? this._astray(now));
        for (const { line, drawn } of this.lines) drawn.visible = state.layers[line.layer ?? ""] ?? true;
        this.closures.show(now.placements, state.layers.closures);
        this.map.show(state.map, state.layers.map);
        arrows.group.visible = arrows.texts.visible = state.layers.forces;
        this._trace();
        this._ghost();
        this._cut(now);
    }

    /** The legs that do not reach at an instant of the run. @param {import("./types").Instant} now @returns {string[]} */
    _astray(now) {
        return there(now) || !now.pose ? [] : (this.state.engine?.why?.(now.pose)?.legs ?? []);
    }

    _trace() {
        const { layers } = this.state;
        const { traced } = this.of;
        if (!traced) return;
        const run = runOf(this.state);
        if (this.trace?.run !== run) {
            if (this.trace) {
                this.overlay.remove(this.trace.line);
                this.trace.line.geometry.dispose();
            }
            this.trace = { run, line: lineOf(pathOf(this.of, run, traced), traced.colour) };
            this.overlay.add(this.trace.line);
        }
        this.trace.line.visible = layers[traced.layer ?? ""] ?? true;
    }

    _ghost() {
        const { document, compare, time } = this.state;
        const shown = document.runs[this.state.run];
        const own = sceneOfRun(document, shown) === this.of ? undefined : shown; // as long as it was
        const run = compare === null ? own : document.runs[compare], scene = run && sceneOfRun(document, run);
        if (this.ghost && scene && scene !== this.ghostOf) {
            this.world.remove(this.ghost.group);
            this.ghost = null;
        }
        if (scene && !this.ghost) {
            this.ghost = new Ghost(scene === this.of ? this.solids : new Solids(scene));
            this.ghostOf = scene;
            this.world.add(this.ghost.group);
        }
        if (!this.ghost) return;
        this.ghost.group.visible = run !== undefined;
        if (run && scene) this.ghost.place(instantOf(scene, run, time).placements);
    }

    /** @param {import("./types").Instant} now */
    _cut(now) {
        const { layers } = this.state;
        const at = this.of.traced ? pointOf(now.placements, this.of.traced.joint, this.of.traced.point) : this.of.centre;
        this.sectionAt.set(at[0], at[1], at[2]).applyMatrix4(this.world.matrixWorld);
        if (this.cut === Boolean(layers.section)) return;
        this.cut = Boolean(layers.section);
        this.solids.cut(this.cut ? [this.section] : null);
    }

    /** Colours of the page's theme. @param {Look} look */
    tint(look) {
        this.look = look;
        if (this.floor) this.floor.material.color.set(look.grid);
        this.handles?.tint(look.tint);
        this.trace?.line.material.color.set(look.tint(this.of.traced?.colour ?? look.ink));
    }

    /** What depends on where the eye is. @param {import("./eye.js").Eye} eye @param {Look} look @param {Vector3} target */
    face(eye, look, target) {
        const { state, handles } = this;
        const now = instant(state);
        if (state.layers.forces) {
            const loads = now.loads.filter(({ load }) => seen(load, state.layers));
            this.arrows.show(loads, eye, look, !now.byHand || state.engine !== null);
        }
        this.labels.show((joint, at) => pointOf(now.placements, joint, at), eye, state.layers, look, this.radius);
        this.nearest.show(state, eye, look);
        if (handles && now.pose) {
            const [x, y, z] = pointOf(now.placements, handles.traced.joint, handles.traced.point);
            handles.show(new Vector3(x, y, z), now.pose[2], eye);
            handles.group.visible = state.engine !== null;
        }
        const { camera } = eye;
        for (const lamp of this.lamps) lamp.position.set(-0.6, 0.9, 1).applyQuaternion(camera.quaternion);
        if (this.cut) sectioned(this.section, camera.position.clone().sub(target), this.sectionAt);
    }

    /** Free what the graphics card holds of it; what others drew is in another world by now. */
    dispose() {
        for (const scene of [this.back, this.front]) {
            scene.traverse((/** @type {any} */ { geometry, material }) => {
                geometry?.dispose();
                material?.map?.dispose();
                material?.dispose();
            });
        }
    }
}

/** Whether the machine can be where it is shown. @param {import("./types").Instant} now */
const there = (now) => now.placements.every(Number.isFinite);

/** Turn a plane so that it takes away what is nearer to the eye. @param {Plane} plane @param {Vector3} away @param {Vector3} at */
function sectioned(plane, away, at) {
    const parts = away.toArray();
    const axis = parts.reduce((best, x, i) => (Math.abs(x) > Math.abs(parts[best]) ? i : best), 0);
    plane.normal.set(0, 0, 0).setComponent(axis, -Math.sign(parts[axis]));
    plane.constant = -plane.normal.dot(at);
}

/** Where a point is at all samples of a run. */
/** @param {import("./types").Scene} scene @param {import("./types").Run} run @param {import("./types").Traced} traced */
function pathOf(scene, run, traced) {
    const tree = treeOf(scene);
    const width = run.q.shape[1];
    const count = run.time.data.length;
    const points = new Float64Array(3 * count);
    const out = new Float64Array(16 * tree.joints.length);
    for (let i = 0; i < count; i++) {
        const placed = run.placed ? (/** @type {{name: string}} */ { name }) => run.placed?.[name].data.subarray(7 * i, 7 * i + 7) ?? [] : null;
        tree.place(run.q.data.subarray(width * i, width * (i + 1)), placed, out);
        points.set(pointOf(out, traced.joint, traced.point), 3 * i);
    }
    return points;
}

/** The corners of the boxes around all solids [m]. @param {Solids} solids */
function corners(solids) {
    const found = [];
    for (const mesh of solids.meshes) {
        if (!mesh.geometry.boundingBox) mesh.geometry.computeBoundingBox();
        const { min, max } = /** @type {import("three").Box3} */ (mesh.geometry.boundingBox);
        const { joint } = mesh.userData.solid;
        for (let i = 0; i < 8; i++) {
            const corner = new Vector3(i & 1 ? min.x : max.x, i & 2 ? min.y : max.y, i & 4 ? min.z : max.z);
            corner.applyMatrix4(mesh.matrix);
            if (joint >= 0) corner.applyMatrix4(solids.joints[joint].matrix);
            found.push(corner);
        }
    }
    return found;
}

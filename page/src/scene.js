// The machine in 3D: what the state shows, seen by a camera that the pointer turns.
import { Color, Group, SRGBColorSpace, Vector3, WebGLRenderer } from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
import { Cameras, DIRECTIONS } from "./cameras.js";
import { Contents } from "./contents.js";
import * as drag from "./drag.js";
import { Eye } from "./eye.js";
import * as hover from "./hover.js";
import { sceneOf } from "./instant.js";
import * as joint_drag from "./joint_drag.js";
import { mountOverlay } from "./overlay.js";

/** @typedef {import("./types").State} State */

/** Pictures of less width have buttons where the machine may be [pixels]. */
const NARROW = 700;
/** Least lightness of arrows and texts before a dark ground. */
const READABLE = 0.65;
/** Pixels drawn for each of the page along an edge, at most; and after which pause they are in software [ms]. */
const FINEST = 2, PAUSE = 150;
/** In software, pixels drawn for each of the page along an edge while pictures follow each other more slowly than this [ms]. */
const COARSE = 0.7, SLOW = 33;

/** @param {HTMLElement} element @param {State} state */
export function mount(element, state) {
    const canvas = document.createElement("canvas");
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", `${state.document.title} in 3D`);
    const soft = isSoftware();
    const context = canvas.getContext("webgl2", { antialias: !soft, alpha: false });
    const stage = context ? new Stage(element, canvas, context, state, soft) : null;
    mountOverlay(element, state, stage);
    state.stage = stage;
}

/** Whether the processor draws in place of a graphics card: then smooth edges wait until nothing moves. */
function isSoftware() {
    const context = document.createElement("canvas").getContext("webgl2");
    const info = context?.getExtension("WEBGL_debug_renderer_info");
    const name = info ? String(context?.getParameter(info.UNMASKED_RENDERER_WEBGL)) : "";
    context?.getExtension("WEBGL_lose_context")?.loseContext();
    return /swiftshader|llvmpipe|softpipe|software|basic render/i.test(name);
}

export class Stage {
    /** @param {HTMLElement} element @param {HTMLCanvasElement} canvas @param {WebGL2RenderingContext} context @param {State} state @param {boolean} soft whether edges are smooth only when nothing moves */
    constructor(element, canvas, context, state, soft) {
        this.soft = soft;
        this.timer = 0;
        /** When a picture was drawn last, and how far apart the latest ones were [ms]. */
        this.last = this.pace = 0;
        this.coarse = false;
        this.element = element;
        this.canvas = canvas;
        this.state = state;
        this.renderer = new WebGLRenderer({ canvas, context: /** @type {any} */ (context) });
        this.renderer.autoClear = false;
        this.renderer.localClippingEnabled = true;
        this.cameras = new Cameras();
        this.target = new Vector3();
        /** For what others draw, in metres. */
        this.guests = new Group();
        this.contents = new Contents(state, this.guests);
        /** Whether somebody turned the camera since it was fitted. */
        this.touched = false;
        this.width = this.height = 1;
        this.waiting = false;
        /** The version of the state that everything was put for. */
        this.placed = state.version;
        /** Pictures drawn so far. */
        this.frames = 0;
        /** Called after each picture. @type {Set<() => void>} */
        this.drawn = new Set();
        element.prepend(canvas);
        drag.mount(canvas, this);
        joint_drag.mount(canvas, this);
        hover.mount(element, canvas, this);
        this.controls = this._controls();
        this.style = this._style();
        new ResizeObserver(() => this.resize()).observe(element);
        new MutationObserver(() => this.tint()).observe(document.documentElement, { attributes: true, attributeFilter: ["data-theme"] });
        canvas.addEventListener("webglcontextrestored", () => this.redraw());
        this.resize();
        state.subscribe((_, changed) => this.refresh(changed));
    }

    _controls() {
        const controls = new OrbitControls(this.cameras.used, this.canvas);
        controls.target = this.target;
        controls.minDistance = 0.1;
        controls.maxDistance = 30;
        controls.minZoom = 0.1;
        controls.maxZoom = 50;
        controls.addEventListener("start", () => void (this.touched = true));
        controls.addEventListener("change", () => {
            this._name();
            this.redraw();
        });
        return controls;
    }

    /** The name of the view is gone when the camera was turned. */
    _name() {
        const { view } = this.state;
        if (view === "free" || !this.touched) return;
        const seen = this.cameras.used.position.clone().sub(this.target).normalize();
        if (seen.distanceTo(direction(view)) > 1e-2) this.state.set({ view: "free" });
    }

    _style() {
        const style = getComputedStyle(document.documentElement);
        const [ground, ink, grid] = ["--ground", "--ink", "--grid"].map((name) => style.getPropertyValue(name).trim() || "#888888");
        const dark = new Color(ground).getHSL({ h: 0, s: 0, l: 0 }).l < 0.5;
        /** @type {Map<string, string>} */
        const tints = new Map();
        const tint = (/** @type {string} */ colour) => {
            if (!dark) return colour;
            if (!tints.has(colour)) {
                const { h, s, l } = new Color(colour).getHSL({ h: 0, s: 0, l: 0 }, SRGBColorSpace);
                tints.set(colour, `#${new Color().setHSL(h, s, Math.max(l, READABLE), SRGBColorSpace).getHexString()}`);
            }
            return /** @type {string} */ (tints.get(colour));
        };
        return { halo: ground, ground, ink, grid, tint };
    }

    /** Take the colours of the page's theme. */
    tint() {
        this.style = this._style();
        this.contents.tint(this.style);
        this.contents.back.background = new Color(this.style.ground);
        this.redraw();
    }

    resize() {
        const { clientWidth, clientHeight } = this.element;
        if (!clientWidth || !clientHeight) return;
        [this.width, this.height] = [clientWidth, clientHeight];
        this.renderer.setSize(this.width, this.height);
        this.cameras.resize(this.width, this.height);
        if (!this.touched) this.look(this.state.view);
        this.contents.place();
        this.tint();
        this.render();
    }

    /** What is seen now, between metres and pixels. */
    eye() {
        return new Eye(this.cameras.used, this.contents.world, this.width, this.height);
    }

    /** Look from a standard direction at all that the run needs; without a name, from where the eye is. */
    /** @param {import("./types").View} [view] */
    look(view = "free") {
        this.cameras.use(this.state.layers.parallel, this.target);
        const from = view === "free" ? this.cameras.used.position.clone().sub(this.target) : direction(view);
        this.touched = false;
        this.cameras.fit(this.contents.points(), from, this.target, this._margins());
        this.controls.object = this.cameras.used;
        this.controls.update();
        this.redraw();
    }

    /** Room for values beside the arrows, and for the buttons where they are in the way. */
    /** @returns {import("./cameras.js").Margins} */
    _margins() {
        const top = this.width < NARROW ? 52 : 26;
        return [(2 * 38) / this.width, (2 * 38) / this.width, (2 * top) / this.height, (2 * 14) / this.height];
    }

    /** @param {Set<string>} changed */
    refresh(changed) {
        const { state } = this;
        const scene = sceneOf(state);
        if (scene !== this.contents.of && !this._adopt(scene)) this._rebuild();
        if (changed.has("view") && state.view !== "free") this.look(state.view);
        else if (changed.has("layers") && this.cameras.use(state.layers.parallel, this.target)) {
            this.controls.object = this.cameras.used;
            this.controls.update();
        }
        if (changed.has("document") || changed.has("layers")) this.contents.measure();
        this.contents.place();
        this.placed = state.version;
        if (changed.has("run") || changed.has("document")) this.contents.tint(this.style);
        this.render();
    }

    /** Take other lengths without making all anew. @param {import("./types").Scene} scene */
    _adopt(scene) {
        if (!this.contents.adopt(scene)) return false;
        if (!this.touched) this.look(this.state.view);
        return true;
    }

    _rebuild() {
        const before = this.contents;
        this.contents = new Contents(this.state, this.guests);
        if (!this.touched) this.look(this.state.view);
        this.tint();
        this.contents.place();
        this.render(); // shaders that are in use are not thrown away
        before.dispose();
    }

    /** Ask for another picture, though the state did not change. */
    redraw() {
        if (this.waiting) return;
        this.waiting = true;
        requestAnimationFrame(() => this.waiting && this._current() && this.render());
    }

    /** Whether everything is where the state says; if not, a refresh is about to draw it. */
    _current() {
        return this.placed === this.state.version;
    }

    /** Draw now; in software with smooth edges only a moment later, if nothing moves. */
    render() {
        const now = performance.now(), since = now - this.last;
        this.last = now;
        if (since > PAUSE) [this.pace, this.coarse] = [0, false]; // a first picture, as fine as the page
        else this.pace += (since - this.pace) / 4;
        this.coarse ||= this.pace > SLOW;
        this._draw(!this.soft ? Math.min(window.devicePixelRatio || 1, FINEST) : this.coarse ? COARSE : 1);
        if (!this.soft) return;
        clearTimeout(this.timer);
        this.timer = window.setTimeout(() => this._current() && this.refine(), PAUSE);
    }

    /** Draw as finely as it can be. */
    refine() {
        if (!this._current()) this.state.refresh();
        clearTimeout(this.timer);
        this._draw(this.soft ? FINEST : Math.min(window.devicePixelRatio || 1, FINEST));
    }

    /** @param {number} ratio pixels drawn for each of the page, along an edge */
    _draw(ratio) {
        this.waiting = false;
        if (this.renderer.getPixelRatio() !== ratio) this.renderer.setPixelRatio(ratio);
        const camera = this.cameras.used;
        camera.updateMatrixWorld();
        this.contents.face(this.eye(), this.style, this.target);
        this.renderer.clear();
        this.renderer.render(this.contents.back, camera);
        this.renderer.clearDepth();
        this.renderer.render(this.contents.front, camera);
        this.frames += 1;
        for (const listener of this.drawn) listener();
    }

    /** Where a point of the fixed frame is in the picture [pixels]. @param {number[]} point */
    pixel(point) {
        return this.eye().pixel(new Vector3(point[0], point[1], point[2]));
    }

    /** The actuated joint that can be taken hold of at a pixel. @param {number} x @param {number} y */
    gripAt(x, y) {
        return joint_drag.gripAt(this, x, y);
    }

    /** The picture as it is now, as a data URL. */
    picture(type = "image/png") {
        this.refine();
        return this.canvas.toDataURL(type);
    }
}

/** @param {Exclude<import("./types").View, "free">} view */
function direction(view) {
    const [x, y, z] = DIRECTIONS[view];
    return new Vector3(x, y, z).normalize();
}

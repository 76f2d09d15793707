// Moves a robot by its bodies: what was taken hold of stays under the pointer.
import { Matrix4, Raycaster, Vector2, Vector3 } from "three";
import { canMove, setInput, valueOf } from "./hold.js";
import { instant } from "./instant.js";

/** @typedef {import("./types").State} State */
/** @typedef {import("./types").Input} Input */
/** Without an input the body itself is pulled, and the motors follow. */
/** @typedef {{input: Input | null, joint: import("./types").Joint, place: number, point: Vector3}} Grip where: in the joint's frame */

const ABOUT = ["revolute", "continuous"];
const ROUNDS = 8;

/** @param {HTMLCanvasElement} canvas @param {import("./scene.js").Stage} stage */
export function mount(canvas, stage) {
    const { state } = stage;
    /** @type {{id: number, grip: Grip} | null} */
    let held = null;

    canvas.addEventListener("pointerdown", (event) => {
        if (held || event.button > 0 || !canMove(state)) return;
        const grip = gripAt(stage, ...pixels(canvas, event));
        if (!grip) return;
        event.stopImmediatePropagation(); // the camera stays
        canvas.setPointerCapture(event.pointerId);
        canvas.style.cursor = "grabbing";
        held = { id: event.pointerId, grip };
        if (state.playing) state.set({ playing: false });
    }, { capture: true });

    canvas.addEventListener("pointermove", (event) => {
        if (held?.id !== event.pointerId) return;
        event.stopImmediatePropagation();
        const { grip } = held;
        const [x, y] = pixels(canvas, event);
        const placement = new Matrix4().fromArray(instant(state).placements, 16 * grip.place);
        if (grip.input) setInput(state, grip.input, valueOf(state, grip.input) + followed(grip, placement, x, y, stage.eye()));
        else {
            const { start, along } = stage.eye().ray(x, y);
            state.engine.pull(grip.place, grip.point.toArray(), start.toArray(), along.toArray());
        }
    }, { capture: true });

    for (const kind of /** @type {const} */ (["pointerup", "pointercancel"])) {
        canvas.addEventListener(kind, (event) => {
            if (held?.id !== event.pointerId) return;
            event.stopImmediatePropagation();
            held = null;
            canvas.style.cursor = "";
        }, { capture: true });
    }
}

/** @param {HTMLCanvasElement} canvas @param {PointerEvent} event @returns {[number, number]} */
function pixels(canvas, event) {
    const box = canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
}

/** The actuated joint that carries what is seen at a pixel. @param {import("./scene.js").Stage} stage @param {number} x @param {number} y @returns {Grip | null} */
export function gripAt(stage, x, y) {
    const { document } = stage.state;
    const inputs = new Map(document.inputs.filter(({ joint }) => joint !== undefined).map((input) => [input.joint, input]));
    const pulls = Boolean(stage.state.engine?.pull) && document.closures.length > 0; // the joints of a tree alone move one by one
    if (!inputs.size && !pulls) return null;
    const caster = new Raycaster();
    caster.setFromCamera(new Vector2((2 * x) / stage.width - 1, 1 - (2 * y) / stage.height), stage.cameras.used);
    const { solids, world } = stage.contents;
    const [hit] = caster.intersectObjects(solids.meshes.filter((mesh) => mesh.visible && mesh.userData.solid.joint >= 0), false);
    if (!hit) return null;
    let place = hit.object.userData.solid.joint;
    while (!pulls && place >= 0 && !inputs.has(place)) place = document.scene.joints[place].parent;
    const input = pulls ? null : inputs.get(place);
    if (input === undefined) return null;
    const toJoint = new Matrix4().multiplyMatrices(world.matrixWorld, solids.joints[place].matrix).invert();
    return { input, joint: document.scene.joints[place], place, point: hit.point.clone().applyMatrix4(toJoint) };
}

/**
 * By how much a joint must move so that the point is seen at a pixel, or as near as it comes.
 * @param {Grip} grip @param {Matrix4} placement of the joint now @param {number} x @param {number} y @param {import("./eye.js").Eye} eye
 */
export function followed({ joint, point }, placement, x, y, eye) {
    const axis = new Vector3(...(joint.axis ?? [0, 0, 1]));
    const turns = ABOUT.includes(joint.kind);
    const seen = (/** @type {number} */ by) => {
        const moved = turns ? point.clone().applyAxisAngle(axis, by) : point.clone().addScaledVector(axis, by);
        return eye.pixel(moved.applyMatrix4(placement));
    };
    const step = turns ? 1e-4 : 1e-4 / eye.world.scale.x;
    const most = turns ? 0.5 : 0.5 / eye.world.scale.x;
    let by = 0;
    for (let round = 0; round < ROUNDS; round++) {
        const here = seen(by);
        const there = seen(by + step);
        const slope = [(there[0] - here[0]) / step, (there[1] - here[1]) / step];
        const square = slope[0] ** 2 + slope[1] ** 2;
        if (!(square > 1e-6)) break;
        const move = ((x - here[0]) * slope[0] + (y - here[1]) * slope[1]) / square;
        by += Math.min(Math.max(move, -most), most);
    }
    return by;
}

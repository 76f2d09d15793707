// Moves the platform by hand: P under the pointer, the tilt by a ring or a bar.
import { Vector3 } from "three";
import { angleAt, under } from "./handles.js";
import { hold } from "./hold.js";
import { instant } from "./instant.js";
import { pointOf } from "./tree.js";

/** Listen to pointers on a canvas. @param {HTMLCanvasElement} canvas @param {import("./scene.js").Stage} stage */
export function mount(canvas, stage) {
    /** @type {{id: number, what: "P" | "theta", off: number[], angle: number} | null} */
    let held = null;
    const { state } = stage;
    const eyeOf = () => stage.eye();
    const hit = (/** @type {PointerEvent} */ event, /** @type {number} */ x, /** @type {number} */ y) =>
        (state.engine && stage.contents.handles?.hit(x, y, event.pointerType, eyeOf())) || null;
    const place = () => {
        const { traced } = state.document.scene;
        const [x, y, z] = traced ? pointOf(instant(state).placements, traced.joint, traced.point) : [0, 0, 0];
        return new Vector3(x, y, z);
    };

    /** @param {PointerEvent} event @returns {[number, number]} */
    const pixels = (event) => {
        const box = canvas.getBoundingClientRect();
        return [event.clientX - box.left, event.clientY - box.top];
    };

    canvas.addEventListener("pointerdown", (event) => {
        const pose = instant(state).pose;
        if (held || !pose || event.button > 0) return;
        const [x, y] = pixels(event);
        const what = hit(event, x, y);
        if (!what) return;
        event.stopImmediatePropagation(); // the camera stays
        event.preventDefault();
        canvas.setPointerCapture(event.pointerId);
        const P = place();
        const [u, v] = eyeOf().pixel(P);
        held = { id: event.pointerId, what, off: [u - x, v - y], angle: what === "theta" ? pose[2] - angleAt(P, x, y, eyeOf()) : 0 };
        canvas.style.cursor = "grabbing";
        if (state.playing) state.set({ playing: false });
    }, { capture: true });

    canvas.addEventListener("pointermove", (event) => {
        const [x, y] = pixels(event);
        if (!held) {
            if (event.buttons === 0) canvas.style.cursor = hit(event, x, y) ? "grab" : "";
            return;
        }
        if (event.pointerId !== held.id) return;
        event.stopImmediatePropagation();
        const pose = /** @type {number[]} */ (instant(state).pose);
        const P = place();
        if (held.what === "P") {
            const goal = under(P, x + held.off[0], y + held.off[1], eyeOf());
            hold(state, [pose[0] + goal.y - P.y, pose[1] + goal.z - P.z, pose[2]]);
        } else {
            const angle = angleAt(P, x, y, eyeOf()) + held.angle;
            const turns = Math.round((angle - pose[2]) / (2 * Math.PI));
            hold(state, [pose[0], pose[1], angle - 2 * Math.PI * turns]);
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

// Names what is under the pointer in the picture: the link, and the joint that moves it.
import { Raycaster, Vector2 } from "three";
import { make, write } from "./make.js";

/** How far the name is from the pointer [pixels]. */
const ASIDE = 14;

/** @param {HTMLElement} element @param {HTMLCanvasElement} canvas @param {import("./scene.js").Stage} stage */
export function mount(element, canvas, stage) {
    const words = make("div", { className: "named", hidden: true, "aria-hidden": "true" });
    element.append(words);
    let waiting = false, at = [0, 0];
    const hide = () => void (words.hidden = true);
    canvas.addEventListener("pointermove", (event) => {
        if (event.pointerType === "touch" || event.buttons) return hide();
        const box = canvas.getBoundingClientRect();
        at = [event.clientX - box.left, event.clientY - box.top];
        if (waiting) return;
        waiting = true;
        requestAnimationFrame(() => {
            waiting = false;
            const text = stage.state.playing ? "" : nameAt(stage, at[0], at[1]);
            words.hidden = !text;
            if (!text) return;
            write(words, text);
            const left = at[0] > stage.width / 2 ? at[0] - ASIDE - words.offsetWidth : at[0] + ASIDE;
            words.style.transform = `translate(${left}px, ${Math.max(0, at[1] - ASIDE - words.offsetHeight)}px)`;
        });
    });
    for (const kind of ["pointerleave", "pointerdown"]) canvas.addEventListener(kind, hide, { capture: true });
}

/** What is seen at a pixel; empty where nothing is. @param {import("./scene.js").Stage} stage @param {number} x @param {number} y */
export function nameAt(stage, x, y) {
    const caster = new Raycaster(), { solids } = stage.contents, { joints } = stage.state.document.scene;
    caster.setFromCamera(new Vector2((2 * x) / stage.width - 1, 1 - (2 * y) / stage.height), stage.cameras.used);
    const [hit] = caster.intersectObjects(solids.meshes.filter(({ visible }) => visible), false);
    if (!hit) return "";
    const { solid } = hit.object.userData, joint = joints[solid.joint];
    return joint ? `${joint.body ?? solid.name} · joint ${joint.name} (${joint.kind})` : "base";
}

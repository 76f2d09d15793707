// What of the scene is shown.
import { make } from "./make.js";
import { OWN_LAYERS } from "./state.js";

/** @param {HTMLElement} element @param {import("./types").State} state */
export function mount(element, state) {
    const rows = make("div", { className: "toggles" });
    element.append(make("h2", {}, "Show"), rows);
    /** @type {object | null} */
    let shown = null;
    state.subscribe(() => {
        const { scene } = state.document;
        if (shown !== scene.layers) {
            shown = scene.layers;
            rows.replaceChildren(...layersOf(state).map(({ name, label }) => toggle(state, name, label)));
        }
        for (const box of rows.querySelectorAll("input")) box.checked = state.layers[box.name] ?? true;
    });
}

/** Those that this document has something for. @param {import("./types").State} state */
function layersOf({ document: { scene, closures, runs, engine } }) {
    /** @type {Record<string, boolean>} */
    const there = {
        map: engine.kind === "p3dof", closures: closures.length > 0,
        forces: runs.some((run) => run.loads.length > 0),
    };
    return [...scene.layers, ...OWN_LAYERS.filter(({ name }) => there[name] ?? true)];
}

/** @param {import("./types").State} state @param {string} name @param {string} label */
function toggle(state, name, label) {
    const box = make("input", { type: "checkbox", name });
    box.addEventListener("change", () => state.set({ layers: { ...state.layers, [name]: box.checked } }));
    return make("label", {}, box, label);
}

// Standard views and layers: what is shown of the scene, and from where.
import { OWN_LAYERS } from "./state.js";

/** @param {HTMLElement} element @param {import("./types").State} state */
export function mount(element, state) {
    const heading = document.createElement("h2");
    heading.textContent = "Show";
    element.append(heading);
    for (const { name, label } of [...state.document.scene.layers, ...OWN_LAYERS]) {
        const row = document.createElement("label");
        const box = document.createElement("input");
        box.type = "checkbox";
        box.name = name;
        box.addEventListener("change", () => state.set({ layers: { ...state.layers, [name]: box.checked } }));
        state.subscribe(() => void (box.checked = state.layers[name]));
        row.append(box, ` ${label}`);
        element.append(row);
    }
}

// Two runs beside each other: a second machine in 3D, its curves, or the difference of both.
import { choose, make } from "./make.js";

/** @param {HTMLElement} element @param {import("./types").State} state */
export function mount(element, state) {
    const other = make("select", { id: "compared" });
    other.addEventListener("change", () => state.set({ compare: other.value === "" ? null : Number(other.value), difference: other.value !== "" && state.difference }));
    const difference = make("input", { type: "checkbox" });
    difference.addEventListener("change", () => state.set({ difference: difference.checked }));
    const row = make("label", { className: "check" }, difference, " Difference as curves");
    element.append(make("h2", {}, "Compare"), make("label", { className: "field" }, "With ", other), row);
    state.subscribe(() => {
        const { runs } = state.document;
        element.hidden = runs.length < 2 && !state.before;
        const others = runs.flatMap((run, i) => (i === state.run ? [] : [/** @type {[string, string]} */ ([String(i), run.name || `run ${i + 1}`])]));
        choose(other, [["", "nothing"], ...others], state.compare === null || state.compare === state.run ? "" : String(state.compare));
        row.hidden = state.compare === null && !state.before;
        difference.checked = state.difference;
    });
}

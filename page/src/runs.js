// The list of runs: which one is shown, which one is beside it in 3D and in the charts, and which are no longer wanted.
import { make } from "./make.js";
import { NO_TASK } from "./plan.js";

/** @typedef {import("./types").State} State */

/** @param {State} state @param {number} i */
const nameOf = (state, i) => state.document.runs[i].name || `run ${i + 1}`;

/** @param {HTMLElement} element @param {State} state */
export function mount(element, state) {
    const list = make("ul", { className: "runs" });
    const difference = make("input", { type: "checkbox" });
    difference.addEventListener("change", () => state.set({ difference: difference.checked }));
    const less = make("label", { className: "check" }, difference, " Difference as curves");
    element.append(make("h2", {}, "Runs"), list, less);
    let known = "";
    state.subscribe(() => {
        const { runs } = state.document, others = runs.length > 1;
        element.hidden = !others && !state.before;
        list.hidden = !others;
        less.hidden = state.compare === null && !state.before;
        difference.checked = state.difference;
        const shape = JSON.stringify(runs.map((_, i) => nameOf(state, i)));
        if (shape !== known) list.replaceChildren(...runs.map((_, i) => row(state, i)));
        known = shape;
        [...list.children].forEach((item, i) => {
            const [radio, shown] = /** @type {[HTMLInputElement, HTMLButtonElement]} */ ([item.querySelector("input"), item.querySelector(".show")]);
            radio.checked = i === state.run;
            shown.disabled = i === state.run;
            shown.setAttribute("aria-pressed", String(i === state.run || i === state.compare));
        });
    });
}

/** @param {State} state @param {number} i */
function row(state, i) {
    const name = nameOf(state, i);
    const radio = make("input", { type: "radio", name: "run" });
    radio.addEventListener("change", () => choose(state, i));
    /** @param {string} className @param {string} label @param {string} sign @param {() => void} act */
    const button = (className, label, sign, act) => make("button", { type: "button", className, title: label, "aria-label": label, onclick: act }, sign);
    return make("li", {}, make("label", { title: name }, radio, make("span", { className: "name" }, name)),
        button("show", `Compare ${name} with the chosen run: show it beside`, "compare", () => {
            const hide = state.compare === i;
            state.set({ compare: hide ? null : i, difference: !hide && state.difference });
        }),
        button("remove", `Remove ${name}`, "×", () => remove(state, i)));
}

/** Show a run; what was beside it stays there, or the run before where that was this one. @param {State} state @param {number} i */
export function choose(state, i) {
    const compare = state.compare === i ? state.run : state.compare;
    state.set({ run: i, compare, solved: null, whatIf: {}, hand: null, zoom: null });
}

/** Take a run off the page; those that stay are still counted as in the file. @param {State} state @param {number} i */
function remove(state, i) {
    const { document, run, compare } = state, gone = document.runs[i];
    document.runs.filter(({ computed }) => !computed).forEach((each, k) => void (each.number ??= k + 1));
    const runs = document.runs.filter((_, k) => k !== i);
    /** @param {number} k */
    const moved = (k) => Math.min(k > i ? k - 1 : k, runs.length - 1);
    const beside = compare === null || compare === i ? null : moved(compare), next = moved(run);
    const other = run === i ? { solved: null, whatIf: {}, hand: null, zoom: null } : {};
    state.set({
        document: { ...document, runs }, run: next, compare: beside === next ? null : beside, ...other,
        ...(gone.computed === "waypoints" ? { task: NO_TASK } : {}),
    });
}

// The one state of the page, and the one refresh that shows it.
import { ANY_PACE, NO_TASK } from "./plan.js";

/** @typedef {import("./types").State} State */
/** @typedef {import("./types").Fields} Fields */

const later = typeof requestAnimationFrame === "function" ? requestAnimationFrame : queueMicrotask;

/** What takes the machine away from a pose, and so from one that was refused. */
const LEAVES = ["hand", "time", "run", "document", "whatIf"];

/** Layers of the page itself, beside those of the document's scene. */
export const OWN_LAYERS = [
    { name: "forces", label: "Forces", shown: true },
    { name: "map", label: "Workspace map", shown: false },
    { name: "closures", label: "Closures", shown: false },
    { name: "section", label: "Section", shown: false },
    { name: "parallel", label: "Parallel view", shown: false },
];

/**
 * Make the state of a page.
 * @param {import("./types").Document} document
 * @returns {State}
 */
export function createState(document) {
    const layers = [...OWN_LAYERS, ...document.scene.layers];
    /** @type {Fields} */
    const fields = {
        document, run: 0, time: document.runs[0]?.time.data[0] ?? 0, playing: false, speed: 1, loop: true,
        hand: null, refused: null, whatIf: {}, solved: null, before: null, report: null, case: "total", units: "mm", theme: "auto",
        layers: Object.fromEntries(layers.map(({ name, shown }) => [name, shown])),
        view: "3d", charts: [], compare: null, difference: false, zoom: null, linked: "", help: false, hover: null, map: null, shade: "force", task: NO_TASK, pace: ANY_PACE, planned: null, engine: null, stage: null, connection: null, guests: null,
    };
    /** @type {Set<(state: State, changed: Set<string>) => void>} */
    const listeners = new Set();
    /** @type {Set<string>} */
    let changed = new Set();
    let waiting = false;

    /** @type {State} */
    const state = {
        ...fields,
        version: 0,
        set(changes) {
            const left = state.refused && LEAVES.some((key) => key in changes) ? { refused: null, ...changes } : changes;
            Object.assign(state, left);
            Object.keys(left).forEach((key) => changed.add(key));
            state.version += 1;
            if (("run" in changes || "document" in changes) && !("time" in changes)) {
                state.time = within(state, state.time);
                changed.add("time");
            }
            if (!waiting) {
                waiting = true;
                later(() => waiting && state.refresh());
            }
        },
        subscribe(listener) {
            listeners.add(listener);
            return () => void listeners.delete(listener);
        },
        refresh() {
            const what = changed;
            [changed, waiting] = [new Set(), false];
            for (const listener of listeners) {
                try {
                    listener(state, what);
                } catch (error) { // one part that fails leaves the others working
                    console.error(error);
                }
            }
        },
    };
    return state;
}

/** The nearest time within the run that is shown [s]. @param {State} state @param {number} time */
export function within(state, time) {
    const instants = (state.solved ?? state.document.runs[state.run])?.time.data;
    if (!instants) return 0;
    return Math.min(Math.max(time, instants[0]), instants[instants.length - 1]);
}

/** What changes with a standard view: plans are parallel, the view in 3D is in perspective. @param {State} state @param {Exclude<import("./types").View, "free">} view */
export const viewed = (state, view) => ({ view, layers: { ...state.layers, parallel: view !== "3d" } });

// Links to an instant: #t=0.35 and #run=2, which counts from one.
import { make, write } from "./make.js";
import { within } from "./state.js";

/** @typedef {import("./types").State} State */

/**
 * What a link asks for; what makes no sense is left out.
 * @param {string} hash
 * @param {import("./types").Run[]} runs
 * @returns {{run?: number, time?: number, missing?: string}} missing: the run that it asks for, where there is none
 */
export function wanted(hash, runs) {
    const asked = new URLSearchParams(hash.replace(/^#/, ""));
    /** @type {{run?: number, time?: number, missing?: string}} */
    const found = {};
    const number = Number(asked.get("run") ?? NaN), run = runs.findIndex((each, i) => (each.number ?? i + 1) === number);
    if (run >= 0) found.run = run;
    else if (asked.has("run")) found.missing = (asked.get("run") ?? "").slice(0, 20);
    const time = Number(asked.get("t") || NaN);
    if (Number.isFinite(time)) found.time = time;
    return found;
}

/** The part of a link that leads to what is shown; of a run that this page made, to the file's first. */
/** @param {State} state @returns {string} */
export function hashOf({ document: { runs }, run, time }) {
    const instant = `t=${+time.toFixed(9)}`, filed = runs.filter(({ computed }) => !computed);
    const place = Math.max(0, filed.indexOf(runs[run])), number = filed[place]?.number;
    return filed.length > 1 || number ? `#run=${number ?? place + 1}&${instant}` : `#${instant}`;
}

/** What a link does not carry, in a sentence; empty where it carries all. @param {State} state @returns {string} */
export function leftOut({ document: { runs }, whatIf, hand }) {
    const computed = (/** @type {string} */ kind) => runs.some((run) => run.computed === kind);
    const texts = [
        computed("waypoints") ? "planned runs (save the task)" : "",
        computed("kept") ? "kept runs (save their curves or motion as CSV)" : "",
        Object.values(whatIf).some((value) => value !== undefined) ? "what-if (save the curves as CSV)" : "",
        hand ? "the pose by hand" : "",
    ].filter(Boolean);
    return texts.length ? `The link leads to the instant of the file's run. Not in it: ${texts.join(", ")}.` : "";
}

/** Go where a link leads. @param {State} state @param {string} hash */
export function follow(state, hash) {
    const { runs } = state.document, { run, time, missing } = wanted(hash, runs);
    if (missing !== undefined) {
        const there = runs.length === 1 ? "is one run" : `are ${runs.length} runs`;
        const name = runs[state.run]?.name || `run ${state.run + 1}`;
        state.set({ linked: `The link leads to run ${missing}, but there ${there} here: ${name} is shown, not what was linked.` });
        return;
    }
    if (state.linked) state.set({ linked: "" });
    if (run !== undefined && run !== state.run) state.set({ run, whatIf: {}, zoom: null });
    if (time !== undefined) state.set({ time: within(state, time) });
    if (run !== undefined || time !== undefined) state.set({ playing: false, hand: null });
}

/** Begin where the document says, or the link that the page was opened with. @param {HTMLElement} _element @param {State} state */
export function mount(_element, state) {
    const { time, speed, playing, layers } = state.document.start ?? {};
    if (layers) state.set({ layers: { ...state.layers, ...layers } });
    if (speed !== undefined) state.set({ speed });
    if (time !== undefined) state.set({ time: within(state, time) });
    if (playing && !matchMedia("(prefers-reduced-motion: reduce)").matches) state.set({ playing }); // who asks for less motion starts it himself
    const said = make("p", { className: "note alarm linked", role: "alert" });
    document.getElementById("heading")?.append(said);
    state.subscribe((_, changed) => {
        if (changed.has("run") && !changed.has("linked")) state.linked = "";
        write(said, state.linked);
        said.hidden = !state.linked;
    });
    addEventListener("hashchange", () => follow(state, location.hash));
    follow(state, location.hash);
}

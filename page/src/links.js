// Links to an instant: #t=0.35 and #run=2, which counts from one.
import { within } from "./state.js";

/** @typedef {import("./types").State} State */

/**
 * What a link asks for; what makes no sense is left out.
 * @param {string} hash
 * @param {number} runs how many there are
 * @returns {{run?: number, time?: number}}
 */
export function wanted(hash, runs) {
    const asked = new URLSearchParams(hash.replace(/^#/, ""));
    /** @type {{run?: number, time?: number}} */
    const found = {};
    const run = Number(asked.get("run") ?? NaN) - 1;
    if (Number.isInteger(run) && run >= 0 && run < runs) found.run = run;
    const time = Number(asked.get("t") || NaN);
    if (Number.isFinite(time)) found.time = time;
    return found;
}

/** The part of a link that leads to what is shown. @param {State} state @returns {string} */
export function hashOf(state) {
    const time = `t=${+state.time.toFixed(9)}`;
    return state.document.runs.length > 1 ? `#run=${state.run + 1}&${time}` : `#${time}`;
}

/** Go where a link leads. @param {State} state @param {string} hash */
export function follow(state, hash) {
    const { run, time } = wanted(hash, state.document.runs.length);
    if (run !== undefined && run !== state.run) state.set({ run, whatIf: {}, zoom: null });
    if (time !== undefined) state.set({ time: within(state, time) });
    if (run !== undefined || time !== undefined) state.set({ playing: false, hand: null, refused: null });
}

/** Begin where the document says, or the link that the page was opened with. @param {HTMLElement} _element @param {State} state */
export function mount(_element, state) {
    const { time, speed, playing, layers } = state.document.start ?? {};
    if (layers) state.set({ layers: { ...state.layers, ...layers } });
    if (speed !== undefined) state.set({ speed });
    if (time !== undefined) state.set({ time: within(state, time) });
    if (playing) state.set({ playing });
    addEventListener("hashchange", () => follow(state, location.hash));
    follow(state, location.hash);
}

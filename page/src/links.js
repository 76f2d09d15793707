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

/** @param {HTMLElement} _element @param {State} state */
export function mount(_element, state) {
    const follow = () => {
        const { run, time } = wanted(location.hash, state.document.runs.length);
        if (run !== undefined && run !== state.run) state.set({ run, whatIf: {}, zoom: null });
        if (time !== undefined) state.set({ time: within(state, time) });
        if (run !== undefined || time !== undefined) state.set({ playing: false, hand: null, refused: null });
    };
    addEventListener("hashchange", follow);
    follow();
}

// What a screen reader is told: the numbers when the time has come to rest, a refusal, another run; no more.
import { instant, runOf } from "./instant.js";
import { make, write } from "./make.js";
import { columnsOf, shortLabels } from "./table.js";
import { clock, decimals, fixed, shown } from "./units.js";

/** @typedef {import("./types").State} State */

/** So long nothing may change before it is said [ms]. */
const REST = 500;

/** The instant in a sentence. @param {State} state @returns {string} */
export function sentence(state) {
    const { values, time, byHand } = instant(state);
    const group = columnsOf(runOf(state))[0];
    const when = byHand ? "Held by hand" : clock(time);
    if (!group) return when;
    const { unit, factor } = shown(group.unit, state.units);
    const labels = shortLabels(group);
    const texts = group.curves.map(({ key }, i) => {
        const value = values[key] * factor;
        return `${labels[i]} ${fixed(value, decimals(Math.abs(value)))} ${unit}`;
    });
    return `${when}: ${group.name} ${texts.join(", ")}`;
}

/** @param {HTMLElement} element @param {State} state */
export function mount(element, state) {
    const region = make("p", { className: "hidden", id: "spoken", role: "status", "aria-live": "polite" });
    element.append(region);
    /** @type {ReturnType<typeof setTimeout> | undefined} */
    let waiting;
    state.subscribe((_, changed) => {
        if (!["time", "playing", "hand", "run", "refused", "solved"].some((name) => changed.has(name))) return;
        clearTimeout(waiting);
        if (state.playing || changed.has("document")) return;
        waiting = setTimeout(() => write(region, state.refused?.text || sentence(state)), REST);
    });
}

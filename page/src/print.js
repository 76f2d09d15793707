// The printed page: the picture, the charts and the numbers, in light colours; no panel.
import { groupsOf, shortened, wholePeak } from "./curves.js";
import { instant, runOf } from "./instant.js";
import { make } from "./make.js";
import { chartPicture } from "./pictures.js";
import { clock, decimals, fixed, shown, titled } from "./units.js";

/** @typedef {import("./types").State} State */

/** @param {HTMLElement} element @param {State} state */
export function mount(element, state) {
    const fill = () => {
        const { title } = state.document;
        const name = runOf(state)?.name;
        element.replaceChildren(make("h1", {}, name && name !== title ? `${title}: ${name}` : title),
            ...[0, 1, 2].map((index) => chartPicture(state, index, 900, 250)), table(state));
    };
    const clear = () => element.replaceChildren();
    addEventListener("beforeprint", fill);
    addEventListener("afterprint", clear);
    matchMedia("print").addEventListener("change", ({ matches }) => (matches ? fill() : clear()));
}

/** Every curve: now, and its largest value with the instant. @param {State} state @returns {HTMLTableElement} */
function table(state) {
    const { values, time } = instant(state);
    const run = runOf(state);
    const rows = groupsOf(run).flatMap(({ name, unit, curves }) => curves.map((curve, i) => {
        const { factor } = shown(unit, state.units);
        const peak = wholePeak(run.time.data, curve.values.data);
        const digits = decimals(Math.abs(peak?.value ?? 0) * factor);
        return make("tr", {}, make("th", { scope: "row" }, titled(`${name}, ${shortened(curves.map(({ label }) => label))[i]}`, unit, state.units)),
            make("td", {}, fixed(values[curve.key] * factor, digits)),
            make("td", {}, peak ? fixed(peak.value * factor, digits) : "–"), make("td", {}, peak ? clock(peak.time) : "–"));
    }));
    return make("table", {}, make("caption", {}, "Values, and the largest of the run"),
        make("thead", {}, make("tr", {}, make("td"), make("th", { scope: "col" }, `at ${clock(time)}`),
            make("th", { scope: "col" }, "largest"), make("th", { scope: "col" }, "when"))),
        make("tbody", {}, ...rows));
}

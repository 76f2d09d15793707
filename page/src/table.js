// Numbers at the instant, and the peaks of the whole run with their instants.
import { groupsOf, shortened, wholePeak } from "./curves.js";
import { instant, runOf } from "./instant.js";
import { byUnits } from "./lines.js";
import { make, write } from "./make.js";
import { readable, resolved } from "./themes.js";
import { seek } from "./time_bar.js";
import { clock, decimals, fixed, shown } from "./units.js";

/** @typedef {import("./types").State} State */
/** @typedef {import("./types").Curve} Curve */
/** @typedef {import("./curves").Group} Group */
/** @typedef {{curve: Curve, cell: HTMLElement, factor: number, digits: number}} Cell */

/** Units of the columns beside the first: positions and speeds. */
const COLUMNS = [[], ["m", "rad"], ["m/s", "rad/s"]];
const SHAPED = ["document", "run", "solved", "units", "theme"];

/**
 * Groups that have a curve of the same label for each actuator: the columns of the table.
 * @param {import("./types").Run} run
 * @returns {Group[]}
 */
export function columnsOf(run) {
    const groups = groupsOf(run);
    if (!groups.length) return [];
    const labels = shortLabels(groups[0]);
    return byUnits(groups.filter((group) => {
        const own = shortLabels(group);
        return labels.every((label) => own.includes(label));
    }), COLUMNS);
}

/** @param {Group} group */
export const shortLabels = ({ curves }) => shortened(curves.map(({ label }) => label));

/** @param {HTMLElement} element @param {State} state */
export function mount(element, state) {
    /** @type {Cell[]} */
    let cells = [];
    const hand = make("p", { className: "note hand" });
    const table = make("table", { className: "numbers" });
    element.append(table, hand);
    state.subscribe((_, changed) => {
        if (SHAPED.some((name) => changed.has(name))) cells = build(table, state);
        const { values, byHand, time } = instant(state);
        for (const { curve, cell, factor, digits } of cells) write(cell, fixed(values[curve.key] * factor, digits));
        table.dataset.time = String(time);
        write(hand, byHand ? "As it is held: at rest, by hand." : "");
    });
}

/** @param {HTMLTableElement} table @param {State} state @returns {Cell[]} */
function build(table, state) {
    const groups = columnsOf(runOf(state));
    const theme = resolved(state.theme);
    const labels = groups.length ? shortLabels(groups[0]) : [];
    /** @type {Cell[]} */
    const cells = [];
    const head = make("tr", {}, make("td"), ...groups.map(({ name, unit }) => make("th", { scope: "col" },
        name, make("small", {}, `[${shown(unit, state.units).unit}]`))));
    const rows = labels.map((label, i) => {
        const { colour } = groups[0].curves[i];
        const swatch = make("span", { className: "swatch", "aria-hidden": "true" });
        swatch.style.setProperty("--colour", readable(colour ?? "#888888", theme));
        return make("tr", {}, make("th", { scope: "row" }, swatch, label), ...groups.map((group) => {
            const cell = make("td", { className: "value" });
            cells.push({ cell, ...scaled(group, label, state) });
            return cell;
        }));
    });
    const peaks = labels.map((label) => make("tr", {}, make("th", { scope: "row" }, label),
        ...groups.map((group) => make("td", {}, ...peakButton(scaled(group, label, state), state)))));
    table.style.setProperty("--names", `${Math.min(92, 24 + 7 * Math.max(2, ...labels.map(({ length }) => length)))}px`);
    table.replaceChildren(
        make("caption", { className: "hidden" }, "Values at the instant, and the largest of the run"),
        make("thead", {}, head), make("tbody", {}, ...rows),
        make("tbody", { className: "peaks" },
            make("tr", {}, make("th", { scope: "rowgroup", colSpan: groups.length + 1 }, "Largest of the run, and when")), ...peaks),
    );
    return cells;
}

/** @param {Group} group @param {string} label @param {State} state */
function scaled(group, label, state) {
    const curve = /** @type {Curve} */ (group.curves[shortLabels(group).indexOf(label)]);
    const { factor } = shown(group.unit, state.units);
    const time = runOf(state).time.data;
    const largest = Math.max(...group.curves.map(({ values }) => Math.abs(wholePeak(time, values.data)?.value ?? 0)));
    return { curve, factor, digits: decimals(largest * factor) };
}

/** @param {Omit<Cell, "cell">} cell @param {State} state */
function peakButton({ curve, factor, digits }, state) {
    const peak = wholePeak(runOf(state).time.data, curve.values.data);
    if (!peak) return ["–"];
    const value = fixed(peak.value * factor, digits);
    return [make("button", {
        type: "button", className: "peak", title: "go there", "data-key": curve.key, "data-time": String(peak.time),
        onclick: () => seek(state, peak.time),
    }, make("span", { className: "hidden" }, `${curve.label}: `), value, make("small", {}, clock(peak.time)))];
}

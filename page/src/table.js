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
/** @typedef {{curve: Curve, group: string, element: HTMLElement, button: HTMLButtonElement, value: HTMLElement,
 *             when: HTMLElement, factor: number, digits: number}} Cell */

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
    const hand = make("p", { className: "note hand", title: "Peaks are those of the run" });
    const table = new Numbers(state);
    element.append(table.element, hand);
    state.subscribe((_, changed) => {
        if (SHAPED.some((name) => changed.has(name))) table.take();
        table.show();
        write(hand, instant(state).byHand ? "As it is held: at rest, by hand." : "As in the run, at this instant.");
    });
}

class Numbers {
    /** @param {State} state */
    constructor(state) {
        this.state = state;
        this.element = make("table", { className: "numbers" });
        /** @type {Cell[]} */
        this.cells = [];
        this.shape = "";
    }

    /** Take the curves of the run: new rows only where others are wanted. */
    take() {
        const { state } = this;
        const groups = columnsOf(runOf(state));
        const labels = groups.length ? shortLabels(groups[0]) : [];
        const theme = resolved(state.theme);
        const shape = JSON.stringify([labels, theme, groups.map(({ name, unit, curves }) => [name, shown(unit, state.units).unit, curves.map(({ key, colour }) => [key, colour])])]);
        if (shape !== this.shape) this.build(groups, labels, theme);
        this.shape = shape;
        const scales = new Map(groups.map((group) => [group.name, scaleOf(group, state)]));
        for (const cell of this.cells) {
            Object.assign(cell, scales.get(cell.group));
            cell.curve = /** @type {Curve} */ (runOf(state).curves.find(({ key }) => key === cell.curve.key));
            this.peak(cell);
        }
    }

    /** @param {Group[]} groups @param {string[]} labels @param {"light" | "dark"} theme */
    build(groups, labels, theme) {
        const { units } = this.state;
        this.cells = [];
        const head = make("tr", {}, make("td"), ...groups.map(({ name, unit }) => make("th", { scope: "col" },
            name, make("small", {}, `[${shown(unit, units).unit}]`))));
        const rows = labels.map((label, i) => {
            const swatch = make("span", { className: "swatch", "aria-hidden": "true" });
            swatch.style.setProperty("--colour", readable(groups[0].curves[i].colour ?? "#888888", theme));
            return make("tr", {}, make("th", { scope: "row" }, swatch, label), ...groups.map((group) => this.cell(group, label)));
        });
        const peaks = labels.map((label, i) => make("tr", {}, make("th", { scope: "row" }, label),
            ...groups.map((_, k) => make("td", {}, this.cells[i * groups.length + k].button))));
        const width = Math.min(92, 24 + 7 * Math.max(2, ...labels.map(({ length }) => length)));
        this.element.style.setProperty("--names", `${width}px`);
        this.element.replaceChildren(
            make("caption", { className: "hidden" }, "Values at the instant, and the largest of the run"),
            make("thead", {}, head), make("tbody", {}, ...rows),
            make("tbody", { className: "peaks" },
                make("tr", {}, make("th", { scope: "rowgroup", colSpan: groups.length + 1 }, "Largest of the run, and when")), ...peaks),
        );
    }

    /** @param {Group} group @param {string} label */
    cell(group, label) {
        const curve = group.curves[shortLabels(group).indexOf(label)];
        const element = make("td", { className: "value" });
        const [value, when] = [make("span"), make("small")];
        const button = make("button", { type: "button", className: "peak", title: "Show this time", "data-key": curve.key },
            make("span", { className: "hidden" }, `${curve.label}: `), value, when);
        button.addEventListener("click", () => button.dataset.time && seek(this.state, Number(button.dataset.time)));
        this.cells.push({ curve, group: group.name, element, button, value, when, factor: 1, digits: 1 });
        return element;
    }

    /** @param {Cell} cell */
    peak({ curve, factor, digits, button, value, when }) {
        const peak = wholePeak(runOf(this.state).time.data, curve.values.data);
        button.dataset.time = peak ? String(peak.time) : "";
        write(value, peak ? fixed(peak.value * factor, digits) : "–");
        write(when, peak ? clock(peak.time) : "");
    }

    show() {
        const { values, time } = instant(this.state);
        for (const { curve, element, factor, digits } of this.cells) write(element, fixed(values[curve.key] * factor, digits));
        this.element.dataset.time = String(time);
    }
}

/** How numbers of a group are written. @param {Group} group @param {State} state */
function scaleOf({ unit, curves }, state) {
    const { factor } = shown(unit, state.units);
    const time = runOf(state).time.data;
    const largest = Math.max(...curves.map(({ values }) => Math.abs(wholePeak(time, values.data)?.value ?? 0)));
    return { factor, digits: decimals(largest * factor) };
}

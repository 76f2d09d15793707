// The legend of a chart: names, colours and values at an instant, in columns that do not wrap.
import { decimals, fixed, shown } from "./units.js";
import { ROUNDING, valueAt, wholePeak } from "./curves.js";
import { make, write } from "./make.js";
import { readable } from "./themes.js";

/** @typedef {import("./lines").Line} Line */
/** @typedef {import("./lines").Drawing} Drawing */
/** @typedef {{line: Line, cell: HTMLElement}} Value */

const ORDER = /** @type {const} */ (["now", "before", "other", "difference"]);

/** More curves than these stand in two columns. */
const FEW = 4;

export class Legend {
    /** @param {HTMLElement} element @param {(key: string) => void} toggle */
    constructor(element, toggle) {
        this.element = element;
        this.toggle = toggle;
        /** @type {Value[]} */
        this.values = [];
        this.shape = "";
        this.limits = make("span", { className: "limits" });
        /** Over the values of the run that is shown; they may be those of a machine that is held. */
        this.now = make("span", { className: "value now" });
        this.name = "";
        this.factor = 1;
        this.digits = 1;
    }

    /**
     * Rows for curves, columns for now, before and the other run.
     * @param {Drawing} drawing
     * @param {string[]} hidden
     * @param {"mm" | "SI"} units
     * @param {"light" | "dark"} theme
     * @param {string} limits beyond which a curve is too large, in words
     */
    draw(drawing, hidden, units, theme, limits) {

        const kinds = ORDER.filter((kind) => drawing.lines.some((line) => line.kind === kind));
        const keys = [...new Set(drawing.lines.map(({ key }) => key))];
        const shape = JSON.stringify([drawing.lines.map(({ key, kind, label, colour }) => [key, kind, label, colour]), drawing.names, hidden, theme]);
        write(this.limits, kinds.length > 1 ? limits.replace(/^limits? /, "") : limits);
        this.limits.title = limits;
        if (shape === this.shape) { // the same rows, with other numbers
            this.values.forEach((value) => {
                value.line = /** @type {Line} */ (drawing.lines.find(({ key, kind }) => key === value.line.key && kind === value.line.kind));
            });
            this.scale(drawing, units);
            return;
        }
        this.shape = shape;
        const focus = this.element.querySelector(":focus")?.getAttribute("data-key");
        this.values = [];
        this.scale(drawing, units);
        this.element.classList.toggle("one", kinds.length === 1);
        this.element.classList.toggle("many", kinds.length === 1 && keys.length > FEW);
        this.element.style.setProperty("--columns", String(kinds.length));
        const rows = keys.map((key) => {
            const lines = kinds.flatMap((kind) => drawing.lines.filter((line) => line.key === key && line.kind === kind));
            const button = make("button", {
                type: "button", className: "curve", "data-key": key, "aria-pressed": !hidden.includes(key),
                title: `${lines[0].label}: ${hidden.includes(key) ? "show" : "hide"} this curve`,
            }, swatch(lines[0], theme), make("span", { className: "name" }, lines[0].label));
            button.addEventListener("click", () => this.toggle(key));
            return make("div", { className: "row" }, button, ...lines.map((line) => this.value(line)));
        });
        this.name = kinds.length > 1 ? (drawing.names.now ?? "") : "";
        const heads = kinds.map((kind) => (kind === "now" ? this.now : heading(kind, drawing.names[kind] ?? kind)));
        this.element.replaceChildren(make("div", { className: "row head" }, this.limits, ...heads), ...rows);
        if (focus) /** @type {HTMLElement | null} */ (this.element.querySelector(`[data-key="${CSS.escape(focus)}"]`))?.focus();
    }

    /** @param {Drawing} drawing @param {"mm" | "SI"} units */
    scale(drawing, units) {
        this.factor = shown(drawing.unit, units).factor;
        this.digits = decimals(this.factor * Math.max(0, ...drawing.lines.map(largest)));
    }

    /** @param {Line} line */
    value(line) {
        const cell = make("span", { className: "value", "data-kind": line.kind });
        this.values.push({ line, cell });
        return cell;
    }

    /**
     * Show values at an instant.
     * @param {number} time [s]
     * @param {import("./types").Instant | null} now what the page shows, if it is that
     */
    at(time, now) {
        write(this.now, now?.byHand ? "held" : this.name);
        this.now.classList.toggle("held", Boolean(now?.byHand));
        const own = now?.values;
        for (const { line, cell } of this.values) {
            const value = own && line.kind === "now" ? own[line.key] : valueAt(line.time, line.values, time);
            write(cell, fixed(value * this.factor, this.digits));
        }
    }
}

/** @param {Line} line */
function largest({ time, values, scale }) {
    const found = Math.abs(wholePeak(time, values)?.value ?? 0);
    return found > ROUNDING * scale ? found : 0;
}

/** @param {Line} line @param {"light" | "dark"} theme */
function swatch({ colour }, theme) {
    const mark = make("span", { className: "swatch", "aria-hidden": "true" });
    mark.style.setProperty("--colour", readable(colour, theme));
    return mark;
}

/** @param {string} kind @param {string} name */
function heading(kind, name) {
    return make("span", { className: `value ${kind}`, title: name }, name);
}

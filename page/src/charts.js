// Three linked charts: any curves of the run over one axis of time, with one cursor.
import { nearest, pointAt } from "./against.js";
import { Chart, EDGE, GUTTER, limitsOf, strictest } from "./chart.js";
import { listen } from "./chart_pointer.js";
import { groupsOf, wholePeak, wholeRange } from "./curves.js";
import { instant, runOf } from "./instant.js";
import { Legend } from "./legend.js";
import { drawingOf, groupNames, groupOf, hiddenIn, overIn, shownSpan } from "./lines.js";
import { choose, make } from "./make.js";
import { readable, resolved } from "./themes.js";
import { clock, decimals, fixed, shown, titled } from "./units.js";

/** @typedef {import("./types").State} State */
/** @typedef {import("./lines").Drawing} Drawing */

const COUNT = 3;
/** What makes a chart draw again; all else only moves its cursors. */
const DRAWN = ["document", "run", "solved", "charts", "compare", "difference", "units", "theme", "zoom"];

/** @param {HTMLElement} element @param {State} state */
export function mount(element, state) {
    element.style.setProperty("--gutter", `${GUTTER}px`);
    element.style.setProperty("--edge", `${EDGE}px`);
    const charts = Array.from({ length: COUNT }, (_, index) => new Panel(state, index, index === COUNT - 1));
    element.append(...charts.map(({ figure }) => figure));
    new ResizeObserver(() => charts.forEach((chart) => chart.fit())).observe(element);
    state.subscribe((_, changed) => {
        const whole = DRAWN.some((name) => changed.has(name));
        document.documentElement.classList.toggle("still", runOf(state).time.data.length < 2); // one pose has no time
        for (const chart of charts) {
            if (whole) chart.draw();
            chart.move();
        }
    });
    window.p3dof.charts = charts;
}

/**
 * Choose what a chart shows.
 * @param {State} state
 * @param {number} index
 * @param {Partial<import("./types").ChartChoice>} changes
 */
export function setChart(state, index, changes) {
    const charts = Array.from({ length: Math.max(COUNT, index + 1) }, (_, i) => (
        { group: groupOf(state, i), hidden: hiddenIn(state, i), over: overIn(state, i) }));
    charts[index] = { ...charts[index], ...changes };
    state.set({ charts });
}

class Panel {
    /** @param {State} state @param {number} index @param {boolean} ticks */
    constructor(state, index, ticks) {
        this.state = state;
        this.index = index;
        this.ticks = ticks;
        /** @type {Drawing | null} */
        this.drawing = null;
        this.cursor = make("div", { className: "cursor" });
        this.hover = make("div", { className: "hover", hidden: true });
        this.selection = make("div", { className: "selection", hidden: true });
        this.overlay = make("div", { className: "overlay", "aria-hidden": "true" }, this.selection, this.hover, this.cursor);
        this.canvas = make("div", { className: "canvas" });
        this.plot = make("div", { className: "plot", tabIndex: 0, role: "slider", "data-chart": String(index) }, this.canvas, this.overlay);
        this.select = make("select", { "aria-label": `Curves of chart ${index + 1}` });
        this.select.addEventListener("change", () => setChart(state, index, { group: this.select.value, hidden: [] }));
        this.over = make("select", { className: "over", title: "Horizontal axis", "aria-label": `Horizontal axis of chart ${index + 1}` });
        this.over.addEventListener("change", () => setChart(state, index, { over: this.over.value }));
        /** Where curves are that are drawn over another one. @type {HTMLElement[]} */
        this.spots = [];
        const list = make("div", { className: "legend" });
        this.legend = new Legend(list, (key) => this.toggle(key));
        this.figure = make("figure", { className: "chart" }, this.plot,
            make("figcaption", { className: "side" }, make("div", { className: "axes" }, this.select, this.over), list));
        if (ticks) this.figure.classList.add("last");
        this.chart = new Chart(this.canvas, 0, 0);
        listen(this.plot, this.selection, state, {
            timeAt: (x, y) => this.timeAt(x, y), zooms: () => !this.drawing?.over, plot: () => this.overlay.getBoundingClientRect(), marks: () => this.chart.marks,
        });
    }

    /** @param {string} key */
    toggle(key) {
        const hidden = hiddenIn(this.state, this.index);
        const others = hidden.filter((name) => name !== key);
        setChart(this.state, this.index, { hidden: others.length < hidden.length ? others : [...hidden, key] });
    }

    fit() {
        const { clientWidth, clientHeight } = this.canvas;
        if (!clientWidth || !clientHeight) return;
        this.chart.resize(clientWidth, clientHeight);
        this.place();
        this.move();
    }

    draw() {
        const { state, index } = this;
        const group = groupOf(state, index);
        const hidden = hiddenIn(state, index);
        const theme = resolved(state.theme);
        const drawing = drawingOf(state, index);
        this.drawing = drawing;
        choose(this.select, groupNames(state).map((name) => [name, titled(name, unitOf(state, name), state.units)]), group);
        const curves = runOf(state).curves.map(({ key, label, unit }) => /** @type {[string, string]} */ ([key, titled(label, unit, state.units)]));
        choose(this.over, [["", "time"], ...curves], overIn(state, index));
        this.legend.draw(drawing, hidden, state.units, theme, limitsText(drawing, state.units));
        const lines = drawing.lines.filter(({ key }) => !hidden.includes(key));
        this.span = shownSpan(state);
        this.chart.resize(this.canvas.clientWidth || 600, this.canvas.clientHeight || 120);
        this.chart.draw({ lines, unit: drawing.unit, units: state.units, theme, span: this.span, ticks: this.ticks || drawing.over !== null, over: drawing.over });
        this.lines = lines;
        const spots = drawing.over ? lines : [];
        this.spots.forEach((spot) => spot.remove());
        this.spots = spots.map(({ colour, kind }) => make("div", { className: `spot ${kind}`, style: `--colour: ${readable(colour, theme)}` }));
        this.overlay.append(...this.spots);
        this.place();
        this.describe(lines);
    }

    /** Put our cursors where uPlot's plot is. */
    place() {
        const over = this.chart.plot?.over;
        if (!over) return;
        Object.assign(this.overlay.style, { left: over.style.left, top: over.style.top, width: over.style.width, height: over.style.height });
        this.width = over.clientWidth;
    }

    /** @param {import("./lines").Line[]} lines */
    describe(lines) {
        if (!this.drawing) return;
        const { unit, factor } = shown(this.drawing.unit, this.state.units);
        const texts = lines.filter(({ kind }) => kind === "now" || kind === "difference").map((line) => {
            const [low, high] = wholeRange(line.values);
            const peak = wholePeak(line.time, line.values);
            const digits = decimals(factor * Math.max(Math.abs(low), Math.abs(high)));
            const range = `${line.label} from ${fixed(low * factor, digits)} to ${fixed(high * factor, digits)} ${unit}`;
            return peak ? `${range}, largest at ${clock(peak.time)}` : `${line.label} without values`;
        });
        this.plot.setAttribute("aria-label", `${this.drawing.group} over ${this.drawing.over?.label ?? "time"}: ${texts.join("; ")}`);
        const [start, end] = shownSpan(this.state);
        this.plot.setAttribute("aria-valuemin", String(start));
        this.plot.setAttribute("aria-valuemax", String(end));
    }

    move() {
        const { state, span } = this;
        if (!span) return;
        const at = state.hover ?? state.time, over = this.drawing?.over;
        const now = state.hover === null ? instant(state) : null;
        stand(this.cursor, over ? NaN : this.x(state.time), this.width ?? 0);
        if (over) this.spot(at, now?.byHand ? now.values : null);
        if (state.hover === null || over) this.hover.hidden = true;
        else {
            stand(this.hover, this.x(state.hover), this.width ?? 0);
            this.hover.dataset.time = this.ticks ? clock(state.hover) : "";
            this.hover.classList.toggle("late", this.x(state.hover) > (this.width ?? 0) - 60);
        }
        this.legend.at(at, now);
        this.plot.setAttribute("aria-valuenow", String(state.time));
        this.plot.setAttribute("aria-valuetext", clock(state.time));
    }

    /** Put a dot on each curve that is drawn over another one. @param {number} time [s] @param {Record<string, number> | null} held what is known where the machine is held */
    spot(time, held) {
        const plot = this.chart.plot, over = overIn(this.state, this.index);
        if (!plot) return;
        this.lines?.forEach((line, k) => {
            const [x, y] = held && line.kind === "now" ? [held[over], held[line.key]] : pointAt(line, time);
            const at = [plot.valToPos(x, "x"), plot.valToPos(y, "y")];
            this.spots[k].hidden = !(at[0] >= 0 && at[0] <= plot.over.clientWidth && at[1] >= 0 && at[1] <= plot.over.clientHeight);
            this.spots[k].style.transform = `translate(${at[0]}px, ${at[1]}px)`;
        });
    }

    /** @param {number} time [s] @returns {number} [px] in the plot */
    x(time) {
        const [start, end] = this.span ?? [0, 1];
        return ((time - start) / (end - start)) * (this.width ?? 0);
    }

    /** @param {number} x @param {number} y [px] in the plot @returns {number} [s] */
    timeAt(x, y) {
        const [start, end] = this.span ?? [0, 1], plot = this.chart.plot;
        if (this.drawing?.over && plot) {
            const own = (this.lines ?? []).filter(({ kind }) => kind === "now" || kind === "difference");
            return nearest(own, [start, end], (value) => plot.valToPos(value, "x"), (value) => plot.valToPos(value, "y"), x, y) ?? this.state.time;
        }
        return start + (x / (this.width || 1)) * (end - start);
    }
}

/** @param {HTMLElement} line @param {number} x @param {number} width */
function stand(line, x, width) {
    line.hidden = !(x >= -0.5 && x <= width + 0.5);
    line.style.transform = `translateX(${x}px)`;
}

/** @param {State} state @param {string} group */
const unitOf = (state, group) => groupsOf(runOf(state)).find(({ name }) => name === group)?.unit ?? "";

/** @param {Drawing} drawing @param {"mm" | "SI"} units */
function limitsText(drawing, units) {
    const limits = limitsOf(drawing.lines), [low, high] = strictest(limits);
    const one = limits.every(([least, most]) => least === low && most === high) ? "" : "strictest ";
    const { unit, factor } = shown(drawing.unit, units);
    /** @param {number} value */
    const text = (value) => fixed(value * factor, Number.isInteger(+(value * factor).toFixed(6)) ? 0 : decimals(Math.abs(value * factor)));
    if (low !== null && high !== null) {
        return low === -high ? `${one}limits ±${text(high)} ${unit}` : `${one}limits ${text(low)} to ${text(high)} ${unit}`;
    }
    if (high !== null) return `${one}limit ${text(high)} ${unit}`;
    return low !== null ? `${one}limit ${text(low)} ${unit}` : "";
}

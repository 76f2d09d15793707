// Three linked charts: any curves of the run over one axis of time, with one cursor.
import { Chart, EDGE, GUTTER, limitsOf, strictest } from "./chart.js";
import { listen } from "./chart_pointer.js";
import { groupsOf, wholePeak, wholeRange } from "./curves.js";
import { instant, runOf } from "./instant.js";
import { Legend } from "./legend.js";
import { drawingOf, groupNames, groupOf, hiddenIn, shownSpan } from "./lines.js";
import { choose, make, write } from "./make.js";
import { resolved } from "./themes.js";
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
        { group: groupOf(state, i), hidden: hiddenIn(state, i) }));
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
        this.limits = make("p", { className: "note limits" });
        const list = make("div", { className: "legend" });
        this.legend = new Legend(list, (key) => this.toggle(key));
        this.figure = make("figure", { className: "chart" }, this.plot,
            make("figcaption", { className: "side" }, this.select, list, this.limits));
        if (ticks) this.figure.classList.add("last");
        this.chart = new Chart(this.canvas, 0, 0);
        listen(this.plot, this.selection, state, {
            timeAt: (x) => this.timeAt(x), plot: () => this.overlay.getBoundingClientRect(), marks: () => this.chart.marks,
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
        const drawing = drawingOf(state, group);
        this.drawing = drawing;
        choose(this.select, groupNames(state).map((name) => [name, titled(name, unitOf(state, name), state.units)]), group);
        this.legend.draw(drawing, hidden, state.units, theme);
        write(this.limits, limitsText(drawing, state.units));
        const lines = drawing.lines.filter(({ key }) => !hidden.includes(key));
        this.span = shownSpan(state);
        this.chart.resize(this.canvas.clientWidth || 600, this.canvas.clientHeight || 120);
        this.chart.draw({ lines, unit: drawing.unit, units: state.units, theme, span: this.span, ticks: this.ticks });
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
        this.plot.setAttribute("aria-label", `${this.drawing.group} over time: ${texts.join("; ")}`);
        const [start, end] = shownSpan(this.state);
        this.plot.setAttribute("aria-valuemin", String(start));
        this.plot.setAttribute("aria-valuemax", String(end));
    }

    move() {
        const { state, span } = this;
        if (!span) return;
        const at = state.hover ?? state.time;
        stand(this.cursor, this.x(state.time), this.width ?? 0);
        if (state.hover === null) this.hover.hidden = true;
        else {
            stand(this.hover, this.x(state.hover), this.width ?? 0);
            this.hover.dataset.time = this.ticks ? clock(state.hover) : "";
            this.hover.classList.toggle("late", this.x(state.hover) > (this.width ?? 0) - 60);
        }
        this.legend.at(at, state.hover === null ? instant(state).values : null);
        this.plot.setAttribute("aria-valuenow", String(state.time));
        this.plot.setAttribute("aria-valuetext", clock(state.time));
    }

    /** @param {number} time [s] @returns {number} [px] in the plot */
    x(time) {
        const [start, end] = this.span ?? [0, 1];
        return ((time - start) / (end - start)) * (this.width ?? 0);
    }

    /** @param {number} x [px] in the plot @returns {number} [s] */
    timeAt(x) {
        const [start, end] = this.span ?? [0, 1];
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
    const [low, high] = strictest(limitsOf(drawing.lines));
    const { unit, factor } = shown(drawing.unit, units);
    /** @param {number} value */
    const text = (value) => fixed(value * factor, Number.isInteger(+(value * factor).toFixed(6)) ? 0 : decimals(Math.abs(value * factor)));
    if (low !== null && high !== null) {
        return low === -high ? `limits ±${text(high)} ${unit}` : `limits ${text(low)} to ${text(high)} ${unit}`;
    }
    if (high !== null) return `limit ${text(high)} ${unit}`;
    return low !== null ? `limit ${text(low)} ${unit}` : "";
}

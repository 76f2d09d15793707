// One chart: uPlot draws lines and axes; limits as bands and peaks with their values are drawn by us.
import uPlot from "uplot";
import { reach, trace } from "./against.js";
import { ROUNDING, axisOf, peakOf, rangeOf, samplesIn, wholePeak, wholeRange } from "./curves.js";
import { aligned, thinned } from "./lines.js";
import { placed } from "./peak_labels.js";
import { readable } from "./themes.js";
import { decimals, decimalsOf, fixed, roundStep, shown } from "./units.js";

/** @typedef {import("./lines").Line} Line */
/** @typedef {{text: string, x: number, y: number, width: number, height: number, key: string, time: number,
 *             value: number, dot: {x: number, y: number}, colour: string}} Mark */
/** @typedef {{lines: Line[], unit: string, units: "mm" | "SI", theme: "light" | "dark",
 *             span: [number, number], ticks: boolean, over: import("./against").Over | null}} Content */
/** @typedef {{ink: string, soft: string, line: string, shade: string, paper: string}} Palette */

/** Room of the y axis, which the time bar keeps too [px]. */
export const GUTTER = 58;
/** Room beside the plot for what ends there [px]. */
export const EDGE = 18;
const TICKS = 22;
/** Between numbers of the y axis, at least [px]. */
const ROW = 26;
/** Between numbers of the axis of another curve, at least [px]. */
const COLUMN = 80;
const FONT = '11px system-ui, "DejaVu Sans", sans-serif';
const DASHES = { now: [], before: [5, 4], other: [8, 3, 2, 3], difference: [] };

/** @type {Record<"light" | "dark", Palette>} */
const PALETTES = {
    light: { ink: "#16202b", soft: "#5b6876", line: "#e2e7ec", shade: "rgb(185 28 28 / 10%)", paper: "#ffffff" },
    dark: { ink: "#f0f4f8", soft: "#9aa7b4", line: "#313a44", shade: "rgb(248 113 113 / 20%)", paper: "#1b2128" },
};

/** A plot in an element of the page, or in one that is nowhere, for pictures. */
export class Chart {
    /** @param {HTMLElement} element @param {number} width @param {number} height [px] */
    constructor(element, width, height) {
        this.element = element;
        /** @type {Mark[]} */
        this.marks = [];
        /** All samples of what is drawn. @type {ReturnType<typeof aligned>} */
        this.whole = [[]];
        /** @type {Content | null} */
        this.content = null;
        /** @type {uPlot | null} */
        this.plot = null;
        this.size = { width, height };
        this.shape = "";
    }

    /** Draw something else. @param {Content} content */
    draw(content) {
        this.content = content;
        const shape = JSON.stringify([content.lines.map(({ key, kind, colour }) => [key, kind, colour]), content.theme, content.ticks, !content.over]);
        this.whole = content.over ? [[], ...content.lines.map(() => [])] : aligned(content.lines); // those over a curve are drawn by us
        const data = this.seen(content);
        if (!this.plot || shape !== this.shape) {
            this.plot?.destroy();
            this.shape = shape;
            this.plot = new uPlot(this.options(content), data, this.element);
            this.plot.root.setAttribute("aria-hidden", "true");
        } else if (data[0] !== this.plot.data[0] || data.some((values, i) => values !== this.plot?.data[i])) {
            this.plot.setData(data, false);
        }
        this.scale();
    }

    /** What uPlot draws of it. @param {Content} content */
    seen({ span }) {
        const columns = Math.max(100, Math.round((this.size.width - GUTTER - EDGE) * uPlot.pxRatio));
        return /** @type {uPlot.AlignedData} */ (/** @type {unknown} */ (thinned(/** @type {any} */ (this.whole), span, columns)));
    }

    /** @param {number} width @param {number} height [px] */
    resize(width, height) {
        if (width === this.size.width && height === this.size.height) return;
        this.size = { width, height };
        if (!this.plot || width < 60 || height < 30) return;
        this.plot.setSize(this.size);
        if (this.content) this.plot.setData(this.seen(this.content), false);
        this.scale();
    }

    scale() {
        const { plot, content } = this;
        if (!plot || !content) return;
        const { x, y } = this.range(content);
        plot.batch(() => {
            plot.setScale("x", { min: x[0], max: x[1] });
            plot.setScale("y", { min: y[0], max: y[1] });
            plot.redraw(false, true); // its numbers too: units may have changed where scales did not
        });
    }

    /** @param {Content} content @returns {{x: [number, number], y: [number, number]}} */
    range(content) {
        if (content.over) {
            const { x, y } = reach(content.lines, content.span);
            return { x: axisOf(x, []), y: axisOf(y, limitsOf(content.lines)) };
        }
        const [time, ...values] = /** @type {ArrayLike<number>[]} */ (this.whole);
        const [start, end] = samplesIn(time, content.span);
        const whole = start === 0 && end === time.length;
        const all = whole ? rangeOf(values.map(wholeRange), 0, 2) : rangeOf(values, Math.max(0, start - 1), Math.min(time.length, end + 1));
        const differences = content.lines.filter(({ kind }) => kind === "difference");
        return { x: content.span, y: axisOf(all, limitsOf(content.lines), Math.max(0, ...differences.map(({ scale }) => scale))) };
    }

    /** @param {Content} content @returns {uPlot.Options} */
    options({ lines, theme, ticks, over }) {
        const colours = PALETTES[theme];
        const axis = { stroke: colours.soft, font: FONT, grid: { stroke: colours.line, width: 1 }, ticks: { show: false } };
        return {
            ...this.size,
            padding: [8, EDGE, ticks ? 0 : 8, 0],
            cursor: { show: false },
            legend: { show: false },
            scales: { x: { time: false, auto: false }, y: { auto: false } },
            axes: [
                { ...axis, size: ticks ? TICKS : 0, gap: 4, space: 60, values: (_, splits) => over ? this.numbers(splits, "over") : ticks ? seconds(splits) : splits.map(() => ""),
                    splits: over ? (_, __, low, high) => this.round(low, high, (this.size.width - GUTTER - EDGE) / COLUMN, "over") : undefined },
                { ...axis, size: GUTTER, gap: 6, space: ROW, values: (_, splits) => this.numbers(splits, "up"),
                    splits: (_, __, low, high) => this.round(low, high, (this.size.height - (ticks ? TICKS : 8) - 8) / ROW, "up") },
            ],
            series: [{}, ...lines.map((line) => this.series(line, theme))],
            hooks: { drawClear: [(plot) => this.bands(plot)], draw: [(plot) => this.content?.over ? this.curves(plot, this.content) : this.peaks(plot)] },
        };
    }

    /** @param {Line} line @param {"light" | "dark"} theme @returns {uPlot.Series} */
    series({ colour, kind }, theme) {
        const second = kind === "before" || kind === "other";
        return {
            stroke: readable(colour, theme), width: second ? 1.25 : 1.6, dash: DASHES[kind],
            points: { show: false }, spanGaps: false,
        };
    }

    /** Round numbers in the unit that is shown. @param {number} low @param {number} high @param {number} most how many @param {"over" | "up"} which axis */
    round(low, high, most, which) {
        const { factor } = this.unit(which);
        const by = roundStep(((high - low) * factor) / Math.max(1, most));
        const count = Math.floor((high * factor) / by + 1e-9);
        const splits = [];
        for (let k = Math.ceil((low * factor) / by - 1e-9); k <= count; k++) splits.push((k * by) / factor || 0);
        return splits;
    }

    /** How an axis is written. @param {"over" | "up"} which */
    unit(which) {
        const { content } = this;
        return shown((which === "over" ? content?.over?.unit : content?.unit) ?? "", content?.units ?? "SI");
    }

    /** @param {number[]} splits stored units @param {"over" | "up"} which axis @returns {string[]} */
    numbers(splits, which) {
        if (!this.content || splits.length < 2) return splits.map(String);
        const { factor, unit } = this.unit(which);
        const said = which === "up" || unit === "1" ? "" : unit === "°" ? unit : ` ${unit}`;
        const step = Math.abs(splits[1] - splits[0]) * factor;
        const digits = decimalsOf(step);
        const largest = Math.max(...splits.map(Math.abs)) * factor;
        return splits.map((split) => fixed(split * factor, digits > 5 || largest >= 1e6 ? -1 : digits) + said);
    }

    /** Limits: beyond them is shaded. @param {uPlot} plot */
    bands(plot) {
        if (!this.content) return;
        const { ctx, bbox } = plot;
        const [low, high] = strictest(limitsOf(this.content.lines));
        ctx.save();
        ctx.fillStyle = PALETTES[this.content.theme].shade;
        if (high !== null) {
            const y = Math.min(bbox.top + bbox.height, plot.valToPos(high, "y", true));
            if (y > bbox.top) ctx.fillRect(bbox.left, bbox.top, bbox.width, y - bbox.top);
        }
        if (low !== null) {
            const y = Math.max(bbox.top, plot.valToPos(low, "y", true));
            const bottom = bbox.top + bbox.height;
            if (y < bottom) ctx.fillRect(bbox.left, y, bbox.width, bottom - y);
        }
        ctx.restore();
    }

    /** Lines over another curve. @param {uPlot} plot @param {Content} content */
    curves(plot, content) {
        const { ctx, bbox } = plot, ratio = uPlot.pxRatio;
        this.marks = [];
        ctx.save();
        ctx.beginPath();
        ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
        ctx.clip();
        for (const line of content.lines) {
            const { stroke, width, dash } = this.series(line, content.theme);
            Object.assign(ctx, { strokeStyle: stroke, lineWidth: /** @type {number} */ (width) * ratio, lineJoin: "round" });
            ctx.setLineDash((dash ?? []).map((part) => part * ratio));
            ctx.beginPath();
            trace(ctx, line, content.span, (x) => plot.valToPos(x, "x", true), (y) => plot.valToPos(y, "y", true));
            ctx.stroke();
        }
        ctx.restore();
    }

    /** Dots at the largest values within what is shown, with their values. @param {uPlot} plot */
    peaks(plot) {
        const { content } = this;
        if (!content) return;
        const { ctx, bbox } = plot;
        const ratio = uPlot.pxRatio;
        this.marks = this.place(plot, content);
        ctx.save();
        ctx.font = FONT.replace("11px", `${11 * ratio}px`);
        ctx.textBaseline = "middle";
        ctx.textAlign = "left"; // uPlot leaves that of its axes
        ctx.lineJoin = "round";
        for (const mark of this.marks) {
            ctx.fillStyle = mark.colour;
            ctx.beginPath();
            ctx.arc(bbox.left + mark.dot.x * ratio, bbox.top + mark.dot.y * ratio, 3.2 * ratio, 0, 2 * Math.PI);
            ctx.fill();
            const at = [bbox.left + mark.x * ratio, bbox.top + (mark.y + mark.height / 2) * ratio];
            ctx.strokeStyle = PALETTES[content.theme].paper; // a halo, so that lines do not cross the digits
            ctx.lineWidth = 3 * ratio;
            ctx.strokeText(mark.text, at[0], at[1]);
            ctx.fillText(mark.text, at[0], at[1]);
        }
        ctx.restore();
    }

    /** @param {uPlot} plot @param {Content} content @returns {Mark[]} in pixels of the page, from the plot's corner */
    place(plot, content) {
        const { factor } = shown(content.unit, content.units);
        const lines = content.lines.filter(({ kind }) => kind === "now" || kind === "difference");
        const found = lines.flatMap((line) => {
            const whole = content.span[0] <= line.time[0] && content.span[1] >= line.time[line.time.length - 1];
            const peak = whole ? wholePeak(line.time, line.values) : peakOf(line.time, line.values, content.span);
            const none = !peak || Math.abs(peak.value) <= ROUNDING * line.scale; // a zero has no largest value
            return none ? [] : [{ line, peak, value: peak.value * factor }];
        });
        const digits = decimals(Math.max(...found.map(({ value }) => Math.abs(value))));
        const dots = found.map(({ line, peak, value }) => {
            const text = fixed(value, digits);
            return {
                text, key: line.key, time: peak.time, value: peak.value, colour: readable(line.colour, content.theme),
                x: plot.valToPos(peak.time, "x"), y: plot.valToPos(peak.value, "y"),
                width: 6.7 * text.length + 2, height: 13, up: peak.value >= 0,
            };
        });
        const box = { x: 0, y: 0, width: plot.over.clientWidth, height: plot.over.clientHeight };
        return placed(dots, box).map((place, i) => {
            const { text, key, time, value, colour, x, y } = dots[i];
            return { text, key, time, value, colour, dot: { x, y }, ...place };
        });
    }
}

/** @param {number[]} splits @returns {string[]} */
function seconds(splits) {
    const step = splits.length > 1 ? splits[1] - splits[0] : 1;
    return splits.map((split) => `${fixed(split, decimalsOf(step))} s`);
}

/** @param {Line[]} lines @returns {[number | null, number | null][]} */
export function limitsOf(lines) {
    return lines.flatMap(({ limit }) => (limit ? [limit] : []));
}

/** @param {[number | null, number | null][]} limits @returns {[number | null, number | null]} beyond which a curve is too large */
export function strictest(limits) {
    const lows = limits.flatMap(([low]) => (low === null ? [] : [low]));
    const highs = limits.flatMap(([, high]) => (high === null ? [] : [high]));
    return [lows.length ? Math.max(...lows) : null, highs.length ? Math.min(...highs) : null];
}

// Charts as a picture: drawn anew, in light colours, at any size, with legend, values and cursor.
import { pointAt } from "./against.js";
import { Chart, EDGE, GUTTER } from "./chart.js";
import { valueAt } from "./curves.js";
import { drawingOf, hiddenIn, shownSpan } from "./lines.js";
import { readable } from "./themes.js";
import { clock, decimals, fixed, shown, titled } from "./units.js";

/** @typedef {import("./types").State} State */

const TITLE = 22;
const DASHES = { now: [], before: [5, 4], other: [8, 3, 2, 3], difference: [] };

/**
 * One chart as a canvas.
 * @param {State} state
 * @param {number} index
 * @param {number} width of the picture, in pixels of the page
 * @param {number} height
 * @returns {HTMLCanvasElement}
 */
export function chartPicture(state, index, width, height) {
    const drawing = drawingOf(state, index);
    const hidden = hiddenIn(state, index);
    const lines = drawing.lines.filter(({ key }) => !hidden.includes(key));
    const span = shownSpan(state);
    const nowhere = document.createElement("div");
    const rows = legendRows(lines, drawing, state, width);
    const top = TITLE + 18 * rows.length;
    nowhere.style.cssText = `position:absolute;left:-10000px;top:0;width:${width}px;height:${height - top}px`;
    document.body.append(nowhere);
    try {
        const chart = new Chart(nowhere, width, height - top);
        chart.draw({ lines, unit: drawing.unit, units: state.units, theme: "light", span, ticks: true, over: drawing.over });
        const drawn = /** @type {import("uplot")} */ (chart.plot);
        const picture = document.createElement("canvas");
        const ratio = drawn.ctx.canvas.width / width;
        [picture.width, picture.height] = [drawn.ctx.canvas.width, Math.round(height * ratio)];
        const to = /** @type {CanvasRenderingContext2D} */ (picture.getContext("2d"));
        to.scale(ratio, ratio);
        to.fillStyle = "#ffffff";
        to.fillRect(0, 0, width, height);
        to.fillStyle = "#16202b";
        to.font = 'bold 13px system-ui, "DejaVu Sans", sans-serif';
        to.fillText(titled(drawing.group, drawing.unit, state.units) + (drawing.over ? ` over ${drawing.over.label}` : ""), GUTTER, 15);
        legend(to, rows);
        to.drawImage(drawn.ctx.canvas, 0, top, width, height - top);
        const x = GUTTER + ((state.time - span[0]) / (span[1] - span[0])) * (width - GUTTER - EDGE);
        to.fillStyle = "#2563eb";
        if (drawing.over) spots(to, lines, state.time, drawn, top);
        else if (x >= GUTTER - 0.5 && x <= width - EDGE + 0.5) to.fillRect(x - 0.75, top + 8, 1.5, drawn.over.clientHeight);
        drawn.destroy();
        return picture;
    } finally {
        nowhere.remove();
    }
}

/** Where curves are at an instant that are drawn over another one. */
/** @param {CanvasRenderingContext2D} to @param {import("./lines").Line[]} lines @param {number} time @param {import("uplot")} plot @param {number} top */
function spots(to, lines, time, plot, top) {
    for (const line of lines) {
        const [x, y] = pointAt(line, time);
        to.fillStyle = readable(line.colour, "light");
        to.beginPath();
        to.arc(GUTTER + plot.valToPos(x, "x"), top + 8 + plot.valToPos(y, "y"), 4, 0, 2 * Math.PI);
        to.fill();
    }
}

/** All charts below each other. @param {State} state @param {number} [width] @param {number} [height] of each */
export function chartsPicture(state, width = 1000, height = 260) {
    const parts = [0, 1, 2].map((index) => chartPicture(state, index, width, height));
    const picture = document.createElement("canvas");
    picture.width = parts[0].width;
    picture.height = parts.reduce((sum, part) => sum + part.height, 0);
    const to = /** @type {CanvasRenderingContext2D} */ (picture.getContext("2d"));
    parts.reduce((top, part) => {
        to.drawImage(part, 0, top);
        return top + part.height;
    }, 0);
    return picture;
}

/** @typedef {{line: import("./lines").Line, text: string, x: number}} Entry */

/** @param {import("./lines").Line[]} lines @param {import("./lines").Drawing} drawing @param {State} state @param {number} width @returns {Entry[][]} */
function legendRows(lines, drawing, state, width) {
    const { unit, factor } = shown(drawing.unit, state.units);
    const several = new Set(lines.map(({ kind }) => kind)).size > 1;
    /** @type {Entry[][]} */
    const rows = [[]];
    let x = GUTTER;
    for (const line of lines) {
        const value = valueAt(line.time, line.values, state.time) * factor;
        const name = several ? `${line.label} (${drawing.names[line.kind] || line.kind})` : line.label;
        const text = `${name} ${fixed(value, decimals(Math.abs(value)))} ${unit}`;
        const size = 34 + 6.6 * text.length;
        if (x + size > width && rows[rows.length - 1].length) {
            rows.push([]);
            x = GUTTER;
        }
        rows[rows.length - 1].push({ line, text, x });
        x += size;
    }
    rows[0].unshift({ line: { .../** @type {any} */ ({ colour: "", kind: "now" }) }, text: `at ${clock(state.time)}`, x: width - 110 });
    return rows;
}

/** @param {CanvasRenderingContext2D} to @param {Entry[][]} rows */
function legend(to, rows) {
    to.font = '12px system-ui, "DejaVu Sans", sans-serif';
    rows.forEach((row, i) => row.forEach(({ line, text, x }) => {
        const y = TITLE + 18 * i + 8;
        to.fillStyle = "#16202b";
        if (!line.colour) {
            to.fillText(text, x, 15);
            return;
        }
        to.strokeStyle = readable(line.colour, "light");
        to.lineWidth = 2;
        to.setLineDash(DASHES[line.kind]);
        to.beginPath();
        to.moveTo(x, y);
        to.lineTo(x + 18, y);
        to.stroke();
        to.setLineDash([]);
        to.fillText(text, x + 23, y + 4);
    }));
}

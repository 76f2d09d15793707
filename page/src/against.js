// Curves over another curve in place of time: how far they go, where they are in a plot, what is near a pointer.
import { rangeOf, samplesIn, valueAt } from "./curves.js";

/** @typedef {import("./lines").Line} Line */
/** @typedef {(value: number) => number} Scale from values to pixels */
/** @typedef {{label: string, unit: string}} Over what stands along the horizontal axis */

/** @param {Line} line @returns {ArrayLike<number>} */
const along = ({ x }) => x ?? [];

/** The ranges across and up of what is drawn within a span of time. @param {Line[]} lines @param {[number, number]} span [s] */
export function reach(lines, span) {
    /** @type {[number, number][]} */
    const ends = [[NaN, NaN], [NaN, NaN]];
    for (const line of lines) {
        const [start, end] = samplesIn(line.time, span);
        [along(line), line.values].forEach((values, k) => {
            const [low, high] = rangeOf([values], start, end);
            if (!(low >= ends[k][0])) ends[k][0] = Number.isNaN(low) ? ends[k][0] : low;
            if (!(high <= ends[k][1])) ends[k][1] = Number.isNaN(high) ? ends[k][1] : high;
        });
    }
    return { x: ends[0], y: ends[1] };
}

/** Add a line to a path; what falls on the same pixel is left out. @param {CanvasRenderingContext2D} ctx @param {Line} line @param {[number, number]} span [s] @param {Scale} toX @param {Scale} toY */
export function trace(ctx, line, span, toX, toY) {
    const [start, end] = samplesIn(line.time, span), across = along(line);
    let [lastX, lastY] = [NaN, NaN];
    for (let i = start; i < end; i++) {
        const [x, y] = [toX(across[i]), toY(line.values[i])];
        if (Math.abs(x - lastX) < 0.5 && Math.abs(y - lastY) < 0.5) continue;
        if (Number.isNaN(lastX + lastY)) ctx.moveTo(x, y);
        else if (!Number.isNaN(x + y)) ctx.lineTo(x, y); // a gap stays one
        [lastX, lastY] = [x, y];
    }
}

/** The instant of the sample that is seen nearest to a point; null without one. @param {Line[]} lines @param {[number, number]} span [s] @param {Scale} toX @param {Scale} toY @param {number} x @param {number} y [px] */
export function nearest(lines, span, toX, toY, x, y) {
    /** @type {number | null} */
    let found = null;
    let least = Infinity;
    for (const line of lines) {
        const [start, end] = samplesIn(line.time, span), across = along(line);
        for (let i = start; i < end; i++) {
            const away = (toX(across[i]) - x) ** 2 + (toY(line.values[i]) - y) ** 2;
            if (away < least) [least, found] = [away, line.time[i]];
        }
    }
    return found;
}

/** Where a line is at an instant. @param {Line} line @param {number} time [s] @returns {[number, number]} */
export const pointAt = (line, time) => [valueAt(line.time, along(line), time), valueAt(line.time, line.values, time)];

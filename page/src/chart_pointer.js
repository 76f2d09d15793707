// Mouse and fingers on a chart: hover, seek by a click, zoom by a drag, back by a double click.
import { within } from "./state.js";

/** @typedef {import("./types").State} State */
/** @typedef {{timeAt: (x: number, y: number) => number, zooms: () => boolean, plot: () => DOMRect, marks: () => import("./chart").Mark[]}} Place */

/** Less than this is a click [px]. */
const SLACK = 5;
/** So near to a peak means the peak [px]. */
const NEAR = 8;

/**
 * @param {HTMLElement} element what takes the events
 * @param {HTMLElement} selection what shows the part that is drawn out
 * @param {State} state
 * @param {Place} place
 */
export function listen(element, selection, state, place) {
    /** @type {{x: number, id: number} | null} */
    let from = null;

    /** @param {PointerEvent} event @returns {number} from the left of the plot, inside it */
    const along = (event) => {
        const box = place.plot();
        return Math.min(Math.max(event.clientX - box.left, 0), box.width);
    };
    const down = (/** @type {PointerEvent} */ event) => event.clientY - place.plot().top;
    const drop = () => {
        from = null;
        selection.hidden = true;
    };

    element.addEventListener("pointerdown", (event) => {
        if (event.button !== 0) return;
        from = { x: along(event), id: event.pointerId };
        element.setPointerCapture(event.pointerId);
    });
    element.addEventListener("pointermove", (event) => {
        const x = along(event);
        if (event.pointerType !== "touch") state.set({ hover: place.timeAt(x, down(event)) });
        if (!from || from.id !== event.pointerId) return;
        const left = Math.min(from.x, x);
        selection.hidden = Math.abs(x - from.x) < SLACK || !place.zooms();
        selection.style.transform = `translateX(${left}px)`;
        selection.style.width = `${Math.abs(x - from.x)}px`;
    });
    element.addEventListener("pointerup", (event) => {
        if (!from || from.id !== event.pointerId) return;
        const x = along(event);
        if (Math.abs(x - from.x) < SLACK || !place.zooms()) seek(x, event);
        else zoom(from.x, x);
        drop();
    });
    element.addEventListener("pointercancel", drop);
    element.addEventListener("pointerleave", () => state.set({ hover: null }));
    element.addEventListener("dblclick", () => state.set({ zoom: null }));

    /** @param {number} x @param {PointerEvent} event */
    function seek(x, event) {
        const y = down(event);
        const peak = place.marks().find((mark) => Math.hypot(mark.dot.x - x, mark.dot.y - y) < NEAR
            || (x >= mark.x && x <= mark.x + mark.width && y >= mark.y && y <= mark.y + mark.height));
        state.set({ time: within(state, peak ? peak.time : place.timeAt(x, y)), hand: null });
    }

    /** @param {number} one @param {number} other */
    function zoom(one, other) {
        const ends = [place.timeAt(one, 0), place.timeAt(other, 0)].sort((a, b) => a - b);
        if (ends[1] > ends[0]) state.set({ zoom: [ends[0], ends[1]] });
    }
}

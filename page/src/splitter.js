// A bar between the picture and the charts, which gives more room to one of them.
import { make } from "./make.js";

/** How much of the height the charts may have [%]. */
const LEAST = 15;
const MOST = 80;
const START = 43;
const STEP = 3;

/** @param {HTMLElement} element above which the bar lies */
export function mount(element) {
    const main = /** @type {HTMLElement} */ (element.parentElement);
    let share = START;
    const bar = make("div", {
        className: "splitter", role: "separator", tabIndex: 0, "aria-orientation": "horizontal", "aria-label": "Height of the charts",
        "aria-valuemin": LEAST, "aria-valuemax": MOST, title: "drag to resize charts and picture",
    });
    element.append(bar);

    /** @param {number} wanted [%] */
    const give = (wanted) => {
        share = Math.min(MOST, Math.max(LEAST, wanted));
        main.style.setProperty("--charts-height", `${share}%`);
        bar.setAttribute("aria-valuenow", String(Math.round(share)));
    };
    bar.addEventListener("pointerdown", (event) => {
        bar.setPointerCapture(event.pointerId);
        event.preventDefault();
    });
    bar.addEventListener("pointermove", (event) => {
        if (!bar.hasPointerCapture(event.pointerId)) return;
        const { top, height } = main.getBoundingClientRect();
        give((100 * (top + height - event.clientY - element.clientHeight)) / height);
    });
    bar.addEventListener("dblclick", () => give(START));
    bar.addEventListener("keydown", (event) => {
        if (event.key !== "ArrowUp" && event.key !== "ArrowDown") return;
        give(share + (event.key === "ArrowUp" ? STEP : -STEP));
        event.preventDefault();
    });
    give(share);
}

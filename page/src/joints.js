// Sliders for the actuated joints of any robot: the page, or Python, says where it is then and what holds it there.
import { heading } from "./by_hand.js";
import { canMove, setInput, valueOf } from "./hold.js";
import { make, write } from "./make.js";
import { fixed, shown } from "./units.js";

/** @typedef {import("./types").State} State */
/** @typedef {import("./types").Input} Input */

const STEPS = 400;
const ALONE = "The joints can be moved while Python is behind the page.";

/** @param {HTMLElement} element @param {State} state */
export function mount(element, state) {
    const rows = make("div", { className: "joints" });
    const head = heading(state, "Joints", "");
    const alone = make("p", { className: "note" }, ALONE);
    element.append(head.title, rows, head.said, alone);
    /** @type {Slider[]} */
    let sliders = [];
    /** @type {Input[] | null} */
    let of = null;
    state.subscribe(() => {
        const { inputs } = state.document;
        if (of !== inputs) {
            of = inputs;
            sliders = inputs.map((input, i) => new Slider(input, i, state));
            rows.replaceChildren(...sliders.map(({ row }) => row));
        }
        sliders.forEach((slider) => slider.show());
        alone.hidden = canMove(state);
        const { engine } = state.document;
        write(alone, "why" in engine && engine.why ? `${ALONE} By itself it cannot move this robot: ${engine.why}.` : ALONE);
        const unknown = state.hand && state.engine?.held?.(state.hand)?.notes?.join(" ");
        head.show(state.refused ? `${state.refused.text}. The picture stays.` : unknown || "");
    });
}

class Slider {
    /** @param {Input} input @param {number} number @param {State} state */
    constructor(input, number, state) {
        this.input = input;
        this.state = state;
        this.held = false;
        const { low, high } = input;
        this.range = make("input", {
            type: "range", id: `joint-${number}`, name: input.key, min: String(low), max: String(high), step: String((high - low) / STEPS),
        });
        this.value = make("output", {});
        this.row = make("div", { className: "joint" }, make("label", { htmlFor: this.range.id, title: input.label }, input.label), this.range, this.value);
        this.range.addEventListener("input", () => {
            this.held = true;
            setInput(state, input, Number(this.range.value));
        });
        for (const kind of ["change", "blur", "pointerup"]) this.range.addEventListener(kind, () => void (this.held = false));
    }

    show() {
        const { input, state, range } = this;
        range.disabled = !canMove(state);
        const now = valueOf(state, input);
        const { unit, factor } = shown(input.unit, state.units);
        const text = `${fixed(now * factor, factor === 1 ? 4 : 2)} ${unit}`;
        write(this.value, text);
        range.setAttribute("aria-valuetext", text);
        if (!this.held && Number.isFinite(now)) range.value = String(now);
    }
}

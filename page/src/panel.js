// Settings of the whole page, and fields for the pose.
import { heading } from "./by_hand.js";
import { setInput, valueOf } from "./hold.js";
import * as joints from "./joints.js";
import { choose, make, mark, write } from "./make.js";
import { fixed, shown } from "./units.js";

/** @typedef {import("./types").State} State */
/** @typedef {import("./types").Input} Input */

/** Units, light or dark, and notes on the run. @param {HTMLElement} element @param {State} state */
export function settings(element, state) {
    const units = make("select", { "aria-label": "Units", title: "Units (U)" });
    units.addEventListener("change", () => state.set({ units: /** @type {State["units"]} */ (units.value) }));
    const theme = make("select", { "aria-label": "Light or dark", title: "Light or dark (T)" });
    theme.addEventListener("change", () => state.set({ theme: /** @type {State["theme"]} */ (theme.value) }));
    const help = make("button", { type: "button", title: "Keys (?)", onclick: () => state.set({ help: true }) }, "Keys");
    const notes = make("ul", { className: "note notes" });
    element.append(make("div", { className: "choices" }, units, theme, help), notes);
    state.subscribe((_, changed) => {
        const { document } = state;
        if (changed.has("document") || changed.has("run")) {
            const said = document.runs[state.run]?.notes ?? [];
            notes.replaceChildren(...said.map((text) => make("li", {}, text)));
            notes.hidden = !said.length;
        }
        choose(units, [["mm", "mm, deg"], ["SI", "SI units"]], state.units);
        choose(theme, [["auto", "System"], ["light", "Light"], ["dark", "Dark"]], state.theme);
    });
}

/** Fields for what may be set by hand. @param {HTMLElement} element @param {State} state */
export function mount(element, state) {
    if (state.document.inputs.some(({ joint }) => joint !== undefined)) return joints.mount(element, state);
    /** @type {Field[]} */
    let fields = [];
    /** @type {Input[] | null} */
    let shown = null;
    const room = make("div", { className: "fields" });
    const head = heading(state, "Pose", state.engine ? "Drag P or the ring in the picture, or type a pose; Esc goes back to the run." : "");
    element.append(head.title, room, head.said);
    state.subscribe(() => {
        const { inputs } = state.document;
        if (shown !== inputs) {
            shown = inputs;
            fields = inputs.map((input) => new Field(input, state));
            room.replaceChildren(...fields.map(({ row }) => row));
            element.hidden = !inputs.length;
        }
        fields.forEach((field) => field.show());
        head.show(state.refused?.text ?? "");
    });
}

class Field {
    /** @param {Input} input @param {State} state */
    constructor(input, state) {
        this.input = input;
        this.state = state;
        this.box = make("input", { type: "number", name: input.key });
        this.text = make("span");
        this.row = make("label", {}, this.text, this.box);
        this.taken = false; // whether what stands here was tried
        for (const kind of ["focus", "input"]) {
            this.box.addEventListener(kind, () => state.playing && state.set({ playing: false })); // what is typed is kept
        }
        this.box.addEventListener("change", () => this.take());
        this.box.addEventListener("blur", () => this.show());
    }

    show() {
        const { unit, factor } = shown(this.input.unit, this.state.units);
        write(this.text, `${this.input.label} [${unit}]`);
        this.box.step = String(10 ** Math.floor(Math.log10(Math.max(1e-9, (this.input.high - this.input.low) * factor / 100))));
        const refused = this.taken && this.state.refused !== null;
        mark(this.box, refused || this.box.validity.badInput);
        if (refused || this.box === document.activeElement) return;
        this.taken = false;
        const value = this.value() * factor;
        const text = Number.isFinite(value) ? fixed(value, factor === 1 ? 4 : 2).replace("−", "-") : "";
        if (this.box.value !== text || this.box.validity.badInput) this.box.value = text;
        mark(this.box, false);
    }

    /** What it is now, in stored units. */
    value() {
        return valueOf(this.state, this.input);
    }

    take() {
        const value = Number(this.box.value) / shown(this.input.unit, this.state.units).factor;
        this.taken = this.box.value !== "" && Number.isFinite(value);
        if (this.taken) setInput(this.state, this.input, value);
        else this.state.set({ refused: null });
    }
}

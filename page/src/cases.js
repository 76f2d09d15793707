// Total, static or dynamic: which part of the forces is shown.
import { make } from "./make.js";
import { engineOf } from "./solving.js";

/** @type {[import("./types").State["case"], string, string][]} */
const PARTS = [
    ["total", "Total", "What the motion takes"],
    ["static", "Static", "What holds each pose at rest"],
    ["dynamic", "Dynamic", "What the motion adds: total less static"],
];

/** @param {HTMLElement} element @param {import("./types").State} state */
export function mount(element, state) {
    if (!engineOf(state) || !state.document.runs.some(({ pose }) => pose)) return;
    const buttons = PARTS.map(([part, label, title]) => {
        const button = make("button", { type: "button", title, "data-case": part }, label);
        button.addEventListener("click", () => state.set({ case: part }));
        return button;
    });
    element.append(make("h2", {}, "Forces"), make("div", { className: "choice", role: "group", "aria-label": "Part of the forces" }, ...buttons));
    state.subscribe(() => buttons.forEach((button, k) => button.setAttribute("aria-pressed", String(state.case === PARTS[k][0]))));
}

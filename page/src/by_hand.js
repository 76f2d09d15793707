// The heading over what is moved by hand, with the ways to home and back; and room for what is said of it.
import { canMove, goHome, letGo } from "./hold.js";
import { make, write } from "./make.js";

/** @param {import("./types").State} state @param {string} text @param {string} idle what stands where nothing else is to be said */
export function heading(state, text, idle) {
    const home = make("button", { type: "button", title: "Hold the machine at home (H)", onclick: () => goHome(state) }, "Home");
    const back = make("button", { type: "button", title: "Let go (Esc)", onclick: () => letGo(state) }, "Back to the run");
    const said = make("p", { className: "note refused", role: "status", "data-idle": idle });
    return {
        title: make("div", { className: "title" }, make("h2", {}, text), make("span", {}, back, " ", home)),
        said,
        /** Buttons and messages keep their room: nothing moves while the machine is moved. @param {string} told */
        show(told) {
            back.disabled = !state.hand;
            home.disabled = !state.engine?.joints && !canMove(state);
            said.classList.toggle("alarm", state.refused !== null);
            write(said, told);
        },
    };
}

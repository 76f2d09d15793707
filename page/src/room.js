// How far the platform could move from where it is, and what ends it; what keeps it from being there.
import { instant } from "./instant.js";
import { make, write } from "./make.js";
import { engineOf } from "./solving.js";
import { fixed, shown } from "./units.js";
import { LEGS, margins, reasons, stopped, told, waysOut } from "./workspace.js";

/** @typedef {import("./types").State} State */

const AXES = ["y", "z", "θ"], UNITS = ["m", "m", "rad"];

/** @param {HTMLElement} element @param {State} state */
export function mount(element, state) {
    if (!engineOf(state) || !state.document.runs.some(({ pose }) => pose)) return;
    const cells = AXES.flatMap(() => [cell(), cell()]);
    const rows = AXES.map((axis, k) => make("tr", {}, make("th", { scope: "row" }, axis), cells[2 * k].element, cells[2 * k + 1].element));
    const table = make("table", { className: "room" }, make("tbody", {}, ...rows));
    const said = make("p", { className: "alarm", role: "status" });
    const kept = make("p", { className: "note" }, "At rest, along one axis at a time.");
    const map = make("input", { type: "checkbox" });
    map.addEventListener("change", () => state.set({ layers: { ...state.layers, map: map.checked } }));
    const show = make("label", { className: "check", title: "Show where P could be at this tilt, in the picture" }, map, " map");
    const left = margin(state);
    element.append(make("div", { className: "title" }, make("h2", {}, "Travel from here"), show), make("div", { className: "ways" }, table, said), kept, left.part);
    let known = "";
    state.subscribe(() => {
        map.checked = state.layers.map;
        const engine = engineOf(state), { pose } = instant(state);
        element.hidden = !pose || !engine;
        if (!engine || !pose) return;
        const key = [...pose, engine.version, state.units].join();
        if (key === known) return;
        known = key;
        const found = margins(engine, pose), ways = waysOut(engine, pose), here = reasons(found);
        left.show(found);
        ways.forEach(({ axis, sign, distance, reason }, k) => {
            const { unit, factor } = shown(UNITS[axis], state.units), digits = factor === 1 ? 3 : 1;
            const far = distance === Infinity ? "free" : `${sign < 0 ? "−" : "+"}${fixed(factor * distance, digits)} ${unit}`;
            write(cells[k].far, far);
            write(cells[k].what, distance === Infinity || !reason ? "" : stopped(reason));
            cells[k].element.dataset.distance = String(distance);
        });
        table.classList.toggle("none", here.length > 0); // it keeps its room
        write(said, here.length ? `It cannot stay here: ${here.map(told).join("; ")}.` : "");
    });
}

/** Margins of each leg, for who wants to know. @param {State} state */
function margin(state) {
    const kinds = [["Reach", "m"], ["Travel", "m"], ["Force", "N"]];
    const heads = kinds.map(() => make("th", { scope: "col" })), cells = LEGS.map(() => kinds.map(() => make("td")));
    const rows = cells.map((row, k) => make("tr", {}, make("th", { scope: "row" }, LEGS[k]), ...row));
    const angles = make("p", { className: "note" });
    const part = make("details", { className: "margins" }, make("summary", {}, "Margins of each leg"),
        make("table", {}, make("thead", {}, make("tr", {}, make("td"), ...heads)), make("tbody", {}, ...rows)), angles);
    return {
        part,
        /** @param {import("./workspace.js").Margins} found */
        show(found) {
            const values = LEGS.map((_, k) => [found.reach[k], Math.min(found.low[k], found.high[k]), found.force[k]]);
            kinds.forEach(([name, stored], i) => {
                const { unit, factor } = shown(stored, state.units);
                write(heads[i], `${name} [${unit}]`);
                values.forEach((row, k) => {
                    write(cells[k][i], fixed(row[i] * factor, factor === 1 && unit === "m" ? 3 : 1));
                    cells[k][i].classList.toggle("alarm", row[i] < 0);
                });
            });
            const { unit, factor } = shown("rad", state.units), digits = factor === 1 ? 3 : 1;
            const angle = (/** @type {number} */ value) => `${fixed(value * factor, digits)}${unit === "°" ? "" : " "}${unit}`;
            write(angles, `${angle(found.singular)} from a singular pose, ${angle(found.tilt)} from the tilt limit.`);
        },
    };
}

/** A distance, and what ends it. */
function cell() {
    const far = make("span", { className: "far" }), what = make("span", { className: "what" });
    return { element: make("td", {}, far, what), far, what };
}

// The studio: where a machine works well, and which machines would work better.
import { mountFront, mountParallel } from "./designs.js";
import { mountMap, mountSlice } from "./map.js";
import { mountMachine } from "./machine.js";
import { State, shown } from "./state.js";
import { shown as inUnits } from "../units.js";

/** @param {string} id @returns {any} */
const element = (id) => document.getElementById(id);

/** @param {State} state @param {HTMLSelectElement} select @param {{ name: string, unit: string }[]} items @param {number} chosen @param {(k: number) => void} choose */
function offer(state, select, items, chosen, choose) {
    select.replaceChildren(...items.map((item, k) => new Option(state.named(item), String(k), k === chosen, k === chosen)));
    state.watch((change) => change === "units" && items.forEach((item, k) => void (select.options[k].text = state.named(item))));
    select.addEventListener("change", () => choose(Number(select.value)));
}

/** @param {HTMLTableElement} table @param {string} caption @param {[string, string, boolean?][]} rows */
function fill(table, caption, rows) {
    const body = document.createElement("tbody");
    for (const [name, value, current] of rows) {
        const row = body.insertRow(), head = document.createElement("th");
        head.scope = "row";
        head.textContent = name;
        row.append(head);
        row.insertCell().textContent = value;
        if (current) row.setAttribute("aria-current", "true");
    }
    table.replaceChildren(body);
    table.createCaption().textContent = caption;
}

/** Lengths of the machine, and how large its workspace is. @param {State} state */
function showFacts(state) {
    const { machine, sizes } = state.studio, { unit, factor } = state.poseUnits.y;
    const lengths = /** @type {const} */ (["R", "r", "L"]).map((name) => `${name} = ${shown(machine[name] * factor)} ${unit}`);
    const regions = sizes.map((size) => `${size.name} ${state.told(size, size.value)} ${inUnits(size.unit, state.units).unit}`);
    element("facts").textContent = `${lengths.join(", ")}; ${regions.join(", ")} within the limits`;
}

/** @param {State} state */
function showPlace(state) {
    const { map } = state.studio, { i, j } = state.place;
    element("meaning").textContent = map.indices[state.index].meaning;
    const inside = map.inside[j * map.y.length + i] ? "" : ", outside of the limits";
    fill(
        element("values"),
        `At ${state.where(i, j).y}, ${state.where(i, j).theta}${inside}; no index depends on z`,
        map.indices.map((index, k) => [state.named(index), state.told(index, state.at(k, i, j)), k === state.index]),
    );
}

/** @param {State} state */
function showDesign(state) {
    const designs = state.studio.designs;
    if (!designs) return;
    element("count").textContent = `${state.selected.size} of ${state.count} designs selected`;
    if (state.design === null) return;
    const row = state.design;
    fill(
        element("design"),
        `Design ${row + 1}${row === designs.start ? ", the start" : ""}; drag across points or along axes to select, click a point to look at it`,
        designs.columns.map((column) => [state.named(column), state.told(column, column.values[row])]),
    );
}

/** @param {State} state */
function save(state) {
    const { columns } = /** @type {NonNullable<import("./state.js").Studio["designs"]>} */ (state.studio.designs);
    const header = ["design", ...columns.map(({ name, unit }) => (unit ? `${name} [${unit}]` : name))];
    const lines = [...state.selected].sort((a, b) => a - b).map((row) => [row + 1, ...columns.map(({ values }) => values[row] ?? "")].join(","));
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([`${[header.join(","), ...lines].join("\n")}\n`], { type: "text/csv" }));
    link.download = "designs.csv";
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}

/** @param {State} state @returns {any[]} */
function mountDesigns(state) {
    const { columns } = /** @type {NonNullable<import("./state.js").Studio["designs"]>} */ (state.studio.designs);
    element("design-room").hidden = false;
    const front = mountFront(element("front"), state), parallel = mountParallel(element("parallel"), state);
    offer(state, element("across"), columns, state.axes[0], (k) => state.chooseAxis(0, k));
    offer(state, element("up"), columns, state.axes[1], (k) => state.chooseAxis(1, k));
    element("clear").addEventListener("click", () => {
        parallel.clear();
        state.select(Array.from({ length: state.count }, (_, row) => row));
    });
    element("save").addEventListener("click", () => save(state));
    showDesign(state);
    state.watch((change) => (change === "selection" || change === "units") && showDesign(state));
    return [front, parallel];
}

function start() {
    const state = new State(JSON.parse(element("p3dof-studio").textContent));
    element("title").textContent = state.studio.title;
    showFacts(state);
    element("units").addEventListener("change", (/** @type {any} */ { target }) => state.chooseUnits(target.value));
    /** @type {{ chart: any, draw: () => void, fit?: () => void }[]} */
    const charts = [
        mountMap(element("map"), state),
        mountSlice(element("slice-y"), state, "y"),
        mountSlice(element("slice-theta"), state, "theta"),
        ...(state.count ? mountDesigns(state) : []),
    ];
    mountMachine(element("machine"), state);
    offer(state, element("index"), state.studio.map.indices, state.index, (k) => state.chooseIndex(k));
    showPlace(state);
    state.watch((change) => {
        if (change === "units") showFacts(state);
        if (change === "index" || change === "place" || change === "units") showPlace(state);
    });
    addEventListener("resize", () => charts.forEach((each) => (each.fit ? each.fit() : each.chart.resize())));
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => charts.forEach(({ draw }) => draw()));
    Object.assign(globalThis, { studio: { state, charts: charts.map(({ chart }) => chart) } });
}

try {
    start();
} catch (problem) {
    const fault = element("fault");
    fault.textContent = `The page cannot be shown: ${problem}`;
    fault.hidden = false;
    throw problem;
}

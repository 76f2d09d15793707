// The workspace map of the present tilt: where P can be, in colours, with their legend.
import { instant } from "./instant.js";
import { choose, make, write } from "./make.js";
import { engineOf } from "./solving.js";
import { fixed, shown } from "./units.js";
import { BEYOND_FORCE, BEYOND_REACH, BEYOND_SINGULAR, BEYOND_TILT, BEYOND_TRAVEL, POSSIBLE, workspaceMap } from "./workspace.js";

/** @typedef {import("./types").State} State */
/** @typedef {import("./workspace.js").WorkspaceMap} WorkspaceMap */
/** @typedef {State["shade"]} Shade */

/** From least to most, as the colour-blind see it too (viridis). */
const SCALE = [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]];
/** @type {Record<number, [string, number[]]>} */
const STATES = {
    [POSSIBLE]: ["possible", [46, 160, 67, 150]],
    [BEYOND_TRAVEL]: ["exceeds a slider's travel", [128, 140, 152, 120]],
    [BEYOND_FORCE]: ["exceeds a force limit", [209, 73, 43, 170]],
    [BEYOND_TILT]: ["exceeds the tilt limit", [160, 120, 60, 150]],
    [BEYOND_SINGULAR]: ["singular: not held", [140, 60, 160, 170]],
};
const OPACITY = 165;
/** @type {[Shade, string][]} */
const SHADES = [["force", "largest static force"], ["margin", "least margin"], ["status", "what is possible"]];

/** @type {WeakMap<State, {key: string, map: WorkspaceMap, range: number[], milliseconds: number}>} */
const latest = new WeakMap();
/** The map that is drawn, and how long it took; null without. @param {State} state */
export const drawnMap = (state) => (state.map ? (latest.get(state) ?? null) : null);

/** Keeps the map in step with tilt and machine: before it is drawn. @param {State} state */
export function follow(state) {
    state.subscribe(() => {
        const engine = engineOf(state), pose = engine && state.layers.map ? instant(state).pose : null;
        if (!engine || !pose || !Number.isFinite(pose[2])) return void (state.map = null);
        const key = [pose[2], engine.version, state.shade].join();
        if (state.map && latest.get(state)?.key === key) return;
        const start = performance.now(), map = workspaceMap(engine, pose[2]), range = rangeOf(map, state.shade);
        state.map = pictureOf(map, state.shade, range, engine.lengths.h);
        latest.set(state, { key, map, range, milliseconds: performance.now() - start });
    });
}

/** What a point is shaded by: a force [N] or a length [m]. @param {WorkspaceMap} map @param {Shade} shade @param {number} i @param {number} at */
const valueAt = (map, shade, i, at) => (shade === "force" ? map.force[i] : Math.min(map.margin[i], map.room[at]));

/** @param {WorkspaceMap} map @param {Shade} shade */
export function rangeOf(map, shade) {
    let [low, high] = [Infinity, -Infinity];
    map.status.forEach((status, at) => {
        if (status !== POSSIBLE) return;
        const value = valueAt(map, shade, at % map.columns, at);
        if (value < low) low = value;
        if (value > high) high = value;
    });
    return low <= high ? [low, high] : [0, 1];
}

/** @param {WorkspaceMap} map @param {Shade} shade @param {number[]} range @param {number} depth of P below the sliders at home [m] @returns {import("./types").Picture} */
export function pictureOf(map, shade, [low, high], depth) {
    const { columns, rows, status } = map, rgba = new Uint8Array(4 * columns * rows);
    const ramp = Uint8Array.from({ length: 3 * 256 }, (_, k) => between(Math.floor(k / 3) / 255)[k % 3]);
    const scale = high > low ? 255 / (high - low) : 0;
    for (let at = 0; at < status.length; ++at) {
        if (status[at] === BEYOND_REACH) continue;
        const plain = STATES[status[at]][1], o = 4 * at;
        if (status[at] !== POSSIBLE || shade === "status") {
            rgba.set(plain, o);
            continue;
        }
        const k = 3 * Math.round((valueAt(map, shade, at % columns, at) - low) * scale);
        rgba[o] = ramp[k];
        rgba[o + 1] = ramp[k + 1];
        rgba[o + 2] = ramp[k + 2];
        rgba[o + 3] = OPACITY;
    }
    const half = [(map.y[1] - map.y[0]) / (columns - 1) / 2, (map.z[1] - map.z[0]) / (rows - 1) / 2];
    return {
        y: [map.y[0] - half[0], map.y[1] + half[0]], z: [map.z[0] - half[1] - depth, map.z[1] + half[1] - depth],
        width: columns, height: rows, rgba,
    };
}

/** @param {number} share */
function between(share) {
    const place = share * (SCALE.length - 1), k = Math.min(Math.floor(place), SCALE.length - 2);
    return [0, 1, 2].map((i) => Math.round(SCALE[k][i] + (place - k) * (SCALE[k + 1][i] - SCALE[k][i])));
}

/** The legend over the picture. @param {HTMLElement} element @param {State} state */
export function mount(element, state) {
    if (!engineOf(state)) return;
    const strip = make("span", { className: "strip" });
    strip.style.background = `linear-gradient(to right, ${SCALE.map((rgb) => `rgb(${rgb.join(" ")})`).join(", ")})`;
    const [least, most] = [make("span"), make("span")];
    const scale = make("div", { className: "scale" }, least, strip, most);
    const shade = make("select", { "aria-label": "What the workspace map shows" });
    shade.addEventListener("change", () => state.set({ shade: /** @type {Shade} */ (shade.value) }));
    const tilt = make("span"), list = make("ul");
    const legend = make("div", { className: "map-legend", role: "group", "aria-label": "Workspace map" },
        make("div", { className: "row" }, tilt, shade), scale, list);
    element.append(legend);
    window.p3dof.map = () => drawnMap(state);
    state.subscribe(() => {
        const drawn = drawnMap(state);
        legend.hidden = !drawn;
        if (!drawn) return;
        const { map, range } = drawn, { unit, factor } = shown(state.shade === "force" ? "N" : "m", state.units);
        choose(shade, SHADES, state.shade);
        write(tilt, `Workspace at θ = ${fixed(shown("rad", state.units).factor * map.theta, 2)}${state.units === "mm" ? "°" : " rad"}`);
        scale.hidden = state.shade === "status";
        write(least, fixed(range[0] * factor, factor === 1 && unit === "m" ? 3 : 0));
        write(most, `${fixed(range[1] * factor, factor === 1 && unit === "m" ? 3 : 0)} ${unit}`);
        const there = new Set(map.status);
        const names = Object.entries(STATES).filter(([status]) => there.has(Number(status)) && !(Number(status) === POSSIBLE && state.shade !== "status"));
        const text = names.map(([, [name]]) => name).join();
        if (list.dataset.names === text) return;
        list.dataset.names = text;
        list.replaceChildren(...names.map(([, [name, [r, g, b]]]) => {
            const dot = make("span", { className: "dot" });
            dot.style.background = `rgb(${r} ${g} ${b})`;
            return make("li", {}, dot, name);
        }));
    });
}

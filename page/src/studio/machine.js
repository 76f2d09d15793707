// The machine at the pose that is chosen on the map: a drawing in lines, seen as the page in 3D sees it.

/** @typedef {import("./state.js").State} State */
/** @typedef {[number, number, number]} Point [m] */

const COLOURS = ["#0072b2", "#d55e00", "#009e73"];
/** From the machine to the eye. */
const EYE = [0.85, -0.45, 0.36];
const AHEAD = Math.hypot(EYE[0], EYE[1]), LONG = Math.hypot(...EYE);
/** Of the beams at the top and bottom of the frame beyond the travel, and half of a slider [m in a machine of 1 m]. */
const BEYOND = 0.12, SLIDER = 0.035;

/** Where a point is on the paper, across and down [m]. @param {Point} point @returns {[number, number]} */
const seen = ([x, y, z]) => [
    (-EYE[1] * x + EYE[0] * y) / AHEAD,
    -(AHEAD * z - (EYE[2] * (EYE[0] * x + EYE[1] * y)) / AHEAD) / LONG,
];

/**
 * Sliders, corners of the platform and P at a pose, in the fixed frame; the platform is where the sliders are in the
 * middle of their travel, since a map over y and θ leaves z open.
 * @param {State["studio"]["machine"]} machine @param {number} y [m] @param {number} theta [rad]
 * @returns {{ sliders: Point[], corners: Point[], P: Point, z: number }} NaN where a leg is too short
 */
export function placed({ r, R, L, travel }, y, theta) {
    const depth = Math.sqrt(L ** 2 - (R - r) ** 2);
    /** @type {Point[]} */
    const corners = [[0, y - r, 0], [0, y + r, 0], [-r * Math.cos(theta), y, r * Math.sin(theta)]];
    /** @type {[number, number][]} */
    const feet = [[0, -R], [0, R], [-R, 0]];
    const above = corners.map(([x, at, z], k) => z + Math.sqrt(L ** 2 - (x - feet[k][0]) ** 2 - (at - feet[k][1]) ** 2));
    const down = (travel[0] + travel[1] - Math.max(...above) - Math.min(...above)) / 2;
    return {
        sliders: above.map((z, k) => [...feet[k], z + down]),
        corners: corners.map(([x, at, z]) => [x, at, z + down]),
        P: [0, y, down], z: down + depth,
    };
}

/** @param {string} name @param {Record<string, string | number>} attributes @param {string} [text] */
function drawn(name, attributes, text = "") {
    const element = document.createElementNS("http://www.w3.org/2000/svg", name);
    for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, String(value));
    element.textContent = text;
    return element;
}

/** @param {SVGSVGElement} element @param {State} state */
export function mountMachine(element, state) {
    const { machine, map } = state.studio, { R, L, b, travel } = machine, size = R + L;
    const ends = [travel[0] - BEYOND * size, travel[1] + BEYOND * size];
    /** @type {[number, number][]} */
    const feet = [[0, -R], [0, R], [-R, 0]];
    const corners = feet.flatMap(([x, y]) => [ends[1], (travel[0] + travel[1]) / 2 - L].map((z) => seen([x, y, z])));
    const [xs, ys] = [0, 1].map((k) => corners.map((point) => point[k]));
    const room = 0.1 * size, low = [Math.min(...xs) - room, Math.min(...ys) - room];
    const span = [Math.max(...xs) + room - low[0], Math.max(...ys) + room - low[1]];
    const scale = 300 / span[1];
    element.setAttribute("viewBox", `0 0 ${span[0] * scale} 300`);
    /** @param {Point} point */
    const on = (point) => seen(point).map((at, k) => ((at - low[k]) * scale).toFixed(2));
    /** @param {Point[]} points */
    const path = (points) => points.map((point) => on(point).join()).join(" ");
    /** @type {Point[]} */
    const top = feet.map(([x, y]) => [x, y, ends[1]]);
    const frame = [
        ...feet.map(([x, y]) => drawn("polyline", { class: "frame", points: path([[x, y, ends[0]], [x, y, ends[1]]]) })),
        drawn("polyline", { class: "frame", points: path([top[0], top[1]]) }),
        drawn("polyline", { class: "frame", points: path([top[2], [0, 0, ends[1]]]) }),
        ...top.map((point, k) => {
            const [x, y] = on([point[0], point[1], point[2] + 0.04 * size]);
            return drawn("text", { x, y, "text-anchor": "middle", style: `fill: ${COLOURS[k]}; font-weight: 600` }, "ABC"[k]);
        }),
    ];
    const draw = () => {
        const { i, j } = state.place, theta = (map.theta[j] * Math.PI) / 180;
        const { sliders, corners, P, z } = placed(machine, map.y[i], theta);
        const told = `${state.where(i, j).y}, ${state.where(i, j).theta}`;
        if (!Number.isFinite(z)) {
            element.replaceChildren(...frame, drawn("text", { x: 8, y: 292 }, `out of reach at ${told}`));
            element.ariaLabel = `The machine does not reach ${told}`;
            return;
        }
        const half = SLIDER * size;
        const legs = sliders.flatMap((slider, k) => (k === 2 ? [-b, b] : [0]).map((off) => drawn("polyline", {
            class: "leg", stroke: COLOURS[k], "data-slider": slider[2],
            points: path([[slider[0], slider[1] + off, slider[2]], [corners[k][0], corners[k][1] + off, corners[k][2]]]),
        })));
        const boxes = sliders.map(([x, y, z], k) => drawn("polyline", {
            stroke: COLOURS[k], "stroke-width": 12, points: path([[x, y, z - half], [x, y, z + half]]),
        }));
        const [x, y] = on(P), [cx, cy, cz] = sliders[2];
        boxes.push(drawn("polyline", { stroke: COLOURS[2], "stroke-width": 4, points: path([[cx, cy - b, cz], [cx, cy + b, cz]]) }));
        element.replaceChildren(...frame, ...boxes, ...legs, drawn("polygon", { class: "platform", points: path(corners) }),
            drawn("circle", { class: "P", cx: x, cy: y, r: 5 }), drawn("text", { x: 8, y: 292 }, told));
        element.ariaLabel = `The machine at ${told}, its sliders in the middle of their travel`;
        element.dataset.z = String(z);
    };
    state.watch((change) => (change === "place" || change === "units") && draw());
    draw();
}

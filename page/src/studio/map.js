// The map of one index over y and θ, with loci, limits and the path on top; and slices through it.
import { colour, middle, range, shown } from "./state.js";
import { echarts } from "./charts.js";

/** @typedef {import("./state.js").State} State */

/** Viridis: even steps for every eye, and in grey. */
export const COLOURS = ["#440154", "#472d7b", "#3b528b", "#2c728e", "#21918c", "#28ae80", "#5ec962", "#addc30", "#fde725"];
const MARKS = "#d55e00", PATH = "#e6007e";

/** A colour of the scale, mostly that of the paper. @param {number} share @param {string} paper as rgb(...) */
function pale(share, paper) {
    const at = Math.min(1, Math.max(0, share)) * (COLOURS.length - 1), k = Math.min(Math.floor(at), COLOURS.length - 2);
    const under = (paper.match(/[\d.]+/g) ?? ["255", "255", "255"]).slice(0, 3).map(Number);
    const mixed = under.map((low, channel) => {
        const [one, next] = [k, k + 1].map((n) => parseInt(COLOURS[n].slice(1 + 2 * channel, 3 + 2 * channel), 16));
        return Math.round(0.7 * low + 0.3 * (one + (at - k) * (next - one)));
    });
    return `rgb(${mixed.join()})`;
}

/** Ends of an axis of cells. @param {number[]} values @returns {[number, number]} */
function ends(values) {
    const half = values.length > 1 ? (values[1] - values[0]) / 2 : 0.5;
    return [values[0] - half, values[values.length - 1] + half];
}

/** @param {HTMLElement} element @param {State} state */
export function mountMap(element, state) {
    const chart = echarts.init(element);
    const { map, loci, limits, path } = state.studio;
    const height = map.indices.findIndex(({ name }) => name === "height");
    const lines = ["across", "up"].map((name) => Object.assign(document.createElement("div"), { className: `line ${name}` }));
    element.append(...lines);

    /** Where it is, the chosen index and the free height: four rows at most; the table has all. @param {number} i @param {number} j */
    const told = (i, j) => {
        const { y, theta } = state.where(i, j);
        const rows = [...new Set([state.index, height])].filter((k) => k >= 0).map((k) =>
            `${state.named(map.indices[k])}: ${state.told(map.indices[k], state.at(k, i, j))}`);
        const inside = map.inside[j * map.y.length + i] ? [] : ["outside of the limits"];
        return [`${y}, ${theta}`, `<b>${rows[0]}</b>`, ...rows.slice(1), ...inside].join("<br>");
    };

    /** Lines at the pose that is chosen: over the map, which is not drawn anew. */
    const mark = () => {
        const { left, top, width, height: up } = grid(), { i, j } = state.place;
        const [x, y] = [left + ((i + 0.5) * width) / map.y.length, top + up - ((j + 0.5) * up) / map.theta.length];
        lines[0].style.cssText = `left: ${left}px; top: ${y - 0.5}px; width: ${width}px; height: 1px`;
        lines[1].style.cssText = `left: ${x - 0.5}px; top: ${top}px; width: 1px; height: ${up}px`;
    };

    /** Whole pixels for each cell: no seams between them. */
    const grid = () => {
        const across = Math.max(1, Math.floor((element.clientWidth - 145) / map.y.length)) * map.y.length;
        const up = Math.max(1, Math.floor((element.clientHeight - 55) / map.theta.length)) * map.theta.length;
        return { left: 55, top: 10, width: across, height: up };
    };

    const draw = () => {
        const index = map.indices[state.index], units = state.poseUnits;
        const [low, high] = middle(index.values);
        const [left, right] = ends(map.y.map((y) => y * units.y.factor));
        const [bottom, top] = ends(map.theta.map((theta) => theta * units.theta.factor));
        /** @param {[number | null, number | null]} point */
        const scaled = ([y, theta]) => [y === null ? null : y * units.y.factor, theta === null ? null : theta * units.theta.factor];
        const ink = colour("ink"), faint = colour("faint"), paper = colour("paper");
        const cells = [];
        for (let j = 0; j < map.theta.length; j++) {
            for (let i = 0; i < map.y.length; i++) {
                const value = state.at(state.index, i, j);
                if (value === null) continue;
                if (map.inside[j * map.y.length + i]) cells.push([i, j, value]);
                else cells.push({ value: [i, j, value], visualMap: false, itemStyle: { color: pale((value - low) / (high - low), paper) } });
            }
        }
        const overlay = { xAxisIndex: 1, yAxisIndex: 1, type: "line", symbol: "none", silent: true, animation: false, clip: true };
        const series = [
            { type: "heatmap", data: cells, animation: false, progressive: 0, emphasis: { disabled: true } },
            ...loci.map(({ name, points }) => ({
                ...overlay, name, data: points.map(scaled), z: 5,
                lineStyle: { color: name.startsWith("actuation") ? MARKS : ink, width: 2, type: name.startsWith("actuation") ? "solid" : "dashed" },
            })),
            ...limits.tilt.map((tilt) => ({
                ...overlay, data: [left, right].map((at) => [at, tilt * units.theta.factor]), z: 4, lineStyle: { color: ink, width: 1, type: "dotted" },
            })),
            ...(path ? [{ ...overlay, name: "path", data: path.points.map(scaled), z: 6, lineStyle: { color: PATH, width: 3 } }] : []),
        ];
        const name = { nameTextStyle: { color: faint }, nameLocation: "middle" };
        const own = { axisLine: { show: false }, axisTick: { show: false }, axisLabel: { color: faint, hideOverlap: true }, splitLine: { show: false } };
        chart.setOption({
            textStyle: { color: ink },
            hoverLayerThreshold: Infinity,
            grid: grid(),
            xAxis: [
                { type: "category", data: map.y, show: false },
                { type: "value", min: left, max: right, position: "bottom", name: `y [${units.y.unit}]`, nameGap: 26, ...name, ...own, axisLabel: { ...own.axisLabel, showMinLabel: false, showMaxLabel: false } },
            ],
            yAxis: [
                { type: "category", data: map.theta, show: false },
                { type: "value", min: bottom, max: top, position: "left", name: `θ [${units.theta.unit}]`, nameGap: 34, ...name, ...own, axisLabel: { ...own.axisLabel, showMinLabel: false, showMaxLabel: false } },
            ],
            visualMap: {
                type: "continuous", hoverLink: false, seriesIndex: 0, // else every move of the mouse would draw the map anew
                min: low, max: high, inRange: { color: COLOURS }, left: grid().left + grid().width + 16, top: "middle",
                itemHeight: 260, itemWidth: 14, text: [state.told(index, high), state.told(index, low)], precision: 3, textStyle: { color: ink },
            },
            tooltip: {
                trigger: "item", backgroundColor: paper, borderColor: faint, textStyle: { color: ink, fontSize: 12 }, confine: true,
                formatter: (/** @type {any} */ at) => told(at.value[0], at.value[1]),
            },
            series,
        }, { notMerge: true });
        element.ariaLabel = `${state.named(index)} over y and θ, from ${state.told(index, low)} to ${state.told(index, high)}`;
        mark();
    };

    chart.getZr().on("click", (/** @type {any} */ event) => {
        const point = [event.offsetX, event.offsetY];
        if (!chart.containPixel({ gridIndex: 0 }, point)) return;
        const [i, j] = /** @type {number[]} */ (chart.convertFromPixel({ xAxisIndex: 0, yAxisIndex: 0 }, point));
        state.choosePlace(i, j);
    });
    element.addEventListener("keydown", (event) => {
        const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowDown: [0, -1], ArrowUp: [0, 1] }[event.key];
        if (!step) return;
        event.preventDefault();
        const [i, j] = [state.place.i + step[0], state.place.j + step[1]];
        if (i >= 0 && j >= 0 && i < map.y.length && j < map.theta.length) state.choosePlace(i, j);
    });
    state.watch((change) => {
        if (change === "index" || change === "units") draw();
        else if (change === "place") mark();
    });
    draw();
    return { chart, draw, fit: () => (chart.resize(), draw()) };
}

/** Slices along y and along θ, where the map is marked. @param {HTMLElement} element @param {State} state @param {"y" | "theta"} along */
export function mountSlice(element, state, along) {
    const chart = echarts.init(element);
    const { map } = state.studio;
    const places = map[along];

    const draw = () => {
        const index = map.indices[state.index], { i, j } = state.place;
        const { unit, factor } = state.poseUnits[along], value = state.told.bind(state, index);
        const ink = colour("ink"), faint = colour("faint"), line = colour("line"), accent = colour("accent");
        const data = places.map((place, k) => [place * factor, along === "y" ? state.at(state.index, k, j) : state.at(state.index, i, k)]);
        const [low, high] = range(data.map(([, value]) => value));
        const room = 0.06 * (high - low);
        const where = `at ${along === "y" ? state.where(i, j).theta : state.where(i, j).y}`;
        const axis = { axisLine: { onZero: false, lineStyle: { color: faint } }, axisTick: { show: false }, axisLabel: { color: faint, hideOverlap: true }, nameTextStyle: { color: faint }, nameLocation: "middle", splitLine: { lineStyle: { color: line } } };
        chart.setOption({
            textStyle: { color: ink },
            title: { text: `${state.named(index)} ${where}`, textStyle: { color: ink, fontSize: 12, fontWeight: "normal" }, left: 50, top: 0 },
            grid: { left: 55, right: 15, top: 26, bottom: 40 },
            xAxis: { type: "value", min: "dataMin", max: "dataMax", name: `${along === "y" ? "y" : "θ"} [${unit}]`, nameGap: 24, ...axis, splitLine: { show: false }, axisLabel: { ...axis.axisLabel, showMinLabel: false, showMaxLabel: false } },
            yAxis: { type: "value", min: Math.min(low - room, low), max: high + room, ...axis, axisLabel: { ...axis.axisLabel, showMinLabel: false, showMaxLabel: false, formatter: value } },
            tooltip: { trigger: "axis", backgroundColor: colour("paper"), borderColor: faint, textStyle: { color: ink, fontSize: 12 }, valueFormatter: (/** @type {any} */ v) => value(v) },
            series: [{
                name: state.named(index), type: "line", symbol: "none", data, animation: false, lineStyle: { color: accent, width: 2 }, itemStyle: { color: accent },
                markLine: { symbol: "none", silent: true, animation: false, label: { show: false }, lineStyle: { color: ink, type: "solid", width: 1 }, data: [{ xAxis: factor * (along === "y" ? map.y[i] : map.theta[j]) }] },
            }],
        }, { notMerge: true });
        element.ariaLabel = `${state.named(index)} along ${along === "y" ? "y" : "θ"} ${where}`;
    };

    state.watch((change) => {
        if (change === "index" || change === "place" || change === "units") draw();
    });
    draw();
    return { chart, draw };
}

// Designs as points of two columns and as lines through all of them; what is selected in one is so in the other.
import { colour, range, shown } from "./state.js";
import { echarts } from "./charts.js";
import { shown as inUnits } from "../units.js";

/** @typedef {import("./state.js").State} State */

const START = "#d55e00";

/** What is good, in words. @param {import("./state.js").Column} column */
const good = (column) => (column.better ? ` (${column.better} is good)` : "");

/** @param {HTMLElement} element @param {State} state */
export function mountFront(element, state) {
    const chart = echarts.init(element);
    const { columns, start } = /** @type {NonNullable<import("./state.js").Studio["designs"]>} */ (state.studio.designs);
    let drawn = "";

    const draw = () => {
        const ink = colour("ink"), faint = colour("faint"), line = colour("line"), accent = colour("accent");
        const [x, y] = state.axes.map((k) => columns[k]);
        /** @param {number} row */
        const look = (row) => ({
            color: row === start ? START : accent,
            opacity: state.selected.has(row) ? 0.9 : 0.12,
            borderColor: ink,
            borderWidth: row === state.design ? 2 : 0,
        });
        /** @param {import("./state.js").Column} column @param {number} row */
        const at = ({ unit, values }, row) => (values[row] === null ? null : /** @type {number} */ (values[row]) * inUnits(unit, state.units).factor);
        const data = x.values.map((_, row) => ({
            value: [at(x, row), at(y, row), row], itemStyle: look(row), symbol: row === start ? "diamond" : "circle", symbolSize: row === start ? 14 : row === state.design ? 12 : 8,
        }));
        const axis = { type: "value", scale: true, axisLabel: { color: faint, hideOverlap: true }, nameTextStyle: { color: faint }, nameLocation: "middle", splitLine: { lineStyle: { color: line } } };
        const option = {
            textStyle: { color: ink },
            grid: { left: 65, right: 15, top: 15, bottom: 50 },
            xAxis: { ...axis, name: state.named(x) + good(x), nameGap: 28 },
            yAxis: { ...axis, name: state.named(y) + good(y), nameGap: 44 },
            tooltip: {
                backgroundColor: colour("paper"), borderColor: faint, textStyle: { color: ink, fontSize: 12 }, confine: true,
                formatter: (/** @type {any} */ { value }) => `design ${value[2] + 1}${value[2] === start ? " (the start)" : ""}<br>${[x, y].map((column) => `${state.named(column)}: ${state.told(column, column.values[value[2]])}`).join("<br>")}`,
            },
            brush: { xAxisIndex: 0, brushType: "rect", brushMode: "single", transformable: false, throttleType: "debounce", throttleDelay: 60, outOfBrush: { colorAlpha: 1 }, brushStyle: { color: "rgba(120,140,160,.12)", borderColor: faint } },
            series: [{ type: "scatter", data, animation: false }],
        };
        const asked = [...state.axes, state.units].join();
        if (asked === drawn) chart.setOption({ series: option.series });
        else {
            chart.setOption(option, { notMerge: true });
            chart.dispatchAction({ type: "takeGlobalCursor", key: "brush", brushOption: { brushType: "rect", brushMode: "single" } });
        }
        drawn = asked;
        element.ariaLabel = `Designs: ${state.named(y)} over ${state.named(x)}, ${state.selected.size} of ${state.count} selected`;
    };

    chart.on("brushEnd", (/** @type {any} */ event) => {
        const area = event.areas[0]?.coordRange;
        if (!area) return;
        const [x, y] = state.axes.map((k) => columns[k].values);
        const inside = state.axes.map((k, which) => {
            const { factor } = inUnits(columns[k].unit, state.units), [low, high] = area[which];
            return (/** @type {number | null} */ value) => value !== null && value * factor >= low && value * factor <= high;
        });
        const rows = [...x.keys()].filter((row) => inside[0](x[row]) && inside[1](y[row]));
        chart.dispatchAction({ type: "brush", areas: [] });
        if (rows.length) state.select(rows);
    });
    chart.on("click", (/** @type {any} */ event) => state.look(event.value[2]));
    state.watch((change) => {
        if (change === "selection" || change === "axes" || change === "units") draw();
    });
    draw();
    return { chart, draw: () => { drawn = ""; draw(); } };
}

/** @param {HTMLElement} element @param {State} state */
export function mountParallel(element, state) {
    const chart = echarts.init(element);
    const { columns, start } = /** @type {NonNullable<import("./state.js").Studio["designs"]>} */ (state.studio.designs);
    let drawn = false;

    const draw = () => {
        const ink = colour("ink"), faint = colour("faint"), accent = colour("accent");
        const marked = [...new Set([state.design, start])].filter((row) => row !== null); // on top of the others
        const rows = Array.from({ length: state.count }, (_, row) => row).filter((row) => !marked.includes(row));
        const data = [...rows, ...marked].map((row) => ({
            value: columns.map(({ unit, values }) => (values[row] ?? NaN) * inUnits(unit, state.units).factor),
            lineStyle: {
                color: row === start ? START : row === state.design ? ink : accent,
                width: row === start || row === state.design ? 2.5 : 1,
                opacity: row === state.design || row === start ? 1 : state.selected.has(row) ? Math.min(0.6, Math.max(0.15, 40 / state.selected.size)) : 0.04,
            },
        }));
        const option = {
            textStyle: { color: ink },
            parallel: { left: 45, right: 45, top: 52, bottom: 22, axisExpandable: false, parallelAxisDefault: { realtime: false } },
            parallelAxis: columns.map((column, dim) => {
                const [min, max] = range(column.values).map((end) => end * inUnits(column.unit, state.units).factor);
                const text = state.named(column).replace(/^(\w+) (?!\[)/, "$1\n").replace(" [", "\n[");
                return {
                    dim, min, max, inverse: column.better === "large", name: text, nameLocation: column.better === "large" ? "start" : "end", nameGap: 10,
                    nameTextStyle: { color: column.better ? ink : faint, fontSize: 11, lineHeight: 12 },
                    axisLine: { lineStyle: { color: faint } }, axisTick: { lineStyle: { color: faint } },
                    axisLabel: { color: faint, fontSize: 10, showMinLabel: false, showMaxLabel: false, formatter: (/** @type {number} */ v) => shown(v) },
                    areaSelectStyle: { width: 16, color: accent, opacity: 0.25 },
                };
            }),
            series: [{ type: "parallel", data, animation: false, activeOpacity: Math.min(0.6, Math.max(0.15, 40 / state.selected.size)), inactiveOpacity: 0.04,  progressive: 0 }],
        };
        chart.setOption(drawn ? { series: option.series } : option);
        drawn = true;
        element.ariaLabel = `Designs as lines through ${columns.length} columns; good is down`;
    };

    chart.on("axisareaselected", () => {
        const option = /** @type {any} */ (chart.getOption());
        const rows = Array.from({ length: state.count }, (_, row) => row).filter((row) => option.parallelAxis.every((/** @type {any} */ axis, /** @type {number} */ k) => {
            // areas are where they are on the axis; what is not wanted of an axis without any
            const model = /** @type {any} */ (chart).getModel().getComponent("parallelAxis", k);
            const areas = model.activeIntervals ?? [];
            const stored = columns[k].values[row], value = stored === null ? null : stored * inUnits(columns[k].unit, state.units).factor;
            return !areas.length || (value !== null && areas.some((/** @type {[number, number]} */ [low, high]) => value >= low && value <= high));
        }));
        state.select(rows);
    });
    state.watch((change) => {
        if (change === "units") anew();
        else if (change === "selection") draw();
    });
    const anew = () => { drawn = false; chart.clear(); draw(); };
    draw();
    return {
        chart,
        draw: anew,
        /** Take the areas of all axes away. */
        clear: () => columns.forEach((_, k) => chart.dispatchAction({ type: "axisAreaSelect", parallelAxisId: /** @type {any} */ (chart).getModel().getComponent("parallelAxis", k).id, intervals: [] })),
    };
}

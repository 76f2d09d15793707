// The page as a picture: only the machine, with a line that says what and when. Python takes pictures and films so.
import { instant } from "./instant.js";
import { shown } from "./units.js";

/** @typedef {import("./types").State} State */

/**
 * Show only the machine from now on.
 * @param {State} state
 * @returns {Promise<void>} when it is drawn so
 */
export async function picture(state) {
    document.documentElement.dataset.picture = "";
    const line = document.createElement("p");
    line.className = "caption";
    document.getElementById("stage")?.append(line);
    const say = () => {
        line.textContent = caption(state);
    };
    state.subscribe(say);
    say();
    await frame(); // the stage has its new size then
    state.stage?.contents.handles?.group.removeFromParent(); // nobody drags a picture
    state.stage?.resize();
    await frame();
}

const frame = () => new Promise((resolve) => requestAnimationFrame(resolve));

/** What is seen: title, instant, and the loads of the actuators. @param {State} state */
export function caption(state) {
    const { document, units } = state;
    const { time, run, values } = instant(state);
    const parts = [document.title];
    if (run.time.data.length > 1) parts.push(`t = ${time.toFixed(3)} s`);
    for (const load of run.loads) {
        if (load.group !== "actuator" || !load.curve || !Number.isFinite(values[load.curve])) continue;
        const curve = run.curves.find(({ key }) => key === load.curve);
        const { unit, factor } = shown(load.unit, units);
        parts.push(`${curve?.label ?? load.label} ${(values[load.curve] * factor).toPrecision(4)} ${unit}`);
        if (parts.length > 5) break;
    }
    return parts.join("   ");
}

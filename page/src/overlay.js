// What lies over the 3D picture: standard views, the tilt where its ring is edge-on, and what went wrong.
import { hold, letGo } from "./hold.js";
import { instant } from "./instant.js";
import { viewed } from "./state.js";
import { fixed, shown } from "./units.js";

/** @typedef {import("./types").State} State */

/** @type {[Exclude<import("./types").View, "free">, string][]} */
const VIEWS = [["3d", "3D"], ["front", "Front"], ["side", "Side"], ["top", "Top"]];

/** @param {HTMLElement} element @param {State} state @param {import("./scene.js").Stage | null} stage */
export function mountOverlay(element, state, stage) {
    if (stage) {
        views(element, state, stage);
        lost(element, stage);
    } else {
        note(element, "This browser does not draw in 3D (no WebGL). Charts, numbers, sliders and files work all the same.");
    }
    told(element, state);
    if (stage?.contents.handles) tilt(element, state, stage);
}

/** @param {HTMLElement} element @param {State} state @param {import("./scene.js").Stage} stage */
function views(element, state, stage) {
    const bar = made(element, "div", "views");
    bar.setAttribute("role", "toolbar");
    bar.setAttribute("aria-label", "Views");
    for (const [view, label] of VIEWS) {
        const button = made(bar, "button", "", label);
        button.dataset.view = view;
        button.addEventListener("click", () => {
            state.set(viewed(state, view));
            stage.touched = false;
        });
        state.subscribe(() => button.setAttribute("aria-pressed", String(state.view === view)));
    }
    const fit = made(bar, "button", "", "Fit");
    fit.title = "See all of it";
    fit.addEventListener("click", () => stage.look());
}

/** @param {HTMLElement} element @param {import("./scene.js").Stage} stage */
function lost(element, stage) {
    const line = note(element, "The 3D picture was lost by the graphics driver; everything else works. It comes back by itself, or when the page is loaded again.");
    line.hidden = true;
    stage.canvas.addEventListener("webglcontextlost", () => void (line.hidden = false));
    stage.canvas.addEventListener("webglcontextrestored", () => void (line.hidden = true));
}

/** Why the platform did not follow, and the way back to the run. @param {HTMLElement} element @param {State} state */
function told(element, state) {
    const line = made(element, "p", "refused");
    const back = made(element, "button", "back", "Back to the run");
    back.addEventListener("click", () => letGo(state));
    state.subscribe(() => {
        line.textContent = state.refused?.text ?? "";
        line.hidden = !state.refused;
        back.hidden = !state.hand;
    });
}

/** A bar for the tilt, where its ring is seen from the side. @param {HTMLElement} element @param {State} state @param {import("./scene.js").Stage} stage */
function tilt(element, state, stage) {
    const input = state.document.inputs.find(({ key }) => key === "theta");
    const [low, high] = input ? [input.low, input.high] : [-Math.PI / 4, Math.PI / 4];
    const label = made(element, "label", "tilt");
    const words = made(label, "span");
    const bar = made(label, "input");
    Object.assign(bar, { type: "range", min: String(low), max: String(high), step: "any" });
    bar.setAttribute("aria-label", "Tilt of the platform");
    bar.addEventListener("input", () => {
        const pose = instant(state).pose;
        if (pose) hold(state, [pose[0], pose[1], Number(bar.value)]);
    });
    bar.addEventListener("keydown", (event) => { // they move the bar, not the time
        if (/^(Arrow|Page|Home|End)/.test(event.key)) event.stopPropagation();
    });
    stage.drawn.add(() => {
        const hidden = !stage.contents.handles?.edgeOn || !state.engine;
        if (label.hidden !== hidden) label.hidden = hidden;
        const theta = instant(state).pose?.[2];
        if (hidden || theta === undefined) return;
        if (Number(bar.value) !== theta) bar.value = String(theta);
        const { unit, factor } = shown("rad", state.units);
        const text = `θ ${fixed(theta * factor, factor === 1 ? 3 : 1)}${unit === "°" ? unit : ` ${unit}`}`;
        bar.setAttribute("aria-valuetext", text);
        if (words.textContent !== text) words.textContent = text;
    });
}

/** @param {HTMLElement} element @param {string} text */
function note(element, text) {
    const line = made(element, "p", "stage-note", text);
    line.setAttribute("role", "status");
    return line;
}

/**
 * Add an element.
 * @template {keyof HTMLElementTagNameMap} Name
 * @param {HTMLElement} parent @param {Name} name @param {string} [kind] class @param {string} [text]
 * @returns {HTMLElementTagNameMap[Name]}
 */
function made(parent, name, kind = "", text = "") {
    const found = document.createElement(name);
    if (kind) found.className = kind;
    if (text) found.textContent = text;
    parent.append(found);
    return found;
}

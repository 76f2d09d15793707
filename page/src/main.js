// Reads the document in the page, makes the state, and mounts all parts.
import * as cases from "./cases.js";
import * as charts from "./charts.js";
import * as clock from "./clock.js";
import * as connection from "./connection.js";
import { read } from "./document.js";
import * as downloads from "./downloads.js";
import * as engine from "./engine.js";
import * as guest from "./guest.js";
import { instant } from "./instant.js";
import * as keys from "./keys.js";
import * as links from "./links.js";
import * as map from "./map.js";
import * as markers from "./markers.js";
import * as panel from "./panel.js";
import { picture } from "./picture.js";
import * as planning from "./planning.js";
import * as print from "./print.js";
import * as robot_panel from "./robot_panel.js";
import * as room from "./room.js";
import * as runs from "./runs.js";
import * as scene from "./scene.js";
import * as solving from "./solving.js";
import * as spoken from "./spoken.js";
import { createState, within } from "./state.js";
import * as table from "./table.js";
import * as themes from "./themes.js";
import * as time_bar from "./time_bar.js";
import * as views from "./views.js";
import * as waypoints from "./waypoints.js";
import * as what_if from "./what_if.js";

/** @typedef {(element: HTMLElement, state: import("./types").State) => void} Mount */
/** @type {[string, string, Mount][]} what it is, where it goes, what puts it there */
const PARTS = [
    ["colours", "page", themes.mount],
    ["3D picture", "stage", scene.mount],
    ["workspace map", "stage", map.mount],
    ["waypoints in 3D", "stage", markers.mount],
    ["guests", "stage", guest.mount],
    ["time bar", "time-bar", time_bar.mount],
    ["charts", "charts", charts.mount],
    ["connection", "connection", connection.mount],
    ["settings", "settings", panel.settings],
    ["list of runs", "runs", runs.mount],
    ["table", "table", table.mount],
    ["pose", "pose", panel.mount],
    ["room to move", "room", room.mount],
    ["static and dynamic part", "cases", cases.mount],
    ["what-if", "what-if", what_if.mount],
    ["what-if of a robot", "what-if", robot_panel.mount],
    ["waypoints", "waypoints", waypoints.mount],
    ["layers", "layers", views.mount],
    ["downloads", "downloads", downloads.mount],
    ["keys", "page", keys.mount],
    ["links", "page", links.mount],
    ["spoken text", "page", spoken.mount],
    ["printed page", "print", print.mount],
];

/** @param {string} id */
const element = (id) => /** @type {HTMLElement} */ (document.getElementById(id));

/** Say on the page that something does not work. @param {HTMLElement} where @param {string} text */
function say(where, text) {
    const line = document.createElement("p");
    line.className = "failed";
    line.textContent = text;
    where.append(line);
}

async function start() {
    const shown = read(element("p3dof-document").textContent ?? "");
    const state = createState(shown);
    window.document.title = shown.title;
    const title = window.document.createElement("h1");
    title.textContent = shown.title;
    element("heading").append(title);
    const page = Object.assign(window.p3dof, {
        state,
        instant: () => instant(state),
        seek: (/** @type {number} */ time) => {
            state.set({ time: within(state, time), playing: false, hand: null });
            state.refresh();
            state.stage?.refine();
        },
        picture: () => picture(state),
    });
    try {
        state.engine = await engine.load(shown, element("p3dof-wasm").textContent?.trim() ?? "", state);
    } catch (error) {
        console.warn(error);
        say(element("heading"), `The forces cannot be computed in this page: ${message(error)}. What is stored is shown.`);
    }
    planning.mount(state);
    solving.mount(state); // first: all others show what these compute
    map.follow(state);
    for (const [name, id, mount] of PARTS) {
        try {
            mount(element(id), state);
        } catch (error) {
            console.warn(error);
            say(element(id), `The ${name} cannot be shown: ${message(error)}`);
        }
    }
    clock.mount(state);
    state.set({ document: shown });
    state.refresh();
    if (window.parent !== window) window.parent.postMessage({ p3dofReady: true }, "*"); // it may send links now
    return page;
}

/** @param {unknown} error */
const message = (error) => (error instanceof Error ? error.message : String(error));

/** @type {any} */ (window).p3dof = {};
window.p3dof.ready = start().catch((error) => {
    const fault = element("fault");
    fault.textContent = `This page cannot show its document: ${message(error)}`;
    fault.hidden = false;
    throw error;
});
window.p3dof.ready.catch(() => undefined); // it was said

// Waypoints, and the motion through them: in a given time, or the fastest within limits.
import { motionCsv } from "./csv.js";
import { instant } from "./instant.js";
import { choose, make, write } from "./make.js";
import { PROFILES, TaskError } from "./paths.js";
import { ANY_PACE, NO_TASK } from "./plan.js";
import { durationsTo, easyDuration, wrongPace, wrongWaits } from "./planning.js";
import { peaksOf, runOfMotion } from "./resolve.js";
import { save } from "./save.js";
import { engineOf, isChanged, solidsOf } from "./solving.js";
import { leftOut, readFile, readMotion, writeTask } from "./task_files.js";
import { fixed, shown } from "./units.js";

/** @typedef {import("./types").State} State */
/** @typedef {import("./paths.js").Waypoint} Waypoint */

const AXES = ["y", "z", "θ"], UNITS = ["m", "m", "rad"];
/** How far before and after a waypoint that is passed the path leaves its lines at first [m]. */
const BLEND = 0.02;

/** @param {State} state @param {Waypoint[]} waypoints */
const setWaypoints = (state, waypoints) => state.set({ task: { ...state.task, waypoints } });

/** @param {State} state @param {number} k @param {Partial<Waypoint>} changes */
const changeWaypoint = (state, k, changes) =>
    setWaypoints(state, state.task.waypoints.map((point, i) => (i === k ? { ...point, ...changes } : point)));

/** Put a waypoint in another place. @param {State} state @param {number} from @param {number} to */
export function moveWaypoint(state, from, to) {
    const points = [...state.task.waypoints];
    if (to < 0 || to >= points.length || from === to) return;
    const [point] = points.splice(from, 1);
    points.splice(to, 0, point);
    setWaypoints(state, points.map((one, k) => (k && k < points.length - 1 ? one : { ...one, blend: 0, duration: k ? one.duration : null })));
}

/** @param {HTMLElement} element @param {State} state */
export function mount(element, state) {
    if (!engineOf(state) || !state.document.runs.some(({ pose }) => pose)) return;
    const list = make("ol", { className: "waypoints", "aria-label": "Waypoints" });
    /** @type {Row[]} */
    let rows = [];
    const hint = make("p", { className: "note" });
    const heads = AXES.map(() => make("span"));
    const head = make("div", { className: "waypoint-heads", "aria-hidden": "true" }, ...heads);
    const parts = [adding(state), settings(state), result(state), files(state)];
    element.append(make("h2", {}, "Waypoints"), hint, head, list, ...parts.map(({ part }) => part));
    state.subscribe(() => {
        const { waypoints } = state.task;
        if (rows.length !== waypoints.length) {
            rows = waypoints.map((_, k) => rows[k] ?? new Row(state, list, k));
            list.replaceChildren(...rows.map(({ item }) => item));
        }
        rows.forEach((row, k) => row.show(waypoints[k], waypoints.length));
        write(hint, waypoints.length ? "" : "Drag the platform where it should go and add each pose: the page plans the motion and its forces.");
        hint.hidden = waypoints.length > 0;
        head.hidden = !waypoints.length;
        heads.forEach((span, i) => write(span, `${AXES[i]} [${shown(UNITS[i], state.units).unit}]`));
        parts.forEach((part) => part.show());
    });
}

/** A waypoint in the list. */
class Row {
    /** @param {State} state @param {HTMLElement} list @param {number} k */
    constructor(state, list, k) {
        this.state = state;
        this.k = k;
        this.boxes = AXES.map((axis, i) => {
            const box = make("input", { type: "number", step: "any", "aria-label": `${axis} of waypoint ${k + 1}` });
            box.addEventListener("change", () => {
                if (!Number.isFinite(box.valueAsNumber)) return;
                const pose = [...state.task.waypoints[k].pose];
                pose[i] = box.valueAsNumber / shown(UNITS[i], state.units).factor;
                changeWaypoint(state, k, { pose });
            });
            return box;
        });
        const remove = make("button", { type: "button", title: "Delete", "aria-label": `Delete waypoint ${k + 1}` }, "×");
        remove.addEventListener("click", () => removed(state, k));
        const grip = make("button", { type: "button", className: "grip", title: "Drag to another place, or arrow keys", "aria-label": `Move waypoint ${k + 1} by arrow keys` }, "⠿");
        this.kind = make("select", { "aria-label": `What happens at waypoint ${k + 1}` });
        this.kind.addEventListener("change", () => changeWaypoint(state, k, this.kind.value === "pass"
            ? { blend: BLEND, dwell: 0, duration: null } : { blend: 0 }));
        this.what = make("span");
        this.amount = make("input", { type: "number", step: "any", min: "0", "aria-label": `Dwell or blend at waypoint ${k + 1}` });
        this.amount.addEventListener("change", () => this.take());
        this.unit = make("span");
        this.go = make("button", { type: "button", title: "Show the platform here", "aria-label": `Show waypoint ${k + 1}` }, "show");
        this.go.addEventListener("click", () => {
            const { pose } = state.task.waypoints[k];
            if (pose.length === 3) state.set({ hand: { pose }, playing: false });
        });
        this.item = make("li", { className: "waypoint" },
            make("div", { className: "line" }, grip, make("b", {}, String(k + 1)), ...this.boxes, remove),
            make("div", { className: "line" }, this.kind, this.what, this.amount, this.unit, this.go));
        sortable(this.item, grip, list, state, k);
    }

    take() {
        const { state, k, amount } = this, value = amount.valueAsNumber, point = state.task.waypoints[k];
        if (!point.blend) changeWaypoint(state, k, { dwell: value });
        else if (value) changeWaypoint(state, k, { blend: value / shown("m", state.units).factor });
        else state.set({}); // where it is passed there is a blend: the one before is shown again
    }

    /** @param {Waypoint} point @param {number} count */
    show(point, count) {
        const { state, k } = this, end = k === 0 || k === count - 1;
        AXES.forEach((_, i) => {
            const { factor } = shown(UNITS[i], state.units);
            this.boxes[i].disabled = i === 2 && point.pose.length < 3;
            fill(this.boxes[i], point.pose.length > i ? point.pose[i] * factor : NaN);
        });
        choose(this.kind, [["stop", "stop"], .../** @type {[string, string][]} */ (end ? [] : [["pass", "pass"]])], point.blend ? "pass" : "stop");
        write(this.what, point.blend ? "blend" : "dwell");
        write(this.unit, point.blend ? shown("m", state.units).unit : "s");
        markWrong(this.amount, wrongWaits(state.task).some(({ at }) => at === k));
        fill(this.amount, point.blend ? point.blend * shown("m", state.units).factor : point.dwell);
        this.item.title = point.name;
    }
}

/** @param {HTMLInputElement} box @param {number} value */
function fill(box, value) {
    const digits = Math.max(0, Math.min(4, 4 - Math.ceil(Math.log10(Math.abs(value) + 1e-9))));
    const text = Number.isFinite(value) ? String(Number(value.toFixed(digits))) : "";
    if (box !== document.activeElement && box.value !== text) box.value = text;
}

/** Say of a field that what is in it is refused. @param {HTMLInputElement} box @param {boolean} wrong */
function markWrong(box, wrong) {
    if (wrong) box.setAttribute("aria-invalid", "true");
    else box.removeAttribute("aria-invalid");
}

/** @param {State} state @param {number} k */
function removed(state, k) {
    const points = state.task.waypoints.filter((_, i) => i !== k);
    setWaypoints(state, points.map((point, i) => (i && i < points.length - 1 ? point : { ...point, blend: 0, duration: i ? point.duration : null })));
}

/** Lets a row be dragged to another place, or moved by keys. @param {HTMLElement} item @param {HTMLElement} grip @param {HTMLElement} list @param {State} state @param {number} k */
function sortable(item, grip, list, state, k) {
    let over = -1;
    /** @param {number} now */
    const mark = (now) => {
        over = now;
        [...list.children].forEach((row, i) => row.classList.toggle("over", i === now && now !== k));
    };
    grip.addEventListener("pointerdown", (event) => {
        event.preventDefault();
        grip.focus();
        grip.setPointerCapture(event.pointerId);
        item.classList.add("dragged");
        over = k;
    });
    grip.addEventListener("pointermove", (event) => {
        if (over < 0) return;
        const tops = [...list.children].map((row) => row.getBoundingClientRect());
        mark(tops.reduce((best, { top }, i) => (event.clientY >= top ? i : best), 0));
    });
    grip.addEventListener("pointerup", () => {
        const to = over;
        mark(-1);
        item.classList.remove("dragged");
        if (to >= 0) moveWaypoint(state, k, to);
    });
    grip.addEventListener("pointercancel", () => {
        mark(-1);
        item.classList.remove("dragged");
    });
    grip.addEventListener("keydown", (event) => {
        const to = k + (event.key === "ArrowUp" ? -1 : event.key === "ArrowDown" ? 1 : 0);
        if (to === k) return;
        event.preventDefault();
        event.stopPropagation();
        moveWaypoint(state, k, to);
        /** @type {HTMLElement | null | undefined} */ (list.children[to]?.querySelector(".grip"))?.focus();
    });
}

/** How the ways are covered. @param {State} state */
function settings(state) {
    const profile = make("select", { "aria-label": "Profile of each segment" });
    profile.addEventListener("change", () => state.set({ task: { ...state.task, profile: profile.value } }));
    const mode = make("select", { "aria-label": "How long it takes" });
    mode.addEventListener("change", () => state.set({ pace: { ...state.pace, fastest: mode.value === "fastest" } }));
    const total = make("input", { type: "number", step: "0.1", min: "0", "aria-label": "Time in all" });
    total.addEventListener("change", () => state.set({ pace: { ...state.pace, duration: total.valueAsNumber } }));
    const seconds = make("span", {}, total, " s");
    /** @type {[("force" | "speed" | "power"), string, string][]} */
    const kinds = [["force", "Force", "N"], ["speed", "Speed", "m/s"], ["power", "Power", "W"]];
    const boxes = kinds.map(([key, label, unit]) => {
        const box = make("input", { type: "number", step: "any", min: "0", placeholder: "none", "aria-label": `Most ${key} of each actuator` });
        box.addEventListener("change", () => {
            state.set({ pace: { ...state.pace, [key]: box.valueAsNumber / shown(unit, state.units).factor } });
        });
        const name = make("span");
        return { key, label, unit, box, name, row: make("label", { className: "field" }, name, box) };
    });
    const limits = make("details", { open: true }, make("summary", {}, "Limits of each actuator"), ...boxes.map(({ row }) => row));
    const part = make("div", {},
        make("label", { className: "field" }, "Profile ", profile), make("div", { className: "field" }, mode, seconds), limits);
    return {
        part,
        show() {
            const { task, pace } = state;
            part.hidden = task.waypoints.length < 2;
            choose(profile, Object.keys(PROFILES).map((name) => [name, name]), task.profile);
            choose(mode, [["given", "in all in"], ["fastest", "fastest within limits"]], pace.fastest ? "fastest" : "given");
            seconds.hidden = pace.fastest || (task.waypoints.length > 1 && task.waypoints.every(({ duration, blend }, k) => !k || blend || duration !== null));
            limits.hidden = !pace.fastest;
            if (!pace.fastest) fill(total, pace.duration ?? easyDuration(task));
            const own = engineOf(state)?.limits, wrong = own ? wrongPace(task, pace, own).map(({ at }) => at) : [];
            markWrong(total, wrong.includes("duration"));
            for (const { key, label, unit, box, name } of boxes) {
                const { factor, unit: text } = shown(unit, state.units);
                write(name, `${label} [${text}]`);
                markWrong(box, wrong.includes(key));
                fill(box, (pace[key] ?? (key === "power" ? NaN : (own?.[key] ?? NaN))) * factor);
            }
        },
    };
}

/** What makes waypoints, one by one or from a file, and takes all away. @param {State} state */
function adding(state) {
    const add = make("button", { type: "button" }, "Add this pose"), hint = make("p", { className: "note", role: "status" });
    add.addEventListener("click", () => {
        const { pose } = instant(state), last = state.task.waypoints.at(-1)?.pose;
        if (!pose || !pose.every(Number.isFinite)) return;
        const same = last?.every((value, k) => value === pose[k]);
        write(hint, same ? "This pose is the last waypoint already: move the platform first." : "");
        if (!same) setWaypoints(state, [...state.task.waypoints, { name: "", pose: [...pose], blend: 0, dwell: 0, duration: null, wrench: null }]);
    });
    const clear = make("button", { type: "button", onclick: () => state.set({ task: NO_TASK, pace: ANY_PACE, hand: null }) }, "Clear");
    const file = make("input", { type: "file", accept: ".yaml,.yml,.csv,.json,text/csv,text/yaml", hidden: true, "aria-label": "Task or motion file" });
    const load = make("button", { type: "button", title: "A task (YAML) or a motion (CSV) of p3dof", onclick: () => file.click() }, "Load …");
    const said = make("p", { className: "alarm", role: "alert" });
    /** @param {string} text */
    const say = (text) => {
        write(said, text);
        said.hidden = !text;
    };
    file.addEventListener("change", async () => {
        const [given] = file.files ?? [];
        if (!given) return;
        try {
            taken(state, given.name, await given.text());
            say("");
        } catch (error) {
            if (!(error instanceof TaskError)) throw error;
            say(`${given.name}: ${error.message}`);
        }
        file.value = "";
    });
    return {
        part: make("div", {}, make("div", { className: "buttons" }, add, load, clear, file), hint, said),
        show() {
            clear.hidden = !state.task.waypoints.length;
            if (!state.task.waypoints.length) write(hint, "");
        },
    };
}

/** Files out. @param {State} state */
function files(state) {
    const task = make("button", { type: "button", title: "Task file (YAML), for p3dof plan" }, "Save task");
    task.addEventListener("click", () => save("task.yaml", writeTask(state.task, durationsTo(state.task, state.planned), state.whatIf, solidsOf(state)), "text/yaml"));
    const motion = make("button", { type: "button", title: "Motion file (CSV), for --motion" }, "Save motion");
    motion.addEventListener("click", () => {
        const run = state.document.runs.find(({ computed }) => computed === "waypoints");
        if (run) save("motion.csv", motionCsv(state.document, run) ?? "", "text/csv");
    });
    const missing = make("p", { className: "note", role: "status" });
    const part = make("div", {}, make("div", { className: "buttons" }, task, motion), missing);
    return {
        part,
        show() {
            const { waypoints } = state.task;
            task.disabled = waypoints.length < 2 || !state.planned?.plan;
            motion.disabled = !state.planned?.plan;
            task.hidden = motion.hidden = waypoints.length < 2;
            const left = task.disabled ? [] : leftOut(state.whatIf, state.task, solidsOf(state));
            write(missing, left.length ? `A task file cannot hold ${left.join("; ")}: forces of p3dof plan are without it, unless a parameter file has it.` : "");
            missing.hidden = task.hidden || !left.length;
        },
    };
}

/** Take a file: a task becomes waypoints, a motion a run. @param {State} state @param {string} name @param {string} text */
export function taken(state, name, text) {
    const engine = engineOf(state);
    if (!engine) return;
    if (!/\.csv$/i.test(name)) {
        const { task, carrying } = readFile(text), total = task.waypoints.every(({ duration, blend }, k) => !k || blend || duration !== null);
        state.set({ task, pace: total ? { ...ANY_PACE } : state.pace, hand: null, whatIf: { ...state.whatIf, ...carrying } });
        return;
    }
    const motion = readMotion(text);
    const run = runOfMotion(engine, state.document, name, { ...motion, wrench: null });
    const { document } = state;
    state.set({ document: { ...document, runs: [...document.runs, { ...run, computed: "kept" }] }, run: document.runs.length, hand: null, zoom: null });
}

/** What the motion takes. @param {State} state */
function result(state) {
    const text = make("p", { className: "note result", role: "status" }), fault = make("p", { className: "alarm", role: "alert" });
    return {
        part: make("div", {}, text, fault),
        show() {
            const { planned } = state;
            write(fault, planned?.fault ?? "");
            fault.hidden = !planned?.fault;
            text.hidden = !planned?.plan;
            if (planned?.plan) write(text, told(state, planned, planned.plan));
        },
    };
}

/** @param {State} state @param {import("./planning.js").Planned} planned @param {import("./plan.js").Plan} plan */
function told(state, { ways, milliseconds }, plan) {
    const total = plan.time[plan.time.length - 1], texts = [];
    if (state.pace.fastest) {
        texts.push(`${fixed(total, 3)} s: the fastest of rest-to-rest ${PLURAL[state.task.profile]} along these segments (computed in ${fixed(milliseconds, 0)} ms).`);
        texts.push(`At its limit: ${ways.map(({ from, to, binding }) => `${binding === "given" ? "time as given" : binding} from ${short(from)} to ${short(to)}`).join("; ")}.`);
    } else {
        texts.push(`${fixed(total, 3)} s in all.`);
    }
    if (state.pace.fastest && isChanged(state.whatIf)) texts.push("What was before the change is the same motion without it.");
    const run = state.document.runs.find(({ computed }) => computed === "waypoints");
    const { force } = state.document.limits;
    if (run) {
        const peaks = peaksOf(state.solved && state.document.runs[state.run] === run && state.case === "total" ? state.solved : run);
        texts.push(`Largest forces ${peaks.map(({ value }, k) => `${"ABC"[k]} ${fixed(value, 1)}`).join(", ")} N${force !== undefined && peaks.some(({ value }) => Math.abs(value) > force * (1 + 1e-6)) ? `, beyond the limit of ${force} N` : ""}.`);
    }
    return texts.join(" ");
}

/** @type {Record<string, string>} */
const PLURAL = { quintic: "quintics", septic: "septics", "s-curve": "s-curves" };
/** @param {string} name */
const short = (name) => name.replace(/^waypoint /, "");

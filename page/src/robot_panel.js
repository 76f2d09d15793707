// Any robot with other masses, gravity and loads, and runs of it that the page makes by itself.
import { gravityField, wrenchFields } from "./acting.js";
import { instant } from "./instant.js";
import { choose, make, mark, write } from "./make.js";
import { RobotEngine } from "./robot_engine.js";
import { runOfSamples, simulated } from "./robot_run.js";
import { fixed } from "./units.js";

/** @typedef {import("./types").State} State */
/** @typedef {import("./robot_run.js").Sample} Sample */

/** Up to this share the page and Pinocchio differ by rounding only, also of bodies that weigh next to nothing. */
const ROUNDING = 1e-6;
const SLICE = 12; // how long the page computes without a pause [ms]
const LONGEST = 60; // of a run [s]

/** The engine of a robot in the page; null where there is none. @param {State} state */
export const robotOf = ({ engine }) => (engine instanceof RobotEngine ? engine : null);

/** @param {HTMLElement} element @param {State} state */
export function mount(element, state) {
    if (!robotOf(state)) return;
    const reset = make("button", { type: "button", id: "reset", onclick: () => robotOf(state)?.reset() }, "Reset");
    const parts = [...masses(state), motion(state)];
    element.append(make("div", { className: "title" }, make("h2", {}, "What if?"), reset),
        ...parts.map(({ row }) => row), agreement(state));
    state.subscribe(() => {
        const engine = robotOf(state);
        element.hidden = !engine;
        if (!engine) return;
        reset.disabled = !engine.changed;
        parts.forEach(({ show }) => show(engine));
    });
}

/** Which body is changed, its mass and payload, what acts on it, and gravity. @param {State} state */
function masses(state) {
    let body = -1, of = /** @type {unknown} */ (null);
    const select = make("select", { name: "body" });
    select.addEventListener("change", () => {
        body = Number(select.value);
        state.set({});
    });
    /** @param {"mass" | "payload"} kind @param {string} label @param {string} title */
    const field = (kind, label, title) => {
        const box = make("input", { type: "number", step: "any", min: "0", name: kind, "aria-label": `${label} [kg]` });
        box.addEventListener("input", () => {
            const engine = robotOf(state), value = box.valueAsNumber, good = value >= 0 && Number.isFinite(value);
            mark(box, !good);
            if (!engine || !good) return;
            const all = new Map(engine.changes[kind]);
            if (value === (kind === "mass" ? engine.original[10 * body] : 0)) all.delete(body);
            else all.set(body, value);
            engine.change({ [kind]: all });
        });
        box.addEventListener("blur", () => state.set({}));
        return { kind, box, row: make("label", { title }, `${label} [kg] `, box) };
    };
    const fields = [field("mass", "Mass", "Of this body, its inertia in proportion"), field("payload", "Payload", "A point mass at the mass centre of this body")];
    const which = {
        row: make("div", {}, make("label", { className: "field" }, "Body ", select),
            make("div", { className: "field" }, ...fields.map(({ row }) => row))),
        /** @param {RobotEngine} engine */
        show(engine) {
            if (of !== engine) [of, body] = [engine, platformOf(state, engine)];
            choose(select, state.document.scene.joints.map((_, i) => [String(i), engine.body(i)]), String(body));
            for (const { kind, box, row } of fields) {
                const value = engine.changes[kind].get(body) ?? (kind === "mass" ? engine.original[10 * body] : 0);
                row.classList.toggle("changed", engine.changes[kind].has(body));
                box.disabled = kind === "mass" && !(engine.original[10 * body] > 0);
                if (box === document.activeElement) continue;
                mark(box, false);
                if (box.valueAsNumber !== value) box.value = String(value);
            }
        },
    };
    const wrench = wrenchFields(state, "External load on this body at its mass centre [N, N m]", {
        now: () => robotOf(state)?.changes.wrench.get(body),
        changed: () => Boolean(robotOf(state)?.changes.wrench.size),
        set: (rows) => {
            const all = new Map(robotOf(state)?.changes.wrench);
            if (rows.some((x) => x !== 0)) all.set(body, rows);
            else all.delete(body);
            robotOf(state)?.change({ wrench: all });
        },
    });
    const gravity = gravityField(state, {
        own: () => robotOf(state)?.given.gravity ?? null,
        now: () => robotOf(state)?.changes.gravity,
        set: (vector) => robotOf(state)?.change({ gravity: vector ?? null }),
    });
    return [which, wrench, gravity];
}

/** The body that most closures meet at, or else the heaviest one: likely what is of interest. */
/** @param {State} state @param {RobotEngine} engine */
function platformOf({ document: { scene, closures } }, { original }) {
    const ends = scene.joints.map((_, i) => closures.filter(({ joint1, joint2 }) => joint1 === i || joint2 === i).length);
    const most = Math.max(...ends), meet = ends.flatMap((count, i) => (count === most ? [i] : []));
    return meet.length === 1 ? meet[0] : ends.reduce((best, _, i) => (original[10 * i] > original[10 * best] ? i : best), 0);
}

/** Runs of the page: simulated from where the robot is, or recorded by hand. @param {State} state */
function motion(state) {
    const kinds = make("select", { name: "motors", title: "What the motors do in the simulation" });
    /** @param {string} name @param {number} value @param {string} label @param {number} most */
    const number = (name, value, label, most) => make("input", { type: "number", step: "any", min: "0", max: String(most), value: String(value), name, "aria-label": label, title: label });
    const boxes = {
        duration: number("duration", 2, "Duration [s]", LONGEST),
        frequency: number("frequency", 3, "Natural frequency of the PD control [Hz]", 100),
        damping: number("damping", 0.7, "Damping ratio of the PD control", 10),
    };
    const start = make("button", { type: "button", name: "simulate" }, "Simulate");
    const record = make("button", { type: "button", name: "record", title: "Keep what you do by hand as a run" }, "Record");
    const bar = make("progress", { max: 1, value: 0, "aria-label": "Progress", hidden: true });
    const said = make("p", { className: "note", role: "status" });
    const row = make("details", { open: true }, make("summary", {}, "Simulate or record"),
        make("label", { className: "field" }, "Motors ", kinds),
        make("div", { className: "field" }, boxes.duration, " s ", boxes.frequency, " Hz, damping ", boxes.damping),
        make("div", { className: "field" }, start, record, bar), said);
    /** @type {{stopped: boolean} | null} */
    let job = null;
    /** @type {{samples: Sample[], since: number, hand: unknown} | null} */
    let tape = null;

    /** @param {string} name @param {Sample[]} samples @param {string[]} notes */
    const add = (name, samples, notes) => {
        const engine = robotOf(state), { document } = state;
        if (!engine) return;
        const same = document.runs.filter((run) => run.name.startsWith(name)).length;
        const run = runOfSamples(engine, `${name} ${same + 1}`, samples, notes);
        state.set({ document: { ...document, runs: [...document.runs, run] }, run: document.runs.length, time: 0, hand: null, playing: true, compare: null });
    };

    async function simulate() {
        const engine = robotOf(state);
        if (job) return void (job.stopped = true);
        const bad = Object.values(boxes).find((box) => !(box.valueAsNumber >= 0 && box.valueAsNumber <= Number(box.max)) || (box === boxes.duration && box.valueAsNumber === 0));
        if (bad || !engine) return void write(said, bad ? `${bad.ariaLabel}: expected a number above zero, up to ${bad.max}` : "");
        const mine = job = { stopped: false }, q = Float64Array.from(instant(state).q), duration = boxes.duration.valueAsNumber;
        const goal = kinds.value === "go" ? homeOf(engine) : q;
        write(start, "Stop");
        write(said, "");
        bar.hidden = false;
        try {
            const control = kinds.value === "off" ? /** @type {const} */ ({ kind: "off" })
                : /** @type {const} */ ({ kind: "hold", goal, frequency: boxes.frequency.valueAsNumber, damping: boxes.damping.valueAsNumber });
            const going = simulated(engine, q, duration, control), samples = /** @type {Sample[]} */ ([]);
            let ended = "";
            for (let until = performance.now() + SLICE; !mine.stopped;) {
                const { value, done } = going.next();
                if (done) {
                    ended = value;
                    break;
                }
                samples.push(value);
                if (performance.now() < until) continue;
                bar.value = value.time / duration;
                await new Promise((resume) => setTimeout(resume, 0));
                until = performance.now() + SLICE;
            }
            if (samples.length) add(NAMES[kinds.value], samples, ended ? [`The run ended early: ${ended}.`] : mine.stopped ? ["The run was stopped."] : []);
            if (ended) write(said, `It ended early: ${ended}.`);
        } catch (error) {
            write(said, `This cannot be simulated: ${error instanceof Error ? error.message : error}`);
        } finally {
            job = null;
            bar.hidden = true;
            write(start, "Simulate");
        }
    }
    start.addEventListener("click", () => void simulate());

    record.addEventListener("click", () => {
        const kept = tape;
        tape = kept ? null : { samples: [], since: NaN, hand: state.hand };
        record.setAttribute("aria-pressed", String(Boolean(tape)));
        write(record, tape ? "Stop recording" : "Record");
        write(said, tape ? "Move the robot by its sliders, or drag a body." : "");
        if (!kept) return;
        if (kept.samples.length < 2) write(said, "Nothing was recorded: the robot was not moved.");
        else add("Recorded", kept.samples, ["Recorded by hand: the forces are those that hold each pose at rest."]);
    });
    state.subscribe(() => {
        const engine = robotOf(state);
        if (!tape || !engine || !state.hand || state.hand === tape.hand || !("q" in state.hand)) return;
        const now = performance.now() / 1000, q = Float64Array.from(state.hand.q), { tau, lambda } = engine.holding(q);
        if (Number.isNaN(tape.since)) tape.since = now;
        const time = now - tape.since;
        tape.hand = state.hand;
        if (!tape.samples.length || time > tape.samples[tape.samples.length - 1].time) tape.samples.push({ time, q, v: new Float64Array(engine.nv), tau, lambda });
    });
    return {
        row,
        /** @param {RobotEngine} engine */
        show(engine) {
            const moved = engine.motors.length > 0;
            choose(kinds, moved ? [["hold", "hold this pose (PD)"], ["go", "go to the first pose (PD)"], ["off", "off: it falls"]] : [["off", "none: it falls"]], kinds.value || (moved ? "hold" : "off"));
            record.hidden = !moved;
            for (const box of [boxes.frequency, boxes.damping]) box.disabled = kinds.value === "off";
        },
    };
}

const NAMES = /** @type {Record<string, string>} */ ({ hold: "Held", go: "Moved", off: "Falling" });

/** The first configuration of the first run. @param {RobotEngine} engine */
function homeOf({ document: { runs }, nq }) {
    return Float64Array.from(runs[0].q.data.subarray(0, nq));
}

/** Whether this page computes what Pinocchio does. @param {State} state */
function agreement(state) {
    const line = make("p", { className: "note agreement" });
    /** @type {unknown} */
    let known = null;
    state.subscribe(() => {
        const engine = robotOf(state);
        if (!engine || engine === known) return;
        known = engine;
        const { count, most } = engine.agreement, agrees = most <= ROUNDING;
        line.classList.toggle("alarm", count > 0 && !agrees);
        line.dataset.share = String(most);
        write(line, !count ? "This page's forces could not be compared with Pinocchio's: no state in motion has any."
            : agrees ? `Forces and accelerations of this page agree with Pinocchio's to ${most.toExponential(1)} (${count} states in motion).`
                : `Forces of this page are not those of Pinocchio: they differ by ${fixed(100 * most, 6)} %.`);
    });
    return line;
}

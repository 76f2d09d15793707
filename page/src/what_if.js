// Forces with another machine than the document's: payload, friction, lengths, gravity, external load.
import { gravityField, wrenchFields } from "./acting.js";
import { ACTUATORS, PLACES, densityText, faultOf, solidsText } from "./machine.js";
import { choose, make, mark, write } from "./make.js";
import { agreement } from "./resolve.js";
import { engineOf, isChanged, solidsOf } from "./solving.js";
import { fixed, shown } from "./units.js";

/** @typedef {import("./types").State} State */
/** @typedef {import("./types").WhatIf} WhatIf */
/** @typedef {import("./engine.js").Engine} Engine */
/** @typedef {"payload"|"below"|"viscous"|"coulomb"|"L"|"R"|"r"} Key */

/**
 * A number that can be changed: its unit in the state, its range, and what it is in the document.
 * @typedef {{key: Key, label: string, unit: string, title: string, range: (base: number) => [number, number], step: number, digits: number}} Number_
 */

/** @type {Number_[]} */
const NUMBERS = [
    { key: "payload", label: "Payload", unit: "kg", title: "A point mass on the platform, besides what it carries", range: () => [0, 10], step: 0.1, digits: 1 },
    { key: "below", label: "… below P", unit: "m", title: "How far below P the payload hangs", range: () => [0, 0.3], step: 0.005, digits: 0 },
    { key: "viscous", label: "Viscous friction", unit: "N s/m", title: "Of each slider, besides the machine's", range: () => [0, 200], step: 1, digits: 0 },
    { key: "coulomb", label: "Coulomb friction", unit: "N", title: "Of each slider, besides the machine's", range: () => [0, 50], step: 0.5, digits: 1 },
    { key: "L", label: "Legs L", unit: "m", title: "Length of legs and rods", range: around, step: 0.001, digits: 0 },
    { key: "R", label: "Base R", unit: "m", title: "From the middle to each guide", range: around, step: 0.001, digits: 0 },
    { key: "r", label: "Platform r", unit: "m", title: "From P to each joint of the platform", range: around, step: 0.001, digits: 0 },
];

/** @param {number} base @returns {[number, number]} */
function around(base) {
    return [0.5 * base, 1.75 * base];
}

/** How the machine of the run that is shown differs from the document's. @param {State} state @returns {WhatIf} */
const ownOf = (state) => state.document.runs[state.run]?.machine ?? {};

/** What a number is in the run that is shown. @param {State} state @param {Engine} engine @param {Key} key */
const baseOf = (state, engine, key) => ownOf(state)[key] ?? (key === "L" || key === "R" || key === "r" ? engine.original[PLACES[key]] : 0);

/** What is changed, in few words. @param {State} state @returns {string} */
export function nameOf(state) {
    const { whatIf, units } = state;
    const texts = NUMBERS.flatMap(({ key, label, unit, digits }) => {
        const value = whatIf[key];
        if (value === undefined) return [];
        const { factor, unit: name } = shown(unit, units);
        return `${label.replace(/^… /, "")} ${fixed(value * factor, factor === 1 && unit === "m" ? 3 : digits)} ${name}`;
    });
    if (whatIf.bodies) texts.push(solidsText(solidsOf(state)));
    if (whatIf.gravity) texts.push("other gravity");
    if (whatIf.wrench) texts.push("external load");
    for (const kind of ACTUATORS) if (whatIf[kind]) texts.push(`${kind} ${whatIf[kind].join(", ")} ${UNITS[kind]}`);
    return texts.join(", ");
}

/** Keep the run as it is now, to be compared with the one before. @param {State} state */
function keep(state) {
    const { document, solved, run, whatIf } = state;
    if (!solved || !isChanged(whatIf)) return;
    const machine = { ...ownOf(state), ...whatIf };
    /** @type {import("./types").Run} */
    const kept = { ...solved, name: nameOf(state), computed: "kept", machine };
    state.set({ document: { ...document, runs: [...document.runs, kept] }, run, whatIf: {}, case: "total", compare: document.runs.length });
}

/** Change one thing; as in the document, it is not changed at all. @param {State} state @param {WhatIf} changes */
export function change(state, changes) {
    /** @type {Record<string, any>} */
    const whatIf = { ...state.whatIf, ...changes };
    for (const key of Object.keys(whatIf)) if (whatIf[key] === undefined) delete whatIf[key];
    state.set({ whatIf });
}

/** @param {HTMLElement} element @param {State} state */
export function mount(element, state) {
    const engine = engineOf(state);
    if (!engine || !state.document.runs.some(({ pose }) => pose)) return;
    const reset = make("button", { type: "button", id: "reset", onclick: () => state.set({ whatIf: {} }) }, "Reset");
    const kept = make("button", { type: "button", title: "Keep this run, and compare it with the one before", onclick: () => keep(state) }, "Keep and compare");
    const parts = [numbers(state), bodies(state), gravity(state), actuators(state), wrench(state)];
    const result = peaks(state);
    element.append(
        make("div", { className: "title" }, make("h2", {}, "What if?"), make("span", {}, kept, " ", reset)),
        ...parts.map(({ row }) => row), ...result.rows, agreed(state),
    );
    state.subscribe(() => {
        const now = engineOf(state);
        if (!now) return;
        reset.disabled = !isChanged(state.whatIf);
        kept.hidden = !state.solved || state.case !== "total" || !isChanged(state.whatIf);
        parts.forEach((part) => part.show(now));
        result.show();
    });
}

/** @param {State} state */
function numbers(state) {
    const rows = NUMBERS.map((number) => {
        const bar = make("input", { type: "range", step: "any", "aria-label": number.label, name: number.key });
        const box = make("input", { type: "number", step: "any", "aria-label": `${number.label}, number` });
        const unit = make("span", { className: "unit" });
        const row = make("div", { className: "slider", title: number.title }, make("span", { className: "name" }, number.label), bar, box, unit);
        /** @param {string} text @param {number} factor */
        const take = (text, factor) => {
            const engine = engineOf(state), value = Number(text) / factor;
            if (!engine || text.trim() === "" || !Number.isFinite(value)) return;
            const base = baseOf(state, engine, number.key), near = Math.abs(value - base) < 1e-12;
            change(state, { [number.key]: near ? undefined : value });
        };
        bar.addEventListener("input", () => {
            const engine = engineOf(state);
            if (!engine) return;
            const base = baseOf(state, engine, number.key), value = Number(bar.value);
            const stepped = base + Math.round((value - base) / number.step) * number.step; // the document's own value is a step
            take(String(Number(stepped.toPrecision(12))), 1);
        });
        box.addEventListener("input", () => {
            if (box.validity.badInput) mark(box, true);
            else take(box.value, shown(number.unit, state.units).factor);
        });
        box.addEventListener("blur", () => state.set({})); // back to what is in force
        return { row, bar, box, unit, number };
    });
    return {
        row: make("div", { className: "sliders" }, ...rows.map(({ row }) => row)),
        /** @param {Engine} engine */
        show(engine) {
            const faulty = faultOf(engine.original, { ...ownOf(state), ...state.whatIf })?.keys ?? [];
            for (const { row, bar, box, unit, number } of rows) {
                const { factor, unit: name } = shown(number.unit, state.units), base = baseOf(state, engine, number.key);
                const [low, high] = number.range(base), value = state.whatIf[number.key] ?? base;
                if (bar.min !== String(low) || bar.max !== String(high)) Object.assign(bar, { min: low, max: high });
                if (Number(bar.value) !== value) bar.value = String(value);
                bar.setAttribute("aria-valuetext", `${fixed(value * factor, number.digits)} ${name}`);
                write(unit, name);
                row.classList.toggle("changed", state.whatIf[number.key] !== undefined);
                const focused = box === document.activeElement;
                mark(box, faulty.includes(number.key) || (focused && box.validity.badInput));
                if (focused) continue;
                const text = String(Number((value * factor).toPrecision(6)));
                if (box.value !== text || box.validity.badInput) box.value = text;
            }
        },
    };
}

/** What solids are: their densities, where the list is too narrow to show them, and where their sizes come from. @param {import("./types").OfSolids} solids */
function solidsNote(solids) {
    const given = Object.values(solids.dimensions).length, density = densityText(solids);
    const sizes = given === 4 ? "other sizes are the file's" : `${given ? "sizes of the file, " : ""}other sizes by the least ratio to the paper's`;
    return `${density ? `${density}: ` : ""}cubes, round rods and the rounded plate, cut to the lengths; ${sizes}`;
}

/** Which bodies a machine of other lengths has. @param {State} state */
function bodies(state) {
    const select = make("select", { name: "bodies" });
    select.addEventListener("change", () => change(state, { bodies: select.value === (ownOf(state).bodies ?? "kept") ? undefined : select.value === "solids" ? "solids" : "kept" }));
    const told = make("span", { className: "note" });
    const row = make("label", { className: "field" }, "Bodies ", select, told);
    return {
        row,
        show() {
            choose(select, [["kept", "as in the file"], ["solids", solidsText(solidsOf(state), " of these lengths")]], state.whatIf.bodies ?? ownOf(state).bodies ?? "kept");
            const now = { ...ownOf(state), ...state.whatIf }, longer = now.L !== undefined || now.R !== undefined || now.r !== undefined;
            row.hidden = !longer && now.bodies === undefined;
            row.classList.toggle("changed", state.whatIf.bodies !== undefined);
            write(told, now.bodies === "solids"
                ? solidsNote(solidsOf(state))
                : longer ? "each body keeps its mass, mass centre and inertia, whatever the lengths" : "");
        },
    };
}

/** @param {State} state */
const gravity = (state) => gravityField(state, {
    own: () => engineOf(state)?.original.subarray(PLACES.gravity, PLACES.gravity + 3) ?? null,
    now: () => state.whatIf.gravity,
    set: (vector) => change(state, { gravity: vector }),
});

const UNITS = { armature: "kg", counterbalance: "N", spring: "N/m", counterweight: "kg" };
const MEANINGS = {
    armature: "Inertia of motor and screw, reflected to the slider",
    counterbalance: "Force of the balance on the slider at home, upward",
    spring: "How fast that force falls as the slider rises",
    counterweight: "Mass on a rope over a pulley that pulls the slider up",
};

/** Motors and counterbalances of the three sliders: the machine's, and what they are instead. @param {State} state */
function actuators(state) {
    /** @param {Engine} engine @param {typeof ACTUATORS[number]} kind */
    const base = (engine, kind) => ownOf(state)[kind] ?? Array.from(engine.original.slice(PLACES[kind], PLACES[kind] + 3));
    const rows = ACTUATORS.map((kind) => {
        const label = (/** @type {number} */ k) => `${kind} of ${"ABC"[k]} [${UNITS[kind]}]`;
        const boxes = [0, 1, 2].map((k) => make("input", { type: "number", step: "any", "aria-label": label(k) }));
        boxes.forEach((box, k) => {
            box.addEventListener("input", () => {
                const engine = engineOf(state), value = box.valueAsNumber;
                mark(box, box.validity.badInput);
                if (!engine || !Number.isFinite(value)) return;
                const own = base(engine, kind), now = [...(state.whatIf[kind] ?? own)];
                now[k] = value;
                change(state, { [kind]: now.every((x, i) => x === own[i]) ? undefined : now });
            });
            box.addEventListener("blur", () => state.set({}));
        });
        const name = make("th", { scope: "row", title: MEANINGS[kind] }, `${kind} [${UNITS[kind]}]`);
        return { kind, boxes, row: make("tr", {}, name, ...boxes.map((box) => make("td", {}, box))) };
    });
    const head = make("tr", {}, make("td"), ...["A", "B", "C"].map((leg) => make("th", { scope: "col" }, leg)));
    const table = make("table", { className: "actuators" }, make("thead", {}, head), make("tbody", {}, ...rows.map(({ row }) => row)));
    const row = make("details", {}, make("summary", {}, "Motors and counterbalances"), table);
    return {
        row,
        /** @param {Engine} engine */
        show(engine) {
            const faulty = faultOf(engine.original, { ...ownOf(state), ...state.whatIf })?.keys ?? [];
            for (const { kind, boxes, row: line } of rows) {
                const values = state.whatIf[kind] ?? base(engine, kind);
                line.classList.toggle("changed", state.whatIf[kind] !== undefined);
                boxes.forEach((box, k) => {
                    const focused = box === document.activeElement;
                    mark(box, faulty.includes(kind) || (focused && box.validity.badInput));
                    if (!focused && box.valueAsNumber !== values[k]) box.value = String(values[k]);
                });
            }
            row.classList.toggle("changed", ACTUATORS.some((kind) => state.whatIf[kind] !== undefined));
        },
    };
}

/** @param {State} state */
const wrench = (state) => wrenchFields(state, "External load at P [N, N m]", {
    now: () => state.whatIf.wrench ?? ownOf(state).wrench,
    changed: () => state.whatIf.wrench !== undefined,
    set: (rows) => change(state, { wrench: rows.some((value) => value !== 0) || ownOf(state).wrench ? rows : undefined }),
});

/** The largest forces before and now, and what went wrong. @param {State} state */
function peaks(state) {
    const cells = ["A", "B", "C"].map((leg) => [make("td"), make("td"), make("td")].map((td) => Object.assign(td, { leg })));
    const rows = cells.map((row, k) => make("tr", {}, make("th", { scope: "row" }, "ABC"[k]), ...row));
    const heads = ["before", "now", "change"].map((text) => make("th", { scope: "col" }, text));
    const table = make("table", { className: "peaks" }, make("caption", {}, "Largest forces [N]"),
        make("thead", {}, make("tr", {}, make("td"), ...heads)), make("tbody", {}, ...rows));
    const sentence = make("p", { className: "note result", role: "status" });
    const fault = make("p", { className: "alarm", role: "alert" });
    return {
        rows: [table, sentence, fault],
        show() {
            const { report } = state;
            table.hidden = !report?.changed;
            sentence.hidden = !report?.changed;
            fault.hidden = !report?.fault;
            write(fault, report?.fault ? `${report.fault}. The machine before is kept.` : "");
            if (!report?.changed) return void write(sentence, "");
            report.before.forEach((before, k) => {
                const now = report.after[k], [size, then] = [Math.abs(now.value), Math.abs(before.value)];
                const texts = [fixed(before.value, 1), fixed(now.value, 1), then > 0 ? percent(size / then - 1) : ""];
                texts.forEach((text, i) => write(cells[k][i], text));
            });
            write(sentence, told(state, report));
        },
    };
}

/** A change with its sign; without one where nothing is seen of it. @param {number} share */
function percent(share) {
    const text = fixed(100 * share, 0);
    return `${share > 0 && text !== "0" ? "+" : ""}${text} %`;
}

/** What a change does, in a sentence. @param {State} state @param {import("./resolve.js").Report} report */
function told(state, report) {
    const { force } = state.document.limits;
    const [now, before] = [report.after, report.before].map((row) => {
        const leg = row.reduce((best, { value }, k) => (Math.abs(value) > Math.abs(row[best].value) || Number.isNaN(row[best].value) ? k : best), 0);
        return `${fixed(Math.abs(row[leg].value), 1)} N (${"ABC"[leg]} at ${fixed(row[leg].time, 3)} s)`;
    });
    const texts = [`The largest force is ${now}; it was ${before}.`];
    if (force !== undefined) {
        const over = report.after.flatMap(({ value, time }, k) => (Math.abs(value) > force ? [`${"ABC"[k]} at ${fixed(time, 3)} s`] : []));
        if (over.length) texts.push(`Beyond the force limit of ${force} N: ${over.join(", ")}.`);
    }
    const count = report.gaps.reduce((sum, gap) => sum + gap.count, 0);
    if (count) {
        const spans = report.gaps.slice(0, 3).map(({ from, to, reason }) => `${from === to ? `at ${fixed(from, 3)} s` : `${fixed(from, 3)} to ${fixed(to, 3)} s`}${reason === "singular" ? " (singular)" : ""}`);
        texts.push(`${count} of ${report.samples} samples cannot be reached, gaps in the curves: ${spans.join(", ")}${report.gaps.length > 3 ? ", …" : ""}.`);
    }
    texts.push(`Dashed: as before. ${report.samples} samples in ${fixed(report.milliseconds, 1)} ms.`);
    return texts.join(" ");
}

/** Up to this share of the largest force, the page and Pinocchio differ by rounding only. */
const ROUNDING = 1e-9;

/** Whether the file's forces are those of its machine. @param {State} state */
function agreed(state) {
    const line = make("p", { className: "note agreement" });
    /** @type {unknown} */
    let known = null;
    state.subscribe(() => {
        const engine = engineOf(state), run = state.document.runs[state.run];
        if (!engine || !run || run === known) return;
        known = run;
        const found = run.computed ? null : agreement(engine, state.document, run);
        line.hidden = !found;
        if (!found) return;
        const { share, worst, time, leg, samples } = found, agrees = share <= ROUNDING;
        line.classList.toggle("alarm", !agrees);
        line.dataset.share = String(share);
        write(line, agrees
            ? `Forces computed in this page agree with the file's to ${share.toExponential(1)} of the largest force (${samples / 3} samples).`
            : `The file's forces are not those of its machine: ${"ABC"[leg]} differs by ${fixed(worst, worst < 1 ? 4 : 1)} N at ${fixed(time, 3)} s, ${fixed(share * 100, 2)} % of the largest force. What is recomputed here is the machine's.`);
    });
    return line;
}

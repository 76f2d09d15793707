// Keeps the run that is shown in step with what is changed: first of all in every refresh.
import { Engine } from "./engine.js";
import { STEEL_SOLIDS } from "./machine.js";
import { gapsOf, peaksOf, resolved } from "./resolve.js";

/** @typedef {import("./types").State} State */

const WATCHED = ["whatIf", "case", "run", "document"];

/** The engine in the page; null where there is none, or Python is asked. @param {State} state @returns {Engine | null} */
export const engineOf = ({ engine }) => (engine instanceof Engine ? engine : null);

/** @param {State} state */
export function mount(state) {
    state.subscribe((_, changed) => {
        const engine = engineOf(state);
        if (!engine || !WATCHED.some((field) => changed.has(field))) return;
        takeMachine(engine, state.document, state.document.runs[state.run]);
        solve(state, engine);
        for (const field of ["solved", "before", "report"]) changed.add(field);
        state.version += 1;
    });
}

/** Compute with the machine of a run, or of the document. @param {Engine} engine @param {import("./types").Document} document @param {import("./types").Run} [run] */
export function takeMachine(engine, { engine: given }, run) {
    const of = run?.parameters ? run : given.kind === "p3dof" ? given : null;
    if (of?.parameters) engine.take(of.parameters.data, of.solids);
}

/** What solids of the machine that is shown are made of. @param {State} state */
export const solidsOf = (state) => engineOf(state)?.solids ?? STEEL_SOLIDS;

/** Whether something is changed of the machine. @param {import("./types").WhatIf} whatIf */
export const isChanged = (whatIf) => Object.values(whatIf).some((value) => value !== undefined);

/** Computes `solved`, `before` and `report`. @param {State} state @param {Engine} engine */
export function solve(state, engine) {
    const { document, whatIf, case: part } = state, run = document.runs[state.run], own = run?.machine ?? {};
    state.solved = state.before = state.report = null;
    const fault = changedTo(engine, { ...own, ...whatIf });
    if (!run?.pose || !run.velocity || !run.acceleration) return;
    const start = performance.now(), changed = !fault ? isChanged(whatIf) : JSON.stringify(engine.whatIf) !== JSON.stringify(own);
    if (changed || part !== "total") state.solved = resolved(engine, document, run, part);
    if (changed) state.before = part === "total" ? run : withMachine(engine, own, () => resolved(engine, document, run, part));
    const after = !changed ? run : part === "total" && state.solved ? state.solved : resolved(engine, document, run, "total");
    state.report = {
        changed, fault,
        before: peaksOf(run),
        after: peaksOf(after),
        samples: run.time.shape[0],
        gaps: changed ? gapsOf(engine, run) : [],
        milliseconds: performance.now() - start,
    };
}

/** @param {Engine} engine @param {import("./types").WhatIf} whatIf @returns {string} why it cannot be */
export function changedTo(engine, whatIf) {
    try {
        engine.set(whatIf);
        return "";
    } catch (error) {
        return error instanceof Error ? error.message : String(error);
    }
}

/** What is computed with another machine. @template T @param {Engine} engine @param {import("./types").WhatIf} machine @param {() => T} compute @returns {T} */
function withMachine(engine, machine, compute) {
    const { whatIf } = engine;
    engine.set(machine);
    try {
        return compute();
    } finally {
        engine.set(whatIf);
    }
}

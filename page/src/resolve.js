// A run of the document, computed again in the page: with another machine, or a part of its forces.
/** @typedef {import("./engine.js").Engine} Engine */
/** @typedef {import("./types").Document} Document */
/** @typedef {import("./types").Run} Run */
/** @typedef {import("./types").Curve} Curve */
/** @typedef {import("./types").Fields["case"]} Part of the forces: all, what holds each pose at rest, the rest of it */

const LEGS = ["a", "b", "c"];

/** The largest force of an actuator, with its sign, and when. @typedef {{value: number, time: number}} Peak */

/**
 * What recomputing came to.
 * @typedef {object} Report
 * @property {boolean} changed whether the machine is another one than the document's
 * @property {Peak[]} before of A, B, C, all forces, with the document's machine
 * @property {Peak[]} after with the present one
 * @property {number} samples
 * @property {{count: number, reason: "reach" | "singular", from: number, to: number}[]} gaps times without forces
 * @property {number} milliseconds
 * @property {string} fault why the machine is not one; "" where it is
 */

/**
 * What a run is with the engine's machine; its curves that are not of the machine stay.
 * @param {Engine} engine @param {Document} document @param {Run} run @param {Part} part
 * @returns {Run}
 */
export function resolved(engine, document, run, part) {
    const { pose, velocity, acceleration } = run;
    if (!pose || !velocity || !acceleration) throw new Error("this run has no poses");
    const samples = { pose: pose.data, velocity: velocity.data, acceleration: acceleration.data };
    const found = engine.solve({ ...samples, wrench: run.wrench?.data });
    const rest = engine.holding(pose.data, run.wrench?.data);
    const shown = partOf(found.forces, rest, part);
    const power = shown.map((force, k) => force * found.speeds[k]);
    const rows = {
        force: shown, static: rest, slider: found.sliders, speed: found.speeds, power,
        acceleration: engine.sliderAccelerations(samples),
    };
    const count = found.status.length;
    const known = new Map(Object.entries(rows).flatMap(([key, values]) =>
        LEGS.map((leg, k) => [`${key}_${leg}`, column(values, k, count)])));
    known.set("power_total", sumOf(power, count));
    if (run.nearest && otherLengths(engine, document, run)) known.set("least_distance", new Float64Array(count).fill(NaN));
    const curves = run.curves.map((curve) => withValues(curve, known.get(curve.key)));
    return {
        ...run,
        q: { shape: [count, run.q.shape[1]], data: engine.configurations(document, pose.data) },
        curves,
        loads: [...run.loads, ...wrenchLoads(engine, document, run)],
    };
}

/** Whether legs or plates are longer or shorter than when distances were looked at. @param {Engine} engine @param {Document} document @param {Run} run */
function otherLengths({ lengths }, { engine: given }, { parameters }) {
    const numbers = parameters ?? (given.kind === "p3dof" ? given.parameters : null);
    return numbers !== null && [lengths.r, lengths.R, lengths.L].some((length, i) => length !== numbers.data[i]);
}

/**
 * A run of a motion of the platform that is not in the document, with curves like those of its first run.
 * @param {Engine} engine @param {Document} document @param {string} name
 * @param {{time: Float64Array, pose: Float64Array, velocity: Float64Array, acceleration: Float64Array, wrench: Float64Array | null}} motion
 * @returns {Run}
 */
export function runOfMotion(engine, document, name, motion) {
    const like = document.runs[0], count = motion.time.length;
    const width = like.q.shape[1];
    /** @param {Float64Array} data @param {number} size */
    const table = (data, size) => ({ shape: [count, size], data });
    const names = ["y", "z", "theta"], tables = { "": motion.pose, _dot: motion.velocity, _ddot: motion.acceleration };
    const poses = new Map(Object.entries(tables).flatMap(([dots, rows]) =>
        names.map((axis, k) => [`${axis}${dots}`, column(rows, k, count)])));
    const made = /^(force|static|power|slider|speed|acceleration)_[abc]$|^power_total$/;
    const curves = like.curves.filter(({ key }) => poses.has(key) || made.test(key))
        .map((curve) => withValues(curve, poses.get(curve.key) ?? new Float64Array(count)));
    const wrench = motion.wrench ? { wrench: table(motion.wrench, 6) } : {};
    const loads = [...like.loads.filter(({ group }) => group === "actuator"), ...ownLoads(document, motion.wrench, count)];
    /** @type {Run} */
    const run = {
        name, curves, loads, notes: [],
        time: { shape: [count], data: motion.time },
        q: { shape: [count, width], data: new Float64Array(0) },
        pose: table(motion.pose, 3), velocity: table(motion.velocity, 3), acceleration: table(motion.acceleration, 3),
        ...wrench,
    };
    const { whatIf, original, solids } = engine;
    if (document.engine.kind === "p3dof") engine.take(document.engine.parameters.data, document.engine.solids);
    engine.set({});
    try {
        return resolved(engine, document, run, "total");
    } finally {
        engine.take(original, solids);
        engine.set(whatIf);
    }
}

/** @param {Float64Array} all @param {Float64Array} rest @param {Part} part */
function partOf(all, rest, part) {
    if (part === "static") return rest.map((force, k) => (Number.isNaN(all[k]) ? NaN : force));
    return part === "dynamic" ? all.map((force, k) => force - rest[k]) : all;
}

/** @param {Float64Array} rows of three @param {number} k @param {number} count */
function column(rows, k, count) {
    const values = new Float64Array(count);
    for (let i = 0; i < count; ++i) values[i] = rows[3 * i + k];
    return values;
}

/** @param {Float64Array} rows of three @param {number} count */
function sumOf(rows, count) {
    const values = new Float64Array(count);
    for (let i = 0; i < count; ++i) values[i] = rows[3 * i] + rows[3 * i + 1] + rows[3 * i + 2];
    return values;
}

/** @param {Curve} curve @param {Float64Array | undefined} values @returns {Curve} */
const withValues = (curve, values) => (values ? { ...curve, values: { shape: [values.length], data: values } } : curve);

/** The arrows of the external wrench of what is changed. @param {Engine} engine @param {Document} document @param {Run} run */
function wrenchLoads(engine, document, run) {
    if (!engine.wrench) return [];
    const count = run.time.shape[0], rows = new Float64Array(6 * count), { wrench } = engine;
    for (let k = 0; k < rows.length; ++k) rows[k] = wrench[k % 6];
    return ownLoads(document, rows, count);
}

/** @param {Document} document @param {Float64Array | null} wrench rows of six @param {number} count @returns {import("./types").Load[]} */
function ownLoads({ scene }, wrench, count) {
    const at = scene.traced;
    if (!wrench || !at) return [];
    return /** @type {const} */ (["force", "moment"]).flatMap((kind, half) => {
        const data = new Float64Array(3 * count);
        for (let i = 0; i < count; ++i) for (let k = 0; k < 3; ++k) data[3 * i + k] = wrench[6 * i + 3 * half + k];
        if (!data.some((x) => x !== 0)) return [];
        return [{
            key: `what_if_${kind}`, label: `External ${kind} at P`, kind, joint: at.joint, point: at.point, frame: "world",
            values: { shape: [count, 3], data }, colour: "#7b1fa2", group: "wrench", unit: kind === "force" ? "N" : "N m",
        }];
    });
}

/** The largest force of each actuator. @param {Run} run @returns {Peak[]} */
export function peaksOf(run) {
    return LEGS.map((leg) => {
        const values = run.curves.find(({ key }) => key === `force_${leg}`)?.values.data ?? [];
        let at = -1;
        for (let i = 0; i < values.length; ++i) if (at < 0 ? !Number.isNaN(values[i]) : Math.abs(values[i]) > Math.abs(values[at])) at = i;
        return { value: at < 0 ? NaN : values[at], time: at < 0 ? NaN : run.time.data[at] };
    });
}

/** Where a run has no forces with the engine's machine. @param {Engine} engine @param {Run} run @returns {Report["gaps"]} */
export function gapsOf(engine, run) {
    const { status } = engine.solve({ pose: run.pose?.data ?? [] });
    const time = run.time.data;
    /** @type {Report["gaps"]} */
    const gaps = [];
    let last = 0;
    status.forEach((told, i) => {
        if (told !== 0) {
            if (told === last) Object.assign(gaps[gaps.length - 1], { to: time[i], count: gaps[gaps.length - 1].count + 1 });
            else gaps.push({ count: 1, reason: told === 3 ? "singular" : "reach", from: time[i], to: time[i] });
        }
        last = told;
    });
    return gaps;
}

/**
 * By how much the forces of a document's run differ from the engine's, of the machine that this has taken.
 * @param {Engine} engine @param {Document} document @param {Run} run
 * @returns {{share: number, worst: number, time: number, leg: number, samples: number} | null} null: it has none to compare,
 * or is of another machine whose numbers are not known
 */
export function agreement(engine, document, run) {
    if (!run.pose || !run.velocity || !run.acceleration || (run.machine && !run.parameters)) return null;
    const { whatIf } = engine;
    engine.set({});
    const mine = resolved(engine, document, run, "total");
    engine.set(whatIf);
    let [worst, largest, time, which, samples] = [0, 0, NaN, -1, 0];
    LEGS.forEach((leg, k) => {
        const [theirs, ours] = [run, mine].map(({ curves }) => curves.find(({ key }) => key === `force_${leg}`)?.values.data ?? []);
        for (let i = 0; i < theirs.length; ++i) {
            if (Number.isNaN(theirs[i])) continue;
            ++samples;
            largest = Math.max(largest, Math.abs(theirs[i]));
            const off = Math.abs(ours[i] - theirs[i]);
            if (!(off <= worst)) [worst, time, which] = [Number.isNaN(off) ? Infinity : off, run.time.data[i], k];
        }
    });
    return samples ? { share: largest > 0 ? worst / largest : worst, worst, time, leg: which, samples } : null;
}

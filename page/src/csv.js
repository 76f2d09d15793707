// Runs as text: all curves as a table, and the motion as files that p3dof reads.

/** @typedef {import("./types").Run} Run */
/** @typedef {import("./types").Table} Table */
/** @typedef {import("./types").Document} Document */

const POSE = ["y", "z", "theta"];

/**
 * Columns as CSV; every number as the shortest text that reads back to the same bits.
 * @param {string[]} header
 * @param {ArrayLike<number>[]} columns
 * @returns {string}
 */
export function csv(header, columns) {
    const rows = [header.map(quoted).join(",")];
    for (let row = 0; row < columns[0].length; row++) {
        rows.push(columns.map((column) => (Number.isNaN(column[row]) ? "nan" : String(column[row]))).join(","));
    }
    return `${rows.join("\n")}\n`;
}

/** @param {string} field */
const quoted = (field) => (/[",\n]/.test(field) ? `"${field.replaceAll('"', '""')}"` : field);

/** All curves of a run, in stored units. @param {Run} run @returns {string} */
export function curvesCsv(run) {
    const names = run.curves.map(({ label, group, unit }) => {
        const same = run.curves.filter((curve) => curve.label === label).length > 1;
        const name = same ? `${group} ${label}` : label;
        return unit && unit !== "1" ? `${name} [${unit}]` : name;
    });
    return csv(["t [s]", ...names], [run.time.data, ...run.curves.map(({ values }) => values.data)]);
}

/**
 * The motion of a run as `--motion` reads it: of the platform, or of the actuated joints of any robot.
 * @param {Document} document
 * @param {Run} run
 * @returns {string | null} null where a run has none
 */
export function motionCsv(document, run) {
    const found = motionColumns(document, run);
    return found && csv(found.header, found.columns);
}

/** @param {Document} document @param {Run} run @returns {{header: string[], columns: ArrayLike<number>[]} | null} */
export function motionColumns(document, run) {
    const { pose, velocity, acceleration } = run;
    if (pose && velocity && acceleration) {
        const header = [...POSE, ...POSE.map((name) => `${name}dot`), ...POSE.map((name) => `${name}ddot`)];
        const columns = [pose, velocity, acceleration].flatMap((table) => [0, 1, 2].map((k) => columnOf(table, k)));
        return { header: ["t", ...header], columns: [run.time.data, ...columns] };
    }
    const joints = document.inputs.flatMap(({ joint }) => (joint === undefined ? [] : [document.scene.joints[joint]]));
    if (!joints.length || !joints.every(({ q }) => q && q[1] === 1)) return null;
    const columns = joints.map(({ q }) => columnOf(run.q, q?.[0] ?? 0));
    return { header: ["t", ...joints.map(({ name }) => name)], columns: [run.time.data, ...columns] };
}

/** @param {Table} table @param {number} column @returns {Float64Array} */
export function columnOf({ shape, data }, column) {
    return Float64Array.from({ length: shape[0] }, (_, row) => data[row * shape[1] + column]);
}

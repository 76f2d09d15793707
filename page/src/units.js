// What is stored in SI units and radians, shown in millimetres and degrees or as it is.

/** @typedef {"mm" | "SI"} System */
/** @typedef {{unit: string, factor: number}} Shown */

const DEGREE = 180 / Math.PI;

/** What stands for a length or an angle in millimetres and degrees; a compound unit is made from these. */
const MILLIMETRES = [
    { of: "m", unit: "mm", factor: 1000 },
    { of: "rad", unit: "°", factor: DEGREE },
];

/** A length or an angle, alone or over something, or a product of these; other units stay as they are. */
const LENGTHS = /^(?:m|rad)(?=\/)|^(?:m|rad)[²³]?(?: (?:m|rad)[²³]?)*$/;

/**
 * How a unit is shown.
 * @param {string} unit as in the document: m, rad, N, m/s, rad/s^2, ...
 * @param {System} system
 * @returns {Shown} the unit to print, and what a stored number is multiplied by
 */
export function shown(unit, system) {
    const plain = unit.replace("^2", "²").replace("^3", "³");
    const [found] = (system === "mm" && LENGTHS.exec(plain)) || [""];
    const parts = found.split(" ").filter(Boolean).map((text) => {
        const { of, unit, factor } = text.startsWith("rad") ? MILLIMETRES[1] : MILLIMETRES[0], power = text.slice(of.length);
        return { unit: unit + power, factor: factor ** (1 + "1²³".indexOf(power || "1")) };
    });
    return {
        unit: parts.map((part) => part.unit).join(" ") + plain.slice(found.length),
        factor: parts.reduce((product, part) => product * part.factor, 1),
    };
}

/** Instead of decimals: digits after the point, and a power of ten. */
const POWERS = -3;

/**
 * How many decimals show a value of this size, and all smaller ones beside it, with four digits.
 * @param {number} size the largest magnitude, in the shown unit
 * @returns {number} negative: with powers of ten
 */
export function decimals(size) {
    if (!(size > 0) || !Number.isFinite(size)) return 1;
    if (size < 1e-4 || size >= 1e7) return POWERS;
    return Math.min(6, Math.max(0, 3 - Math.floor(Math.log10(size) + 1e-9)));
}

/**
 * How many decimals write all multiples of a step exactly.
 * @param {number} step
 * @returns {number} at most ten
 */
export function decimalsOf(step) {
    for (let digits = 0; digits < 10; digits++) {
        const scaled = step * 10 ** digits;
        if (scaled > 0.5 && Math.abs(scaled - Math.round(scaled)) < 1e-6 * scaled) return digits;
    }
    return 10;
}

/** The next 1, 2, 2.5 or 5 times a power of ten. @param {number} least @returns {number} */
export function roundStep(least) {
    const power = 10 ** Math.floor(Math.log10(least));
    return power * ([1, 2, 2.5, 5, 10].find((part) => part * power >= least * (1 - 1e-9)) ?? 10);
}

/**
 * A number with a true minus sign, and without one before a zero.
 * @param {number} value
 * @param {number} digits after the point; negative: so many, and a power of ten
 * @returns {string} "–" where there is no number
 */
export function fixed(value, digits) {
    if (!Number.isFinite(value)) return "–";
    const size = Math.abs(value);
    const text = digits >= 0 ? size.toFixed(digits) : size === 0 ? "0" : size.toExponential(-digits);
    return value < 0 && Number(text) !== 0 ? `−${text}` : text;
}

/**
 * A time in seconds with as many digits as its samples need, three at least.
 * @param {number} seconds
 * @param {number} step between samples [s]
 * @returns {string}
 */
export function clock(seconds, step = 1e-3) {
    const digits = step > 0 ? Math.min(6, Math.max(3, Math.ceil(-Math.log10(step) - 1e-9))) : 3;
    return `${fixed(seconds, digits)} s`;
}

/**
 * A label with its unit in brackets; without brackets where there is no unit.
 * @param {string} label
 * @param {string} unit
 * @param {System} system
 */
export function titled(label, unit, system) {
    const name = shown(unit, system).unit;
    return name && name !== "1" ? `${label} [${name}]` : label;
}

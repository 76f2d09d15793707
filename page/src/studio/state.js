// What the parts of the studio share: the document, what is chosen, and who wants to know.
import { shown as inUnits } from "../units.js";

/**
 * @typedef {{ name: string, unit: string, meaning: string, values: (number | null)[] }} Index over θ (rows) and y
 * @typedef {{ name: string, unit: string, better: "small" | "large" | "", values: (number | null)[] }} Column of designs
 * @typedef {{
 *   title: string, machine: { r: number, R: number, L: number, b: number, travel: [number, number] },
 *   sizes: { name: string, unit: string, value: number }[],
 *   map: { y: number[], theta: number[], inside: number[], indices: Index[] },
 *   loci: { name: string, points: [number | null, number | null][] }[],
 *   limits: { tilt: [number, number] },
 *   path: { time: number[], points: [number, number][] } | null,
 *   designs: { columns: Column[], start: number | null } | null,
 * }} Studio
 * @typedef {"index" | "place" | "selection" | "axes" | "units"} Change
 */

export class State {
    /** @param {Studio} studio */
    constructor(studio) {
        this.studio = studio;
        this.index = 0;
        /** @type {"mm" | "SI"} */
        this.units = "mm";
        /** Column and row of the map that the slices go through. */
        this.place = { i: nearest(studio.map.y, 0), j: nearest(studio.map.theta, 0) };
        const designs = studio.designs;
        const count = designs ? (designs.columns[0]?.values.length ?? 0) : 0;
        /** Which designs are selected. */
        this.selected = new Set(Array.from({ length: count }, (_, row) => row));
        /** The design that is looked at. @type {number | null} */
        this.design = designs?.start ?? (count ? 0 : null);
        const goals = designs ? designs.columns.flatMap(({ better }, k) => (better ? [k] : [])) : [];
        /** Columns of the scatter. */
        this.axes = [goals[0] ?? 0, goals[1] ?? Math.min(1, (designs?.columns.length ?? 1) - 1)];
        /** @type {((change: Change) => void)[]} */
        this.watchers = [];
    }

    /** @param {(change: Change) => void} watcher */
    watch(watcher) {
        this.watchers.push(watcher);
    }

    /** @param {Change} change */
    tell(change) {
        for (const watcher of this.watchers) watcher(change);
    }

    /** How many designs there are. */
    get count() {
        return this.studio.designs?.columns[0]?.values.length ?? 0;
    }

    /** @param {number} k of the index @param {number} i @param {number} j @returns {number | null} */
    at(k, i, j) {
        return this.studio.map.indices[k].values[j * this.studio.map.y.length + i];
    }

    /** What y [m] and θ [degrees] are multiplied by, and their units as they are shown. */
    get poseUnits() {
        const y = inUnits("m", this.units), theta = inUnits("rad", this.units);
        return { y, theta: { unit: theta.unit, factor: (theta.factor * Math.PI) / 180 } };
    }

    /** A stored value with the unit that is chosen. @param {{ unit: string }} item @param {number | null | undefined} value */
    told({ unit }, value) {
        return value === null || value === undefined ? shown(value) : shown(value * inUnits(unit, this.units).factor);
    }

    /** A name with the unit that is chosen. @param {{ name: string, unit: string }} item */
    named({ name, unit }) {
        const said = inUnits(unit, this.units).unit;
        return `${words(name)}${said && said !== "1" ? ` [${said}]` : ""}`;
    }

    /** A pose of the map in words. @param {number} i @param {number} j */
    where(i, j) {
        const { y, theta } = this.poseUnits, { map } = this.studio;
        const angle = `${shown(map.theta[j] * theta.factor)}${theta.unit === "°" ? "" : " "}${theta.unit}`;
        return { y: `y = ${shown(map.y[i] * y.factor)} ${y.unit}`, theta: `θ = ${angle}` };
    }

    /** @param {"mm" | "SI"} units */
    chooseUnits(units) {
        this.units = units;
        this.tell("units");
    }

    /** @param {number} index */
    chooseIndex(index) {
        this.index = index;
        this.tell("index");
    }

    /** @param {number} i @param {number} j */
    choosePlace(i, j) {
        this.place = { i, j };
        this.tell("place");
    }

    /** @param {Iterable<number>} rows */
    select(rows) {
        this.selected = new Set(rows);
        this.tell("selection");
    }

    /** @param {number} row */
    look(row) {
        this.design = row;
        this.tell("selection");
    }

    /** @param {number} which 0 across, 1 up @param {number} column */
    chooseAxis(which, column) {
        this.axes[which] = column;
        this.tell("axes");
    }
}

/** @param {number[]} values @param {number} wanted */
export function nearest(values, wanted) {
    let best = 0;
    values.forEach((value, k) => {
        if (Math.abs(value - wanted) < Math.abs(values[best] - wanted)) best = k;
    });
    return best;
}

/** Four digits, a dash for what is not there. @param {number | null | undefined} value */
export const shown = (value) => (value === null || value === undefined ? "–" : String(Number(value.toPrecision(4))));

/** A name as it is said; abbreviations in capitals. @param {string} name */
export const words = (name) => name.replaceAll("_", " ").replace(/^(lti|lci|iti|oti|gie|rms)\b/, (short) => short.toUpperCase());

/** Lowest and highest of what is there. @param {(number | null)[]} values @returns {[number, number]} */
export function range(values) {
    const known = values.filter((value) => value !== null).sort((a, b) => a - b);
    if (!known.length) return [0, 1];
    const low = known[0], high = known[known.length - 1];
    return high > low ? [low, high] : [low - Math.abs(low || 1) / 2, high + Math.abs(high || 1) / 2];
}

/** Between which the middle 98 % are: a few poses beside a singularity must not take all colours.
 * @param {(number | null)[]} values @returns {[number, number]} */
export function middle(values) {
    const known = values.filter((value) => value !== null).sort((a, b) => a - b);
    if (known.length < 50) return range(values);
    const low = known[Math.floor(0.01 * (known.length - 1))], high = known[Math.ceil(0.99 * (known.length - 1))];
    return high > low ? [low, high] : range(values);
}

/** A colour of the page. @param {string} name */
export function colour(name) {
    const probe = document.createElement("i");
    probe.style.color = `var(--${name})`;
    document.body.append(probe);
    const found = getComputedStyle(probe).color;
    probe.remove();
    return found;
}

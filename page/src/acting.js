// Fields for what acts on a machine or a robot: gravity, and a force and a moment from outside.
import { choose, make, mark, write } from "./make.js";
import { fixed } from "./units.js";

/** @typedef {import("./types").State} State */
/**
 * Where gravity is kept: the file's, and what it is instead.
 * @typedef {{own: () => ArrayLike<number> | null, now: () => number[] | null | undefined, set: (vector: number[] | undefined) => void}} Gravity
 */

const EARTH = 9.80665;
/** Choices with their names, and what they make of the file's gravity. @type {Record<string, [string, (own: number[]) => number[]]>} */
const GRAVITIES = {
    none: ["none", () => [0, 0, 0]],
    moon: ["Moon, 1.62 m/s²", (own) => along(own, 1.62)],
    mars: ["Mars, 3.73 m/s²", (own) => along(own, 3.73)],
    x: ["base tilted about x", () => []],
    y: ["base tilted about y", () => []],
    over: ["base upside down", (own) => own.map((x) => 0 - x)],
};

/** @param {number[]} own @param {number} size */
const along = (own, size) => own.map((x) => (x / Math.hypot(...own)) * size);

/** What gravity is in a base that is tilted. @param {number[]} own @param {string} axis @param {number} degrees */
function tilted([x, y, z], axis, degrees) {
    const turn = (degrees * Math.PI) / 180, [sin, cos] = [Math.sin(turn), Math.cos(turn)];
    return axis === "x" ? [x, y * cos + z * sin, z * cos - y * sin] : [x * cos - z * sin, y, z * cos + x * sin];
}

/** @param {State} state @param {Gravity} kept */
export function gravityField(state, { own, now, set }) {
    let chosen = "file", angle = 30, fault = "";
    const select = make("select", { name: "gravity" });
    const box = make("input", { type: "number", min: "-180", max: "180", step: "5", value: "30", "aria-label": "Tilt of the base in degrees" });
    const tilt = make("span", {}, box, " °");
    const take = () => {
        const given = own();
        if (!given || chosen === "set") return;
        const vector = Array.from(given).some((x) => x !== 0) ? Array.from(given) : [0, 0, -EARTH];
        set(chosen === "x" || chosen === "y" ? tilted(vector, chosen, angle) : GRAVITIES[chosen]?.[1](vector));
    };
    select.addEventListener("change", () => {
        chosen = select.value;
        fault = "";
        take();
        state.set({});
    });
    box.addEventListener("input", () => {
        const value = box.valueAsNumber, far = Math.abs(value) > 360;
        fault = far ? `The tilt of the base: expected within ±360°, got ${Number(value.toPrecision(6))}°. ${angle}° is kept.` : "";
        if (Number.isFinite(value) && !far) {
            angle = value;
            take();
        }
        state.set({});
    });
    box.addEventListener("blur", () => state.set({}));
    const told = make("span", { className: "note", role: "status" });
    const row = make("label", { className: "field" }, "Gravity ", select, tilt, told);
    return {
        row,
        show() {
            const vector = now();
            if (!vector) chosen = "file"; // or of the run that was kept
            else if (chosen === "file") chosen = "set"; // not by this list
            /** @type {[string, string][]} */
            const choices = Object.entries(GRAVITIES).map(([key, [label]]) => [key, label]);
            choose(select, [["file", "as in the file"], ...choices, .../** @type {[string, string][]} */ (chosen === "set" ? [["set", "as set"]] : [])], chosen);
            tilt.hidden = chosen !== "x" && chosen !== "y";
            if (tilt.hidden) fault = "";
            const focused = box === document.activeElement;
            if (!focused && !fault && box.valueAsNumber !== angle) box.value = String(angle);
            mark(box, fault !== "" || (focused && box.validity.badInput));
            told.classList.toggle("alarm", fault !== "");
            row.classList.toggle("changed", Boolean(vector));
            write(told, fault || (tilt.hidden || !vector) ? fault : `(${vector.map((x) => fixed(x, 2)).join(", ")}) m/s²`);
        },
    };
}

const WRENCH = ["Fx", "Fy", "Fz", "Mx", "My", "Mz"];

/**
 * @param {State} state @param {string} title
 * @param {{now: () => number[] | undefined, changed: () => boolean, set: (wrench: number[]) => void}} kept force [N] and moment [N m]
 */
export function wrenchFields(state, title, { now, changed, set }) {
    const boxes = WRENCH.map((name, k) => {
        const box = make("input", { type: "number", step: "any", value: "0", "aria-label": `${name} [${k < 3 ? "N" : "N m"}]` });
        box.addEventListener("input", () => {
            const before = now();
            mark(box, box.validity.badInput);
            set(boxes.map((one, i) => (Number.isFinite(one.valueAsNumber) ? one.valueAsNumber : before?.[i] ?? 0)));
        });
        box.addEventListener("blur", () => state.set({}));
        return box;
    });
    const grid = make("div", { className: "wrench" }, ...boxes.map((box, k) => make("label", {}, `${WRENCH[k]} `, box)));
    const row = make("details", {}, make("summary", {}, title), grid);
    return {
        row,
        show() {
            const values = now();
            boxes.forEach((box, k) => {
                const value = values?.[k] ?? 0;
                if (box === document.activeElement) return;
                mark(box, false);
                if (box.valueAsNumber !== value) box.value = String(value);
            });
            row.classList.toggle("changed", changed());
        },
    };
}

// Documents for the tests, made by hand.

/** @param {number[]} shape @param {ArrayLike<number>} numbers */
export function table(shape, numbers) {
    const bytes = Buffer.from(Float64Array.from(numbers).buffer);
    return { shape, dtype: "float64", base64: bytes.toString("base64") };
}

const STILL = [0, 0, 0, 0, 0, 0, 1];

/** A carriage on a vertical rail, with a wheel on it; three samples. */
export const carriage = () => ({
    format: 1,
    title: "A carriage",
    scene: {
        centre: [0, 0, 0], radius: 1, floor: -1,
        joints: [
            { name: "rail", parent: -1, placement: [0, 1, 0, 0, 0, 0, 1], kind: "prismatic", axis: [0, 0, 1], q: [0, 1] },
            { name: "wheel", parent: 0, placement: [0.5, 0, 0, 0, 0, 0, 1], kind: "continuous", axis: [1, 0, 0], q: [1, 2] },
        ],
        solids: [{ name: "body", joint: 0, placement: STILL, shape: { kind: "box", size: [0.2, 0.2, 0.2] }, colour: "#0b6aa8", opacity: 1, layer: "frame" }],
        labels: [{ text: "A", at: [0, 1, 1], joint: -1, height: 0.1 }],
        lines: [],
        layers: [{ name: "frame", label: "frame", shown: true }],
    },
    runs: [{
        name: "up", time: table([3], [0, 1, 3]), q: table([3, 3], [0, 1, 0, 2, 0, 1, 4, -1, 0]),
        curves: [{ key: "force", label: "A", group: "Actuator forces", unit: "N", values: table([3], [10, 20, NaN]) }],
        loads: [{ key: "force", label: "A", kind: "force", joint: 0, point: [0, 0, 0.1], frame: "world", direction: [0, 0, 1], curve: "force", group: "actuator", unit: "N" }],
        notes: [],
    }],
});

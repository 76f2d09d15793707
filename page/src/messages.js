// What Python and the page tell each other: JSON, and behind it the numbers of its arrays as they are in memory.
// "P3D1", the length of the JSON (uint32, little endian), the JSON padded to a multiple of 8, the arrays.

const MAGIC = 0x31443350;

/**
 * Unpack a message: every array becomes {shape, dtype, bytes}.
 * @param {ArrayBuffer} buffer
 * @returns {any}
 */
export function unpacked(buffer) {
    const view = new DataView(buffer);
    if (buffer.byteLength < 8 || view.getUint32(0, true) !== MAGIC) throw new Error("this is no message of p3dof");
    const start = 8 + view.getUint32(4, true);
    const message = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 8, start - 8)));
    return filled(message, buffer, start);
}

const SIZES = /** @type {Record<string, number>} */ ({
    float64: 8, float32: 4, int32: 4, uint32: 4, int16: 2, uint16: 2, int8: 1, uint8: 1,
});

/** @param {any} value @param {ArrayBuffer} buffer @param {number} start @returns {any} */
function filled(value, buffer, start) {
    if (value === null || typeof value !== "object") return value;
    if (Array.isArray(value)) return value.map((item) => filled(item, buffer, start));
    if ("offset" in value && "dtype" in value) {
        const count = value.shape.reduce((/** @type {number} */ a, /** @type {number} */ b) => a * b, 1);
        const from = start + value.offset;
        const bytes = new Uint8Array(buffer.slice(from, from + count * SIZES[value.dtype]));
        return { shape: value.shape, dtype: value.dtype, bytes };
    }
    return Object.fromEntries(Object.entries(value).map(([key, item]) => [key, filled(item, buffer, start)]));
}

// What Python and the page tell each other: JSON, and behind it the numbers of its arrays as they are in memory.
// "P3D1", the length of the JSON (uint32, little endian), the JSON padded to a multiple of 8, the arrays.

import { DocumentError } from "./document.js";

const MAGIC = 0x31443350;

/**
 * Unpack a message: every array becomes {shape, dtype, bytes}.
 * @param {ArrayBuffer} buffer
 * @returns {any}
 */
export function unpacked(buffer) {
    const view = new DataView(buffer), start = buffer.byteLength < 8 ? 0 : 8 + view.getUint32(4, true);
    if (!start || view.getUint32(0, true) !== MAGIC || start > buffer.byteLength) throw new DocumentError("this is no message of p3dof");
    let message;
    try {
        message = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 8, start - 8)));
    } catch (error) {
        throw new DocumentError(`this is no message of p3dof: ${/** @type {Error} */ (error).message}`);
    }
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
        const { shape, dtype, offset } = value;
        const length = Array.isArray(shape) && Object.hasOwn(SIZES, dtype) ? shape.reduce((a, b) => a * b, SIZES[dtype]) : NaN;
        const fits = Number.isSafeInteger(length) && Number.isSafeInteger(offset) && length >= 0 && offset >= 0;
        if (!fits || start + offset + length > buffer.byteLength) throw new DocumentError("a message with an array that is not in it");
        return { shape, dtype, bytes: new Uint8Array(buffer.slice(start + offset, start + offset + length)) };
    }
    return Object.fromEntries(Object.entries(value).map(([key, item]) => [key, filled(item, buffer, start)]));
}

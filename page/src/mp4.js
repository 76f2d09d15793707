// Encoded pictures as an MP4 file: one track, one picture after the other, all of the same length.

/** @typedef {{data: Uint8Array, key: boolean}} Sample */
/** @typedef {{width: number, height: number, rate: number, codec: string, description: Uint8Array | null}} Track */

const TICKS = 1000;

/** @param {number} value @param {number} size bytes @returns {number[]} */
function integer(value, size) {
    return Array.from({ length: size }, (_, i) => Math.floor(value / 256 ** (size - 1 - i)) % 256);
}
/** @param {...number} values */
const u32 = (...values) => values.flatMap((value) => integer(value, 4));
/** @param {...number} values */
const u16 = (...values) => values.flatMap((value) => integer(value, 2));
/** @param {string} text */
const ascii = (text) => [...text].map((letter) => letter.charCodeAt(0));
const MATRIX = u32(0x10000, 0, 0, 0, 0x10000, 0, 0, 0, 0x40000000);

/** @param {string} name @param {...(ArrayLike<number>)} parts @returns {Uint8Array} */
function box(name, ...parts) {
    const size = 8 + parts.reduce((sum, part) => sum + part.length, 0);
    const bytes = new Uint8Array(size);
    bytes.set(u32(size), 0);
    bytes.set(ascii(name), 4);
    let at = 8;
    for (const part of parts) {
        bytes.set(part, at);
        at += part.length;
    }
    return bytes;
}
/** @param {string} name @param {number} flags @param {...(ArrayLike<number>)} parts */
const full = (name, flags, ...parts) => box(name, u32(flags), ...parts);

/**
 * @param {Track} track
 * @param {Sample[]} samples
 * @returns {Uint8Array<ArrayBuffer>}
 */
export function mp4(track, samples) {
    const start = box("ftyp", ascii("isom"), u32(512), ascii("isomiso2avc1mp41"));
    const media = box("mdat", ...samples.map(({ data }) => data));
    const offset = start.length + 8;
    const length = samples.length * TICKS;
    const scale = Math.round(track.rate * TICKS);
    const movie = box("moov",
        full("mvhd", 0, u32(0, 0, scale, length, 0x10000), u16(0x100, 0), u32(0, 0), MATRIX, u32(0, 0, 0, 0, 0, 0, 2)),
        box("trak",
            full("tkhd", 3, u32(0, 0, 1, 0, length, 0, 0), u16(0, 0, 0, 0), MATRIX, u32(track.width * 65536, track.height * 65536)),
            box("mdia",
                full("mdhd", 0, u32(0, 0, scale, length), u16(0x55c4, 0)),
                full("hdlr", 0, u32(0), ascii("vide"), u32(0, 0, 0), ascii("pictures\0")),
                box("minf",
                    full("vmhd", 1, u16(0, 0, 0, 0)),
                    box("dinf", full("dref", 0, u32(1), full("url ", 1))),
                    table(track, samples, offset)))));
    const file = new Uint8Array(start.length + media.length + movie.length);
    file.set(start, 0);
    file.set(media, start.length);
    file.set(movie, start.length + media.length);
    return file;
}

/** @param {Track} track @param {Sample[]} samples @param {number} offset of the first one in the file */
function table(track, samples, offset) {
    const keys = samples.flatMap(({ key }, i) => (key ? [i + 1] : []));
    return box("stbl",
        full("stsd", 0, u32(1), entry(track)),
        full("stts", 0, u32(1, samples.length, TICKS)),
        full("stss", 0, u32(keys.length, ...keys)),
        full("stsc", 0, u32(1, 1, samples.length, 1)),
        full("stsz", 0, u32(0, samples.length), samples.flatMap(({ data }) => u32(data.length))),
        full("stco", 0, u32(1, offset)));
}

/** @param {Track} track */
function entry({ width, height, codec, description }) {
    const name = codec.slice(0, 4);
    const common = [...u32(0), ...u16(0, 1), ...u16(0, 0), ...u32(0, 0, 0), ...u16(width, height),
        ...u32(0x480000, 0x480000, 0), ...u16(1), ...new Array(32).fill(0), ...u16(24, 0xffff)];
    if (name === "avc1") return box("avc1", common, box("avcC", description ?? []));
    const [profile, level, depth] = codec.split(".").slice(1).map(Number);
    return box("vp09", common, full("vpcC", 0x1000000, [profile, level, (depth << 4) | 2, 1, 1, 1], u16(0)));
}

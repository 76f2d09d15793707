// The motion as a film, picture by picture: what is at the instant of each, however long drawing it takes.
import { GIFEncoder, applyPalette, quantize } from "gifenc";
import { runOf } from "./instant.js";
import { mp4 } from "./mp4.js";
import { within } from "./state.js";
import { clock } from "./units.js";

/** @typedef {import("./types").State} State */
/** @typedef {{cancelled: boolean, progress: (share: number) => void}} Job */
/** @typedef {{instants: number[], width: number, height: number, rate: number}} Plan */

/** What a film may have at most. */
export const MOST = 1500;
const CODECS = ["avc1.640033", "avc1.4d0033", "avc1.420033", "avc1.42001f", "vp09.00.51.08"];
const GIF_WIDTH = 720;

/**
 * Instants of the pictures: the whole run at the speed of the time bar.
 * @param {ArrayLike<number>} time of the run
 * @param {number} speed
 * @param {number} rate pictures a second
 * @returns {number[]}
 */
export function instantsOf(time, speed, rate) {
    const [start, end] = [time[0], time[time.length - 1]];
    const count = Math.max(1, Math.round(((end - start) / speed) * rate) + 1);
    if (count > MOST) throw new Error(`the film would have ${count} pictures, more than ${MOST}: choose a higher speed in the time bar`);
    return Array.from({ length: count }, (_, i) => (i === count - 1 ? end : Math.min(end, start + (i * speed) / rate)));
}

/** @param {State} state @param {number} rate @param {number} [widest] @returns {Plan} */
function planOf(state, rate, widest = 1920) {
    if (!state.stage) throw new Error("there is no 3D picture in this browser to make a film of");
    state.stage.refine(); // as its pictures will be
    const { canvas } = state.stage;
    const share = Math.min(1, widest / canvas.width);
    const even = (/** @type {number} */ size) => Math.max(2, 2 * Math.round((size * share) / 2));
    return { instants: instantsOf(runOf(state).time.data, state.speed, rate), width: even(canvas.width), height: even(canvas.height), rate };
}

/**
 * Draw each picture and hand it on; then what was shown before is shown again.
 * @param {State} state
 * @param {Plan} plan
 * @param {Job} job
 * @param {(canvas: HTMLCanvasElement, index: number) => unknown} take
 * @param {number[]} [only] indices of the pictures; all by default
 */
async function each(state, plan, job, take, only = plan.instants.map((_, i) => i)) {
    const { time, playing, hand } = state;
    const canvas = document.createElement("canvas");
    [canvas.width, canvas.height] = [plan.width, plan.height];
    try {
        for (const index of only) {
            if (job.cancelled) return;
            state.set({ time: within(state, plan.instants[index]), playing: false, hand: null, hover: null });
            state.refresh();
            draw(canvas, state);
            await take(canvas, index);
            job.progress((index + 1) / plan.instants.length);
            await pause();
        }
    } finally {
        state.set({ time, playing, hand });
    }
}

/** Let the page answer. @returns {Promise<void>} */
function pause() {
    return new Promise((done) => {
        const { port1, port2 } = new MessageChannel();
        port1.onmessage = () => done();
        port2.postMessage(0);
    });
}

/** The 3D picture as it is now, with the time. @param {HTMLCanvasElement} canvas @param {State} state */
export function draw(canvas, state) {
    const to = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d", { willReadFrequently: true }));
    const { stage } = state;
    const handles = stage.contents.handles?.group;
    const parent = handles?.parent;
    handles?.removeFromParent(); // what the hand takes hold of is for the hand
    try {
        stage.refine(); // what WebGL drew can only be read in the same task
        to.drawImage(stage.canvas, 0, 0, canvas.width, canvas.height);
    } finally {
        parent?.add(handles);
        stage.redraw();
    }
    const size = Math.max(11, Math.round(canvas.height / 28));
    to.font = `600 ${size}px system-ui, "DejaVu Sans", sans-serif`;
    to.fillStyle = getComputedStyle(document.documentElement).getPropertyValue("--ink") || "#16202b";
    to.fillText(clock(state.time), size, canvas.height - size);
}

/**
 * @param {State} state
 * @param {Job} job
 * @returns {Promise<Blob | null>} null when it was cancelled
 */
export async function gif(state, job) {
    const plan = planOf(state, 25, GIF_WIDTH);
    const encoder = GIFEncoder();
    const last = plan.instants.length - 1;
    /** @type {Uint8Array[]} */
    const some = [];
    const quiet = { ...job, progress: () => {}, get cancelled() { return job.cancelled; } };
    await each(state, plan, quiet, (canvas) => some.push(pixels(canvas)), [...new Set([0, last >> 1, last])]);
    const palette = quantize(joined(some), 256);
    await each(state, plan, job, (canvas, index) => {
        const picture = applyPalette(pixels(canvas), palette);
        encoder.writeFrame(picture, plan.width, plan.height, { palette: index ? undefined : palette, delay: 1000 / plan.rate, repeat: 0 });
    });
    if (job.cancelled) return null;
    encoder.finish();
    return new Blob([/** @type {Uint8Array<ArrayBuffer>} */ (encoder.bytes())], { type: "image/gif" });
}

/** @param {HTMLCanvasElement} canvas @returns {Uint8Array} */
function pixels(canvas) {
    const from = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
    return new Uint8Array(from.getImageData(0, 0, canvas.width, canvas.height).data.buffer);
}

/** @param {Uint8Array[]} parts */
function joined(parts) {
    const all = new Uint8Array(parts.reduce((sum, part) => sum + part.length, 0));
    parts.reduce((at, part) => (all.set(part, at), at + part.length), 0);
    return all;
}

/** Whether this browser encodes films. */
export const canEncode = () => typeof VideoEncoder === "function";

/** @param {Plan} plan @returns {Promise<VideoEncoderConfig>} */
async function configOf({ width, height, rate }) {
    for (const codec of CODECS) {
        /** @type {VideoEncoderConfig} */
        const config = { codec, width, height, framerate: rate, bitrate: 6 * width * height, latencyMode: "realtime" };
        if (codec.startsWith("avc1")) config.avc = { format: "avc" };
        if ((await VideoEncoder.isConfigSupported(config).catch(() => null))?.supported) return config;
    }
    throw new Error("this browser encodes neither H.264 nor VP9: take the GIF");
}

/**
 * @param {State} state
 * @param {Job} job
 * @returns {Promise<Blob | null>} null when it was cancelled
 */
export async function video(state, job) {
    const plan = planOf(state, 30);
    const config = await configOf(plan);
    /** @type {import("./mp4").Sample[]} */
    const samples = [];
    /** @type {Uint8Array | null} */
    let description = null;
    /** @type {unknown} */
    let fault = null;
    const encoder = new VideoEncoder({
        output(chunk, metadata) {
            const data = new Uint8Array(chunk.byteLength);
            chunk.copyTo(data);
            samples.push({ data, key: chunk.type === "key" });
            const found = metadata?.decoderConfig?.description;
            if (found) description = bytesOf(found);
        },
        error: (error) => void (fault = error),
    });
    encoder.configure(config);
    await each(state, plan, job, async (canvas, index) => {
        if (fault) throw fault;
        const frame = new VideoFrame(canvas, { timestamp: Math.round((1e6 * index) / plan.rate), duration: Math.round(1e6 / plan.rate) });
        encoder.encode(frame, { keyFrame: index % 60 === 0 });
        frame.close();
        while (encoder.encodeQueueSize > 4) await new Promise((done) => encoder.addEventListener("dequeue", done, { once: true }));
    });
    if (!job.cancelled) await encoder.flush();
    if (encoder.state !== "closed") encoder.close();
    if (fault) throw fault;
    if (job.cancelled) return null;
    return new Blob([mp4({ ...plan, codec: config.codec, description }, samples)], { type: "video/mp4" });
}

/** @param {AllowSharedBufferSource} source */
function bytesOf(source) {
    return ArrayBuffer.isView(source) ? new Uint8Array(source.buffer, source.byteOffset, source.byteLength).slice() : new Uint8Array(source).slice();
}

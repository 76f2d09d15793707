// Play, pause, step, loop, speed; and the track, which has the width of the charts' axis of time.
import { stepFrom } from "./curves.js";
import { runOf } from "./instant.js";
import { shownSpan, wholeSpan } from "./lines.js";
import { make, write } from "./make.js";
import { mount as splitter } from "./splitter.js";
import { within } from "./state.js";
import { clock } from "./units.js";

/** @typedef {import("./types").State} State */

export const SPEEDS = [0.05, 0.1, 0.25, 0.5, 1, 2, 4];

/** Go to another sample, and stay there. @param {State} state @param {number} count how many samples; negative: back */
export function step(state, count) {
    seek(state, stepFrom(runOf(state).time.data, state.time, count));
}

/** Go to an instant, and stay there. @param {State} state @param {number} time [s] */
export function seek(state, time) {
    state.set({ time: within(state, time), playing: false, hand: null });
}

/** @param {State} state */
export const toggle = (state) => state.set({ playing: !state.playing });

/** @param {HTMLElement} element @param {State} state */
export function mount(element, state) {
    /** @param {string} label @param {string} sign @param {() => void} act @param {string} [key] */
    const button = (label, sign, act, key) => make("button", {
        type: "button", className: "sign", "aria-label": label, title: key ? `${label} (${key})` : label, onclick: act,
    }, sign);
    const play = button("Play", "▶", () => toggle(state), "space");
    const track = make("input", { type: "range", className: "track", step: "any", "aria-label": "Time" });
    const back = button("One sample back", "❘◀", () => step(state, -1), "←");
    const forth = button("One sample forward", "▶❘", () => step(state, 1), "→");
    const loop = button("Loop", "⟳", () => state.set({ loop: !state.loop }), "L");
    const speed = make("select", { "aria-label": "Speed", title: "Speed (− and +)" },
        ...SPEEDS.map((value) => make("option", { value: String(value) }, `${value}×`)));
    const time = make("output", { className: "time" });

    track.addEventListener("input", () => seek(state, Number(track.value)));
    speed.addEventListener("change", () => state.set({ speed: Number(speed.value) }));
    element.append(
        make("div", { className: "play" }, play),
        make("div", { className: "track-room" }, track),
        make("div", { className: "controls" }, back, forth, loop, speed, time),
    );

    splitter(element);

    state.subscribe((_, changed) => {
        const [start, end] = wholeSpan(state);
        if (track.max !== String(end)) track.max = String(end);
        if (track.min !== String(start)) track.min = String(start);
        track.value = String(state.time);
        const { data } = runOf(state).time;
        const text = clock(state.time, (data[data.length - 1] - data[0]) / Math.max(1, data.length - 1));
        write(time, text);
        track.setAttribute("aria-valuetext", `${text} of ${clock(end)}`);
        /** @param {number} instant */
        const share = (instant) => `${(100 * (instant - start)) / (end - start)}%`;
        track.style.setProperty("--share", share(state.time));
        if (changed.has("zoom") || changed.has("document") || changed.has("run") || changed.has("solved")) {
            const [from, to] = shownSpan(state);
            track.style.setProperty("--from", share(from));
            track.style.setProperty("--to", share(to));
            track.classList.toggle("zoomed", state.zoom !== null);
        }
        write(play, state.playing ? "❚❚" : "▶");
        play.setAttribute("aria-label", state.playing ? "Pause" : "Play");
        loop.setAttribute("aria-pressed", String(state.loop));
        if (!SPEEDS.includes(state.speed)) addSpeed(speed, state.speed);
        speed.value = String(state.speed);
    });
}

/** @param {HTMLSelectElement} select @param {number} speed one that a script set */
function addSpeed(select, speed) {
    if (![...select.options].some(({ value }) => value === String(speed))) {
        select.append(make("option", { value: String(speed) }, `${speed}×`));
    }
}

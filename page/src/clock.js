// Lets time go on while the page plays.
import { within } from "./state.js";
import { runOf } from "./instant.js";

/** @param {import("./types").State} state */
export function mount(state) {
    let last = 0;
    let going = false;

    /** @param {number} now [ms] */
    function step(now) {
        going = state.playing;
        if (!going) return;
        const { data } = runOf(state).time;
        const end = data[data.length - 1];
        let time = state.time + (last ? ((now - last) / 1000) * state.speed : 0);
        last = now;
        if (time >= end && state.loop && end > data[0]) time = data[0] + ((time - end) % (end - data[0]));
        state.set({ time: within(state, time), playing: state.loop || time < end });
        requestAnimationFrame(step);
    }

    state.subscribe((_, changed) => {
        if (!changed.has("playing") || !state.playing || going) return;
        const { data } = runOf(state).time;
        if (state.time >= data[data.length - 1]) state.set({ time: data[0] }); // again from the start
        if (state.hand) state.set({ hand: null });
        [going, last] = [true, 0];
        requestAnimationFrame(step);
    });
}

// Waypoints, and the fastest motion through them.
/** @param {HTMLElement} element @param {import("./types").State} state */
export function mount(element, state) {
    void element, state;
}

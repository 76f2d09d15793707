// The workspace map of the present tilt.
/** @param {HTMLElement} element @param {import("./types").State} state */
export function mount(element, state) {
    void element, state;
}

// The machine in 3D.
/** @param {HTMLElement} element @param {import("./types").State} state */
export function mount(element, state) {
    void element, state;
}

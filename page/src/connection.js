// A Python behind the page.
/** @param {HTMLElement} element @param {import("./types").State} state */
export function mount(element, state) {
    void element, state;
}

// Forces with other parameters than the document's.
/** @param {HTMLElement} element @param {import("./types").State} state */
export function mount(element, state) {
    void element, state;
}

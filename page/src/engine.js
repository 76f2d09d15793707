// The forces in the page: the generated C as WebAssembly.

/** Load the engine of a document; null where it has none. */
/** @param {import("./types").Document} document @param {string} wasm base64 @returns {Promise<any>} */
export async function load(document, wasm) {
    void document, wasm;
    return null;
}

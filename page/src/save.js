// Files out of the page.
import { make } from "./make.js";

/**
 * Offer a file to be kept.
 * @param {string} name
 * @param {Blob | string} content
 * @param {string} [type] of a text
 */
export function save(name, content, type = "text/plain") {
    const blob = typeof content === "string" ? new Blob([content], { type: `${type};charset=utf-8` }) : content;
    const url = URL.createObjectURL(blob);
    const link = make("a", { href: url, download: name, hidden: true });
    document.body.append(link);
    link.click();
    link.remove();
    setTimeout(() => URL.revokeObjectURL(url), 60_000); // the browser may still be reading it
}

/** A name that any system takes. @param {string} text @returns {string} */
export function fileName(text) {
    return text.normalize("NFKD").replace(/[^\w.-]+/g, "-").replace(/^[-.]+|[-.]+$/g, "").toLowerCase() || "p3dof";
}

/** @param {HTMLCanvasElement} canvas @returns {Promise<Blob>} a PNG */
export function pngOf(canvas) {
    return new Promise((done, failed) => canvas.toBlob(
        (blob) => (blob ? done(blob) : failed(new Error("the picture is too large for this browser"))), "image/png"));
}

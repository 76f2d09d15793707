// Light, dark, or as the system is; and colours that can be read on either.

/** @typedef {import("./types").State} State */

const GROUNDS = { light: [255, 255, 255], dark: [27, 33, 40] };

/** Which of the two is shown. @param {State["theme"]} theme @returns {"light" | "dark"} */
export function resolved(theme) {
    if (theme !== "auto") return theme;
    return globalThis.matchMedia?.("(prefers-color-scheme: dark)").matches ? "dark" : "light";
}

/** @param {number[]} rgb of 255 each @returns {number} relative luminance as WCAG 2 defines it */
export function luminance(rgb) {
    const [r, g, b] = rgb.map((part) => {
        const share = part / 255;
        return share <= 0.04045 ? share / 12.92 : ((share + 0.055) / 1.055) ** 2.4;
    });
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
}

/** @param {number[]} a @param {number[]} b @returns {number} contrast, 1 to 21 */
export function contrast(a, b) {
    const [low, high] = [luminance(a), luminance(b)].sort((x, y) => x - y);
    return (high + 0.05) / (low + 0.05);
}

/** @param {string} hex #rrggbb @returns {number[]} */
export function rgbOf(hex) {
    const digits = /^#([0-9a-f]{2})([0-9a-f]{2})([0-9a-f]{2})$/i.exec(hex);
    return digits ? digits.slice(1).map((pair) => parseInt(pair, 16)) : [128, 128, 128];
}

/** @type {Map<string, string>} */
const known = new Map();

/**
 * A colour with enough contrast for lines and text: mixed with black or white as far as needed.
 * @param {string} hex #rrggbb
 * @param {"light" | "dark"} theme
 * @returns {string} #rrggbb
 */
export function readable(hex, theme) {
    const name = `${hex} ${theme}`;
    let found = known.get(name);
    if (!found) known.set(name, (found = mixed(rgbOf(hex), theme)));
    return found;
}

/** @param {number[]} rgb @param {"light" | "dark"} theme */
function mixed(rgb, theme) {
    const ground = GROUNDS[theme];
    const end = theme === "dark" ? 255 : 0;
    let best = rgb;
    for (let share = 0; share <= 1; share += 0.05) {
        best = rgb.map((part) => Math.round(part + share * (end - part)));
        if (contrast(best, ground) >= 4.6) break;
    }
    return `#${best.map((part) => part.toString(16).padStart(2, "0")).join("")}`;
}

/** @param {HTMLElement} _element @param {State} state */
export function mount(_element, state) {
    const root = document.documentElement;
    const show = () => {
        const theme = resolved(state.theme);
        if (root.dataset.theme !== theme) root.dataset.theme = theme;
    };
    show();
    state.subscribe((_, changed) => changed.has("theme") && show());
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => state.set({ theme: state.theme }));
}

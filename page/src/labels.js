// Texts in the scene that always face the eye.
import { CanvasTexture, LinearFilter, Sprite, SpriteMaterial, SRGBColorSpace } from "three";

const SIZE = 44; // pixels of a letter in the texture
const FONT = `600 ${SIZE}px system-ui, sans-serif`;

/** A text; `write` changes it, and costs nothing when it stays the same. */
export class Text {
    /** @param {string} [text] @param {string} [colour] */
    constructor(text = "", colour = "#16202b") {
        this.canvas = document.createElement("canvas");
        this.canvas.width = this.canvas.height = 1;
        this.material = new SpriteMaterial({ transparent: true, depthTest: false, depthWrite: false });
        this.sprite = new Sprite(this.material);
        this.sprite.renderOrder = 10;
        /** Width over height. */
        this.aspect = 1;
        this.text = "";
        this.colour = "";
        this.halo = "";
        this.write(text, colour);
    }

    /** @param {string} text @param {string} [colour] @param {string} [halo] colour around the letters */
    write(text, colour = this.colour, halo = this.halo) {
        if (text === this.text && colour === this.colour && halo === this.halo) return;
        [this.text, this.colour, this.halo] = [text, colour, halo];
        const context = /** @type {CanvasRenderingContext2D} */ (this.canvas.getContext("2d"));
        context.font = FONT;
        const width = Math.ceil((context.measureText(text || " ").width + 16) / 32) * 32;
        const height = SIZE + 16;
        const grown = width !== this.canvas.width || height !== this.canvas.height;
        if (grown) [this.canvas.width, this.canvas.height] = [width, height];
        context.clearRect(0, 0, width, height);
        context.font = FONT;
        context.textAlign = "center";
        context.textBaseline = "middle";
        if (halo) {
            context.lineJoin = "round";
            context.lineWidth = 9;
            context.strokeStyle = halo;
            context.strokeText(text, width / 2, height / 2 + 3);
        }
        context.fillStyle = colour;
        context.fillText(text, width / 2, height / 2 + 3);
        if (grown || !this.material.map) {
            this.material.map?.dispose();
            this.material.map = new CanvasTexture(this.canvas);
            this.material.map.colorSpace = SRGBColorSpace;
            this.material.map.generateMipmaps = false;
            this.material.map.minFilter = LinearFilter;
            this.material.needsUpdate = true;
        } else {
            this.material.map.needsUpdate = true;
        }
        this.aspect = width / height;
    }

    /** Make the letters so high. @param {number} height */
    resize(height) {
        const all = (height * (SIZE + 16)) / SIZE;
        this.sprite.scale.set(all * this.aspect, all, 1);
    }
}

/** A force or the like in three digits, or a few more, with its unit. @param {number} value @param {string} unit */
export function shown(value, unit) {
    if (!Number.isFinite(value)) return "undetermined";
    const size = Math.abs(value);
    const digits = size === 0 ? "0" : size >= 1e5 || (size > 0 && size < 1e-3) ? value.toExponential(2)
        : size >= 100 ? value.toFixed(0) : size >= 1 ? value.toFixed(1) : value.toFixed(3);
    return `${digits.replace("-", "−")} ${unit}`;
}

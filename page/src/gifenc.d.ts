declare module "gifenc" {
    export function GIFEncoder(): {
        writeFrame(picture: Uint8Array, width: number, height: number, options: object): void;
        finish(): void;
        bytes(): Uint8Array;
    };
    export function quantize(rgba: Uint8Array, colours: number): number[][];
    export function applyPalette(rgba: Uint8Array, palette: number[][]): Uint8Array;
}

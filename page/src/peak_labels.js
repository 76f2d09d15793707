// Where the labels of peaks stand: beside their dots, inside the plot, on no other label and no other dot.

/** @typedef {{x: number, y: number, width: number, height: number}} Box */
/** @typedef {{x: number, y: number, width: number, height: number, up: boolean}} Wanted a dot, with the size of
 *  its label and whether it would stand above */

const GAP = 5;
const DOT = 3.5;

/**
 * @param {Box} a
 * @param {Box} b
 * @returns {number} the area they share
 */
export function shared(a, b) {
    const width = Math.min(a.x + a.width, b.x + b.width) - Math.max(a.x, b.x);
    const height = Math.min(a.y + a.height, b.y + b.height) - Math.max(a.y, b.y);
    return width > 0 && height > 0 ? width * height : 0;
}

/**
 * @param {number} value
 * @param {number} low
 * @param {number} high
 */
const within = (value, low, high) => Math.max(low, Math.min(high, value));

/**
 * Places to try for a label, the best first, all inside the plot.
 * @param {Wanted} dot
 * @param {Box} plot
 * @returns {Box[]}
 */
function places(dot, plot) {
    const { width, height } = dot;
    const above = dot.y - GAP - height;
    const below = dot.y + GAP;
    const tries = [];
    for (const far of [0, 1, 2, 3]) {
        const rows = [above - far * height, below + far * height];
        if (!dot.up) rows.reverse();
        for (const y of rows) tries.push([dot.x - width / 2, y], [dot.x - width - GAP, y], [dot.x + GAP, y]);
        const middle = dot.y - height / 2;
        if (far === 0) tries.push([dot.x - width - 2 * GAP, middle], [dot.x + 2 * GAP, middle]);
        else tries.push([dot.x - (far + 1) * width, middle], [dot.x + far * width, middle]);
    }
    return tries.map(([x, y]) => ({
        x: within(x, plot.x, plot.x + plot.width - width),
        y: within(y, plot.y, plot.y + plot.height - height),
        width,
        height,
    }));
}

/**
 * A place for each label; the one that covers least where there is no free one.
 * @param {Wanted[]} dots
 * @param {Box} plot
 * @returns {Box[]} one for each dot, in their order
 */
export function placed(dots, plot) {
    const taken = dots.map((dot) => ({ x: dot.x - DOT, y: dot.y - DOT, width: 2 * DOT, height: 2 * DOT }));
    return dots.map((dot) => {
        let best = null;
        let least = Infinity;
        for (const place of places(dot, plot)) {
            const covered = taken.reduce((sum, other) => sum + shared(place, other), 0);
            if (covered < least) {
                least = covered;
                best = place;
            }
            if (covered === 0) break;
        }
        const found = /** @type {Box} */ (best);
        taken.push(found);
        return found;
    });
}

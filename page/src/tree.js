// Where the joints of a tree are: 4x4 matrices in columns, in double precision.
/** @typedef {import("./types").Joint} Joint */

/** Write a placement as a matrix. @param {ArrayLike<number>} p x y z qx qy qz qw @param {Float64Array} [out] */
export function matrixOf(p, out = new Float64Array(16), at = 0, from = 0) {
    return composed(out, at, p[from + 3], p[from + 4], p[from + 5], p[from + 6], p[from], p[from + 1], p[from + 2]);
}

/** Multiply a by b, both at offsets; `out` may be neither. */
/** @param {Float64Array} out @param {number} o @param {Float64Array} a @param {number} i @param {Float64Array} b @param {number} j */
export function multiply(out, o, a, i, b, j) {
    for (let column = 0; column < 16; column += 4) {
        const b0 = b[j + column], b1 = b[j + column + 1], b2 = b[j + column + 2], b3 = b[j + column + 3];
        for (let row = 0; row < 4; row++) {
            out[o + column + row] = a[i + row] * b0 + a[i + 4 + row] * b1 + a[i + 8 + row] * b2 + a[i + 12 + row] * b3;
        }
    }
}

/** A point of a joint's frame in the fixed frame. @param {Float64Array} m @param {number} joint -1: the fixed frame @param {ArrayLike<number>} p @returns {number[]} */
export function pointOf(m, joint, p) {
    if (joint < 0) return [p[0], p[1], p[2]];
    const i = 16 * joint;
    return [0, 1, 2].map((k) => m[i + k] * p[0] + m[i + 4 + k] * p[1] + m[i + 8 + k] * p[2] + m[i + 12 + k]);
}

/** A direction of a joint's frame in the fixed frame. @param {Float64Array} m @param {number} joint @param {ArrayLike<number>} v @returns {number[]} */
export function directionOf(m, joint, v) {
    if (joint < 0) return [v[0], v[1], v[2]];
    const i = 16 * joint;
    return [0, 1, 2].map((k) => m[i + k] * v[0] + m[i + 4 + k] * v[1] + m[i + 8 + k] * v[2]);
}

/** A tree, ready to be placed many times. */
export class Tree {
    /** @param {Joint[]} joints parents first */
    constructor(joints) {
        this.joints = joints;
        this._fixed = new Float64Array(16 * joints.length);
        joints.forEach((joint, i) => matrixOf(joint.placement, this._fixed, 16 * i));
        this._own = new Float64Array(16);
        this._local = new Float64Array(16);
    }

    /**
     * Where all joints are.
     * @param {ArrayLike<number>} q
     * @param {((joint: Joint) => ArrayLike<number>) | null} [placed] placements in the parent of joints of kind "placed"
     * @param {Float64Array} [out] (16 joints)
     */
    place(q, placed = null, out = new Float64Array(16 * this.joints.length)) {
        this.joints.forEach((joint, i) => {
            if (joint.kind === "placed") {
                if (placed) matrixOf(placed(joint), this._local);
                else this._local.set(this._fixed.subarray(16 * i, 16 * i + 16));
            } else {
                moved(joint, q, this._own);
                multiply(this._local, 0, this._fixed, 16 * i, this._own, 0);
            }
            if (joint.parent < 0) out.set(this._local, 16 * i);
            else multiply(out, 16 * i, out, 16 * joint.parent, this._local, 0);
        });
        return out;
    }
}

/** What a joint's positions do, as a matrix. @param {Joint} joint @param {ArrayLike<number>} q @param {Float64Array} out */
function moved(joint, q, out) {
    const k = joint.q?.[0] ?? 0;
    const [x, y, z] = joint.axis ?? [0, 0, 1];
    switch (joint.kind) {
        case "revolute": return turned(out, x, y, z, Math.cos(q[k]), Math.sin(q[k]));
        case "continuous": return turned(out, x, y, z, q[k], q[k + 1]);
        case "prismatic": return composed(out, 0, 0, 0, 0, 1, x * q[k], y * q[k], z * q[k]);
        case "helical": {
            turned(out, x, y, z, Math.cos(q[k]), Math.sin(q[k]));
            const along = (joint.pitch ?? 0) * q[k];
            [out[12], out[13], out[14]] = [x * along, y * along, z * along];
            return out;
        }
        case "spherical": return composed(out, 0, q[k], q[k + 1], q[k + 2], q[k + 3], 0, 0, 0);
        case "translation": return composed(out, 0, 0, 0, 0, 1, q[k], q[k + 1], q[k + 2]);
        case "planar":
            turned(out, 0, 0, 1, q[k + 2], q[k + 3]);
            [out[12], out[13]] = [q[k], q[k + 1]];
            return out;
        case "free": return composed(out, 0, q[k + 3], q[k + 4], q[k + 5], q[k + 6], q[k], q[k + 1], q[k + 2]);
        case "universal": {
            const [u, v, w] = joint.axis2 ?? [0, 1, 0];
            const first = turned(new Float64Array(16), x, y, z, Math.cos(q[k]), Math.sin(q[k]));
            const second = turned(new Float64Array(16), u, v, w, Math.cos(q[k + 1]), Math.sin(q[k + 1]));
            multiply(out, 0, first, 0, second, 0);
            return out;
        }
        default: return composed(out, 0, 0, 0, 0, 1, 0, 0, 0);
    }
}

/** A turn about an axis. @param {Float64Array} m @param {number} x @param {number} y @param {number} z @param {number} c @param {number} s */
function turned(m, x, y, z, c, s) {
    const t = 1 - c;
    m[0] = t * x * x + c; m[1] = t * x * y + s * z; m[2] = t * x * z - s * y; m[3] = 0;
    m[4] = t * x * y - s * z; m[5] = t * y * y + c; m[6] = t * y * z + s * x; m[7] = 0;
    m[8] = t * x * z + s * y; m[9] = t * y * z - s * x; m[10] = t * z * z + c; m[11] = 0;
    m[12] = 0; m[13] = 0; m[14] = 0; m[15] = 1;
    return m;
}

/** A quaternion and a place. */
/** @param {Float64Array} m @param {number} at @param {number} x @param {number} y @param {number} z @param {number} w @param {number} px @param {number} py @param {number} pz */
function composed(m, at, x, y, z, w, px, py, pz) {
    m[at] = 1 - 2 * (y * y + z * z); m[at + 1] = 2 * (x * y + w * z); m[at + 2] = 2 * (x * z - w * y); m[at + 3] = 0;
    m[at + 4] = 2 * (x * y - w * z); m[at + 5] = 1 - 2 * (x * x + z * z); m[at + 6] = 2 * (y * z + w * x); m[at + 7] = 0;
    m[at + 8] = 2 * (x * z + w * y); m[at + 9] = 2 * (y * z - w * x); m[at + 10] = 1 - 2 * (x * x + y * y); m[at + 11] = 0;
    m[at + 12] = px; m[at + 13] = py; m[at + 14] = pz; m[at + 15] = 1;
    return m;
}

// Linear algebra of small dense matrices, stored in columns: Householder's QR with column pivoting, and Cholesky.

/** A matrix A of m rows and n columns as Q R Pᵀ, with its numerical rank. */
export class Qr {
    /**
     * @param {ArrayLike<number>} a its columns, one after the other @param {number} m @param {number} n
     * @param {number} tolerance pivots below this share of the largest count as zero @param {number} [largest] in place of that
     */
    constructor(a, m, n, tolerance, largest) {
        this.m = m;
        this.n = n;
        /** R above the diagonal, the reflections below it. */
        this.a = Float64Array.from(a);
        this.diagonal = new Float64Array(Math.min(m, n));
        this.factors = new Float64Array(Math.min(m, n));
        this.order = Array.from({ length: n }, (_, k) => k);
        this.rank = 0;
        this._factor(tolerance, largest);
    }

    /** @param {number} tolerance @param {number} [largest] */
    _factor(tolerance, largest) {
        const { m, n, a, order } = this;
        const left = new Float64Array(n);
        for (let k = 0; k < Math.min(m, n); k++) {
            let best = k;
            for (let j = k; j < n; j++) {
                let square = 0;
                for (let i = k; i < m; i++) square += a[j * m + i] ** 2;
                left[j] = square;
                if (square > left[best]) best = j;
            }
            const size = Math.sqrt(left[best]);
            const most = largest ?? (k ? Math.abs(this.diagonal[0]) : size);
            if (!(size > tolerance * most)) return;
            if (best !== k) {
                for (let i = 0; i < m; i++) [a[k * m + i], a[best * m + i]] = [a[best * m + i], a[k * m + i]];
                [order[k], order[best]] = [order[best], order[k]];
            }
            const head = a[k * m + k] > 0 ? -size : size;
            const first = a[k * m + k] - head; // v = (first, rest), H = 1 - factor v vᵀ
            a[k * m + k] = first;
            this.diagonal[k] = head;
            this.factors[k] = -1 / (head * first);
            for (let j = k + 1; j < n; j++) this._reflect(k, a, j * m);
            this.rank = k + 1;
        }
    }

    /** @param {number} k @param {Float64Array} x @param {number} at */
    _reflect(k, x, at) {
        const { m, a, factors } = this;
        let dot = 0;
        for (let i = k; i < m; i++) dot += a[k * m + i] * x[at + i];
        dot *= factors[k];
        for (let i = k; i < m; i++) x[at + i] -= dot * a[k * m + i];
    }

    /** Qᵀ x in place of x (m). @param {Float64Array} x @param {number} [at] */
    turn(x, at = 0) {
        for (let k = 0; k < this.rank; k++) this._reflect(k, x, at);
        return x;
    }

    /** Q x in place of x (m). @param {Float64Array} x @param {number} [at] */
    turnBack(x, at = 0) {
        for (let k = this.rank - 1; k >= 0; k--) this._reflect(k, x, at);
        return x;
    }

    /** An orthonormal basis of the vectors that Aᵀ takes to zero: its columns, one after the other. */
    nullSpace() {
        const { m, rank } = this, found = new Float64Array(m * (m - rank));
        for (let j = 0; j < m - rank; j++) {
            found[j * m + rank + j] = 1;
            this.turnBack(found, j * m);
        }
        return found;
    }

    /** x (n) with A x = b (m) as nearly as can be, zero where columns are redundant. @param {ArrayLike<number>} b */
    solve(b) {
        const y = this.turn(Float64Array.from(b)), found = new Float64Array(this.n);
        this._upper(y);
        for (let k = 0; k < this.rank; k++) found[this.order[k]] = y[k];
        return found;
    }

    /** The shortest x (m) with Aᵀ x = c (n), for the rows of Aᵀ that are not redundant. @param {ArrayLike<number>} c */
    solveTransposed(c) {
        const { m, a, rank, order, diagonal } = this, x = new Float64Array(m);
        for (let k = 0; k < rank; k++) {
            let value = c[order[k]];
            for (let i = 0; i < k; i++) value -= a[k * m + i] * x[i];
            x[k] = value / diagonal[k];
        }
        return this.turnBack(x);
    }

    /** The shortest x (m) that minimises |Aᵀ x - c|, of all rows of Aᵀ. @param {ArrayLike<number>} c */
    leastSquares(c) {
        const { m, n, a, rank, order, diagonal } = this;
        if (rank === n) return this.solveTransposed(c);
        const rows = new Float64Array(n * rank); // Rᵀ in columns
        for (let k = 0; k < rank; k++) {
            rows[k * n + k] = diagonal[k];
            for (let j = k + 1; j < n; j++) rows[k * n + j] = a[j * m + k];
        }
        const y = new Qr(rows, n, rank, 0).solve(order.map((row) => c[row])), x = new Float64Array(m);
        x.set(y);
        return this.turnBack(x);
    }

    /** Which entries of an x with A x = b keep their value in every solution. @param {number} tolerance */
    unique(tolerance) {
        const { m, n, rank, a, order } = this, found = new Array(n).fill(true);
        for (let j = rank; j < n; j++) {
            const y = a.slice(j * m, j * m + m);
            this._upper(y);
            let square = 1;
            for (let k = 0; k < rank; k++) square += y[k] ** 2;
            const size = Math.sqrt(square);
            for (let k = 0; k < rank; k++) if (Math.abs(y[k]) > tolerance * size) found[order[k]] = false;
            found[order[j]] = false;
        }
        return found;
    }

    /** R⁻¹ y in place of the first entries of y. @param {Float64Array} y */
    _upper(y) {
        const { m, a, rank, diagonal } = this;
        for (let k = rank - 1; k >= 0; k--) {
            let value = y[k];
            for (let j = k + 1; j < rank; j++) value -= a[j * m + k] * y[j];
            y[k] = value / diagonal[k];
        }
    }

    /**
     * Whether another matrix, of the same shape and near this one, has its orientation: det(R₁ᵀ) and that of the
     * same rows of Bᵀ in the basis of this one have the same sign. @param {ArrayLike<number>} b
     */
    sameOrientation(b) {
        const { m, rank, order } = this, square = new Float64Array(rank * rank), column = new Float64Array(m);
        let sign = 1;
        for (let k = 0; k < rank; k++) {
            for (let i = 0; i < m; i++) column[i] = b[order[k] * m + i];
            square.set(this.turn(column).subarray(0, rank), k * rank);
            if (this.diagonal[k] < 0) sign = -sign;
        }
        return sign * signOf(square, rank) > 0;
    }
}

/** The sign of a determinant. @param {Float64Array} a changed @param {number} n */
function signOf(a, n) {
    let sign = 1;
    for (let k = 0; k < n; k++) {
        let best = k;
        for (let i = k + 1; i < n; i++) if (Math.abs(a[k * n + i]) > Math.abs(a[k * n + best])) best = i;
        const pivot = a[k * n + best];
        if (!(Math.abs(pivot) > 0)) return 0;
        if (pivot < 0 !== (best !== k)) sign = -sign;
        for (let j = k; j < n && best !== k; j++) [a[j * n + k], a[j * n + best]] = [a[j * n + best], a[j * n + k]];
        for (let j = k + 1; j < n; j++) {
            const part = a[j * n + k] / pivot;
            for (let i = k + 1; i < n; i++) a[j * n + i] -= part * a[k * n + i];
        }
    }
    return sign;
}

/**
 * x with A x = b for several b, A symmetric and positive definite; null where it is not.
 * @param {ArrayLike<number>} a in columns @param {number} n @param {ArrayLike<number>} b its columns, one after the other
 * @returns {Float64Array | null}
 */
export function solvedSymmetric(a, n, b) {
    const L = Float64Array.from(a), x = Float64Array.from(b);
    let most = 0;
    for (let j = 0; j < n; j++) most = Math.max(most, L[j * n + j]);
    for (let j = 0; j < n; j++) {
        for (let k = 0; k < j; k++) for (let i = j; i < n; i++) L[j * n + i] -= L[k * n + i] * L[k * n + j];
        if (!(L[j * n + j] > 1e-14 * most)) return null;
        const root = Math.sqrt(L[j * n + j]);
        for (let i = j; i < n; i++) L[j * n + i] /= root;
    }
    for (let at = 0; at < x.length; at += n) {
        for (let i = 0; i < n; i++) {
            for (let k = 0; k < i; k++) x[at + i] -= L[k * n + i] * x[at + k];
            x[at + i] /= L[i * n + i];
        }
        for (let i = n - 1; i >= 0; i--) {
            for (let k = i + 1; k < n; k++) x[at + i] -= L[i * n + k] * x[at + k];
            x[at + i] /= L[i * n + i];
        }
    }
    return x;
}

/** The largest size of an entry; zero without any. @param {ArrayLike<number>} x */
export function largest(x) {
    let most = 0;
    for (let i = 0; i < x.length; i++) most = Math.max(most, Math.abs(x[i])); // NaN stays NaN
    return most;
}

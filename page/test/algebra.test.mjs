import assert from "node:assert/strict";
import { test } from "node:test";
import { Qr, largest, solvedSymmetric } from "../src/algebra.js";

let seed = 7;
const random = () => (seed = (16807 * seed) % 2147483647) / 2147483647 - 0.5;
/** A random matrix of a rank, in columns. @param {number} m @param {number} n @param {number} rank */
function matrix(m, n, rank) {
    const B = Float64Array.from({ length: m * rank }, random), C = Float64Array.from({ length: rank * n }, random), A = new Float64Array(m * n);
    for (let j = 0; j < n; j++) for (let k = 0; k < rank; k++) for (let i = 0; i < m; i++) A[j * m + i] += B[k * m + i] * C[j * rank + k];
    return A;
}
/** @param {Float64Array} A @param {number} m @param {number} n @param {ArrayLike<number>} x */
const times = (A, m, n, x) => Float64Array.from({ length: m }, (_, i) => Array.from({ length: n }, (__, j) => A[j * m + i] * x[j]).reduce((a, b) => a + b, 0));
/** @param {Float64Array} A @param {number} m @param {number} n @param {ArrayLike<number>} x */
const timesTransposed = (A, m, n, x) => Float64Array.from({ length: n }, (_, j) => Array.from({ length: m }, (__, i) => A[j * m + i] * x[i]).reduce((a, b) => a + b, 0));
/** @param {ArrayLike<number>} a @param {ArrayLike<number>} b @param {number} [most] */
const near = (a, b, most = 1e-12) => assert.ok(a.length === b.length && largest(Array.from(a, (x, k) => x - b[k])) < most, `${a} ${b}`);

for (const [m, n, rank] of [[5, 5, 5], [8, 5, 5], [5, 8, 5], [7, 6, 3], [4, 9, 2], [3, 3, 0], [0, 3, 0], [4, 0, 0]]) {
    test(`a matrix of ${m} rows, ${n} columns and rank ${rank} is factored`, () => {
        const A = matrix(m, n, rank), qr = new Qr(A, m, n, 1e-10), x = Float64Array.from({ length: n }, random), y = Float64Array.from({ length: m }, random);
        assert.equal(qr.rank, rank);
        const b = times(A, m, n, x), c = timesTransposed(A, m, n, y);
        near(times(A, m, n, qr.solve(b)), b);
        const short = qr.solveTransposed(c), N = qr.nullSpace();
        near(timesTransposed(A, m, n, short), c);
        assert.equal(N.length, m * (m - rank));
        for (let k = 0; k < m - rank; k++) {
            const v = N.subarray(k * m, k * m + m);
            near(timesTransposed(A, m, n, v), new Float64Array(n));
            near([v.reduce((sum, value, i) => sum + value * short[i], 0)], [0]); // the shortest
            for (let l = 0; l <= k; l++) near([v.reduce((sum, value, i) => sum + value * N[l * m + i], 0)], [Number(k === l)]);
        }
        const any = Float64Array.from({ length: n }, random), best = qr.leastSquares(any); // no row fits exactly
        const left = timesTransposed(A, m, n, best).map((value, k) => value - any[k]);
        near(times(A, m, n, left), new Float64Array(m));
        for (let k = 0; k < m - rank; k++) near([best.reduce((sum, value, i) => sum + value * N[k * m + i], 0)], [0]);
        near(qr.turnBack(qr.turn(Float64Array.from(y))), y);
    });
}

test("entries that every solution shares are told from those that another one changes", () => {
    const A = new Float64Array([1, 0, 0, 0, 1, 0, 0, 1, 0, 0, 0, 2]); // columns 1 and 2 are the same
    assert.deepEqual(new Qr(A, 3, 4, 1e-12).unique(1e-9), [true, false, false, true]);
    assert.deepEqual(new Qr(A, 3, 3, 1e-12).unique(1e-9), [true, false, false]);
});

test("a matrix keeps its orientation while no determinant passes zero", () => {
    for (let round = 0; round < 20; round++) {
        const A = matrix(6, 4, 4), qr = new Qr(A, 6, 4, 1e-10);
        assert.ok(qr.sameOrientation(A));
        assert.ok(qr.sameOrientation(A.map((x) => x + 1e-6 * random())));
        const turned = A.map((x, k) => (k < 6 ? -x : x)); // one column the other way round
        assert.ok(!qr.sameOrientation(turned));
    }
});

test("symmetric equations are solved, and refused where a motion has no inertia", () => {
    const B = matrix(5, 5, 5), A = new Float64Array(25), x = Float64Array.from({ length: 10 }, random);
    for (let i = 0; i < 5; i++) for (let j = 0; j < 5; j++) for (let k = 0; k < 5; k++) A[j * 5 + i] += B[i * 5 + k] * B[j * 5 + k];
    const b = Float64Array.from([...times(A, 5, 5, x.subarray(0, 5)), ...times(A, 5, 5, x.subarray(5))]);
    near(/** @type {Float64Array} */ (solvedSymmetric(A, 5, b)), x, 1e-7);
    assert.equal(solvedSymmetric(new Float64Array([1, 1, 1, 1]), 2, new Float64Array(2)), null);
    assert.equal(/** @type {Float64Array} */ (solvedSymmetric(new Float64Array(0), 0, new Float64Array(0))).length, 0);
});

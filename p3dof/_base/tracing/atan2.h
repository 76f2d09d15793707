/* The angle of a point (x, y) for code that is made from formulas, of doubles or of vectors of them.
 *
 * Included as tanh.h is, with the same names defined.
 *
 * To 3e-16 rad, with the library's signs but for x = -0, which counts as 0; NaN for infinite numbers and where
 * |x| + |y| overflows. With u <= v of |x| and |y| one division gives t = u / v or, beyond tan(pi/8), the tangent
 * (u - v) / (u + v) of what is left of pi/4. The polynomial is a near-minimax fit (Chebyshev's interpolation, 60 digits)
 * of (atan t / t - 1) / t^2 to 3e-17 for |t| <= tan(pi/8).
 */
static P3DOF_INLINE P3DOF_TARGET P3DOF_REAL P3DOF_NAME(atan2)(P3DOF_REAL y, P3DOF_REAL x)
{
    const P3DOF_BITS sign = P3DOF_BITS_OF(y) >> 63 << 63, back = P3DOF_BITS_OF(x) >> 63 << 63;
    const P3DOF_REAL a = P3DOF_REAL_OF(P3DOF_BITS_OF(x) ^ back), b = P3DOF_REAL_OF(P3DOF_BITS_OF(y) ^ sign);
    const P3DOF_REAL u = P3DOF_WHERE(b > a, a, b), v = P3DOF_WHERE(b > a, b, a);
    const P3DOF_REAL difference = u - v, sum = u + v;
    const P3DOF_REAL above = P3DOF_WHERE(u > 0x1.a827999fcef32p-2 * v, difference, u);
    const P3DOF_REAL below = P3DOF_WHERE(u > 0x1.a827999fcef32p-2 * v, sum, v);
    const P3DOF_REAL t = above / P3DOF_WHERE(below == 0.0, P3DOF_ALL(1.0), below);
    const P3DOF_REAL z = t * t;

    P3DOF_REAL p = -0.01917688711906226 * z + 0.03923165829558719;
    p = p * z - 0.0508544973794026;
    p = p * z + 0.0585814891280221;
    p = p * z - 0.06664511447381948;
    p = p * z + 0.07692183190826087;
    p = p * z - 0.09090904578123903;
    p = p * z + 0.11111111015256361;
    p = p * z - 0.14285714284666542;
    p = p * z + 0.1999999999999552;
    p = p * z - 0.3333333333333333;
    const P3DOF_REAL part = t + (t * z) * p;
    const P3DOF_REAL small = P3DOF_WHERE(u > 0x1.a827999fcef32p-2 * v, part + 0x1.921fb54442d18p-1, part);
    const P3DOF_REAL steep = P3DOF_WHERE(b > a, 0x1.921fb54442d18p+0 - small, small);
    const P3DOF_REAL whole = P3DOF_WHERE(x < 0.0, 0x1.921fb54442d18p+1 - steep, steep);
    return P3DOF_REAL_OF(P3DOF_BITS_OF(whole) | sign);
}

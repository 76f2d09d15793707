/* One over a square root for code that is made from formulas, of doubles or of vectors of them.
 *
 * Included as sincos.h is, with the same names defined, and with P3DOF_NEWTON where steps are faster than the processor's
 * own root and division: with vectors of eight, which take it two to three times as long as vectors of four.
 *
 * To 2.3e-16 for normal x > 0; anything at all for others, NaN for NaN. Half the bits of x, taken off a number, are a first
 * guess to 3.5 %. Two steps y + y p(1 - x y^2) follow: the first with the cubic that is best in that range (to 7.4e-7),
 * the second with the first terms of the series. No division and no root, which processors do one after the other.
 */
static P3DOF_INLINE P3DOF_TARGET P3DOF_REAL P3DOF_NAME(rsqrt)(P3DOF_REAL x)
{
#if defined(P3DOF_NEWTON)
    const P3DOF_REAL y = P3DOF_REAL_OF(0x5fe6eb50c7b537a9 - (P3DOF_BITS_OF(x) >> 1));
    const P3DOF_REAL d = 1.0 - (x * y) * y;
    P3DOF_REAL p = 0.3132734392571501 * d + 0.37627969172311965;
    p = p * d + 0.4999994059972749;
    p = p * d + 0.9999992642877709;
    const P3DOF_REAL z = y * p;
    const P3DOF_REAL e = 1.0 - (x * z) * z;
    return z + (z * e) * (0.375 * e + 0.5);
#else
    return 1.0 / sqrt(x);
#endif
}

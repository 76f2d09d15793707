/* The hyperbolic tangent for code that is made from formulas, of doubles or of vectors of them.
 *
 * Included as sincos.h is, after it, with the same names defined and besides
 *   P3DOF_WHERE(condition, a, b) a where the condition holds, else b;
 *   P3DOF_ALL(number)            a number in all places.
 *
 * To 3e-16 of the result; NaN stays NaN. tanh |x| = e / (e + 2) with e = exp(2 |x|) - 1, which is exact for small
 * numbers, too; e = 2^n p + (2^n - 1) with p = exp(r) - 1, |r| <= ln 2 / 2. The polynomial is a near-minimax fit
 * (Chebyshev's interpolation, 60 digits) of (exp r - 1 - r - r^2 / 2) / r^3 to 8e-18. From 20 on the result is 1.
 */
static P3DOF_INLINE P3DOF_TARGET P3DOF_REAL P3DOF_NAME(tanh)(P3DOF_REAL x)
{
    const P3DOF_BITS sign = P3DOF_BITS_OF(x) >> 63 << 63;
    const P3DOF_REAL size = P3DOF_REAL_OF(P3DOF_BITS_OF(x) ^ sign);
    const P3DOF_REAL z = P3DOF_WHERE(size > 20.0, P3DOF_ALL(20.0), size) * 2.0;
    const P3DOF_REAL shifted = z * 0x1.71547652b82fep+0 + 0x1.8p52;
    const P3DOF_REAL turned = shifted - 0x1.8p52;
    const P3DOF_REAL r = (z - turned * 0x1.62e42feep-1) - turned * 0x1.a39ef35793c76p-33;

    P3DOF_REAL p = 2.0911236630261545e-09 * r + 2.510038549551032e-08;
    p = p * r + 2.755728296954995e-07;
    p = p * r + 2.7557268459997064e-06;
    p = p * r + 2.4801587317144498e-05;
    p = p * r + 0.00019841269863053618;
    p = p * r + 0.0013888888888886552;
    p = p * r + 0.008333333333330062;
    p = p * r + 0.041666666666666664;
    p = p * r + 0.16666666666666669;
    p = r + (r * r) * (0.5 + r * p);

    const P3DOF_REAL power = P3DOF_REAL_OF((P3DOF_BITS_OF(shifted) << 52) + 0x3ff0000000000000);
    const P3DOF_REAL e = power * p + (power - 1.0);
    return P3DOF_REAL_OF(P3DOF_BITS_OF(e / (e + 2.0)) | sign);
}

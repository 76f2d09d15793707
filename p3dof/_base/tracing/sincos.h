/* Sine and cosine for code that is made from formulas, of doubles or of vectors of them.
 *
 * Included once for each, with P3DOF_NAME, P3DOF_INLINE and P3DOF_TARGET defined by the includer, and
 *   P3DOF_REAL, P3DOF_BITS       a double and 64 unsigned bits, or as many as are in a vector;
 *   P3DOF_BITS_OF, P3DOF_REAL_OF take one for the other, bit by bit;
 *   P3DOF_BOUNDED(x, value)      the value where |x| <= 1e5, else NaN.
 * There is no include guard for that reason.
 *
 * To 1.8e-16 for |x| <= 1e5; NaN for everything else, NaN and infinities included.
 *
 * x = quarters * pi/2 + r with r in [-pi/4, pi/4]. Adding 1.5 * 2^52 rounds to the nearest integer and leaves it in
 * the low bits. The first part of pi/2 has 33 bits, so that its product with up to 17 bits of quarters is exact, and
 * so is the first difference; with and without fused multiply-add. The polynomials in z = r^2 are near-minimax fits
 * (Chebyshev's interpolation, 60 digits) of (sin r / r - 1) / z and of (cos r - 1 + z / 2) / z^2 to 2e-17.
 *
 * Nothing branches and nothing is called, so that a loop around it becomes vector instructions. The library's sin
 * and cos would be merged into one scalar call. `sincos_near` is for |x| <= pi/4 only, with the same bits.
 */
static P3DOF_INLINE P3DOF_TARGET void P3DOF_NAME(sincos_near)(P3DOF_REAL r, P3DOF_REAL *sine, P3DOF_REAL *cosine)
{
    const P3DOF_REAL z = r * r;

    P3DOF_REAL s = 1.591810123027412e-10 * z - 2.5051131455427946e-08;
    s = s * z + 2.755731610068303e-06;
    s = s * z - 1.984126983675497e-04;
    s = s * z + 8.333333333330946e-03;
    s = s * z - 0.16666666666666666;
    *sine = r + (r * z) * s;

    P3DOF_REAL c = -1.1382614868556325e-11 * z + 2.0876146024689747e-09;
    c = c * z - 2.7557317270560326e-07;
    c = c * z + 2.4801587298763433e-05;
    c = c * z - 1.3888888888887395e-03;
    c = c * z + 4.1666666666666664e-02;
    *cosine = (1.0 - 0.5 * z) + (z * z) * c;
}

static P3DOF_INLINE P3DOF_TARGET void P3DOF_NAME(sincos)(P3DOF_REAL x, P3DOF_REAL *sine, P3DOF_REAL *cosine)
{
    const P3DOF_REAL shifted = x * 0x1.45f306dc9c883p-1 + 0x1.8p52;
    const P3DOF_BITS quarters = P3DOF_BITS_OF(shifted);
    const P3DOF_REAL turned = shifted - 0x1.8p52;
    const P3DOF_REAL reduced = (x - turned * 0x1.921fb544p+0) - turned * 0x1.0b4611a626331p-34;
    const P3DOF_REAL r = P3DOF_BOUNDED(x, reduced);
    P3DOF_REAL s, c;
    P3DOF_NAME(sincos_near)(r, &s, &c);

    /* An odd number of quarters swaps the two; bit 1 of it is the sign of the sine, and of one more that of the cosine. */
    const P3DOF_BITS sine_bits = P3DOF_BITS_OF(s), cosine_bits = P3DOF_BITS_OF(c);
    const P3DOF_BITS swap = (sine_bits ^ cosine_bits) & (0 - (quarters & 1));
    *sine = P3DOF_REAL_OF(sine_bits ^ swap ^ (quarters >> 1 << 63));
    *cosine = P3DOF_REAL_OF(cosine_bits ^ swap ^ ((quarters + 1) >> 1 << 63));
}

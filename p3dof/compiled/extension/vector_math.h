/* What every level of _compiled.c is made of besides the generated kernels: sine and cosine, and moving columns.
 *
 * Included once per level, like generated/batch_kernels.h, with P3DOF_NAME and P3DOF_TARGET defined by the
 * includer. There is no include guard for that reason.
 */

static P3DOF_INLINE P3DOF_TARGET uint64_t P3DOF_NAME(bits_of)(double x)
{
    uint64_t bits;
    memcpy(&bits, &x, sizeof bits);
    return bits;
}

static P3DOF_INLINE P3DOF_TARGET double P3DOF_NAME(double_of)(uint64_t bits)
{
    double x;
    memcpy(&x, &bits, sizeof x);
    return x;
}

/* Sine and cosine to 1.8e-16 for |x| <= 1e5; NaN for everything else, NaN and infinities included.
 *
 * x = quarters * pi/2 + r with r in [-pi/4, pi/4]. Adding 1.5 * 2^52 rounds to the nearest integer and leaves it in
 * the low bits. The first part of pi/2 has 33 bits, so that its product with up to 17 bits of quarters is exact, and
 * so is the first difference; with and without fused multiply-add. The polynomials in z = r^2 are near-minimax fits
 * (Chebyshev's interpolation, 60 digits) of (sin r / r - 1) / z and of (cos r - 1 + z / 2) / z^2 to 2e-17.
 *
 * Nothing branches and nothing is called, so that the loop around it becomes vector instructions. The library's sin
 * and cos would be merged into one scalar call.
 */
static P3DOF_INLINE P3DOF_TARGET void P3DOF_NAME(sincos)(double x, double *sine, double *cosine)
{
    const double shifted = x * 0x1.45f306dc9c883p-1 + 0x1.8p52;
    const uint64_t quarters = P3DOF_NAME(bits_of)(shifted);
    const double turned = shifted - 0x1.8p52;
    const double reduced = (x - turned * 0x1.921fb544p+0) - turned * 0x1.0b4611a626331p-34;
    const double r = fabs(x) <= 1e5 ? reduced : NAN;
    const double z = r * r;

    double s = 1.591810123027412e-10;
    s = s * z - 2.5051131455427946e-08;
    s = s * z + 2.755731610068303e-06;
    s = s * z - 1.984126983675497e-04;
    s = s * z + 8.333333333330946e-03;
    s = s * z - 0.16666666666666666;
    s = r + (r * z) * s;

    double c = -1.1382614868556325e-11;
    c = c * z + 2.0876146024689747e-09;
    c = c * z - 2.7557317270560326e-07;
    c = c * z + 2.4801587298763433e-05;
    c = c * z - 1.3888888888887395e-03;
    c = c * z + 4.1666666666666664e-02;
    c = (1.0 - 0.5 * z) + (z * z) * c;

    /* An odd number of quarters swaps the two; bit 1 of it is the sign of the sine, and of one more that of the cosine. */
    const uint64_t sine_bits = P3DOF_NAME(bits_of)(s), cosine_bits = P3DOF_NAME(bits_of)(c);
    const uint64_t swap = (sine_bits ^ cosine_bits) & (0 - (quarters & 1));
    *sine = P3DOF_NAME(double_of)(sine_bits ^ swap ^ (quarters >> 1 << 63));
    *cosine = P3DOF_NAME(double_of)(cosine_bits ^ swap ^ ((quarters + 1) >> 1 << 63));
}

/* Whether all are > 0; a NaN is not. */
static P3DOF_TARGET int P3DOF_NAME(all_positive)(ptrdiff_t n, const double *margins)
{
    int64_t bad = 0;
    for (ptrdiff_t i = 0; i < n; ++i)
        bad |= margins[i] > 0.0 ? 0 : 1;
    return bad == 0;
}

/* Strides below are in doubles. */

static P3DOF_TARGET void P3DOF_NAME(gather)(ptrdiff_t n, const double *from, ptrdiff_t stride, double *restrict to)
{
    for (ptrdiff_t i = 0; i < n; ++i)
        to[i] = from[i * stride];
}

static P3DOF_TARGET void P3DOF_NAME(scatter)(ptrdiff_t n, const double *restrict from, double *to, ptrdiff_t stride)
{
    for (ptrdiff_t i = 0; i < n; ++i)
        to[i * stride] = from[i];
}

/* The same for three neighbouring columns of rows of three, x y z x y z ...; the lines are `line` doubles apart. */

static P3DOF_TARGET void P3DOF_NAME(gather_three)(ptrdiff_t n, const double *restrict from, double *restrict to,
                                                  ptrdiff_t line)
{
    double *restrict x = to, *restrict y = to + line, *restrict z = to + 2 * line;
    for (ptrdiff_t i = 0; i < n; ++i) {
        x[i] = from[3 * i];
        y[i] = from[3 * i + 1];
        z[i] = from[3 * i + 2];
    }
}

static P3DOF_TARGET void P3DOF_NAME(scatter_three)(ptrdiff_t n, const double *restrict from, ptrdiff_t line,
                                                   double *restrict to)
{
    const double *restrict x = from, *restrict y = from + line, *restrict z = from + 2 * line;
    for (ptrdiff_t i = 0; i < n; ++i) {
        to[3 * i] = x[i];
        to[3 * i + 1] = y[i];
        to[3 * i + 2] = z[i];
    }
}

/* The same for `columns` neighbouring columns of rows of any length: row by row, as memory wants it. */
static P3DOF_TARGET void P3DOF_NAME(scatter_rows)(ptrdiff_t n, const double *restrict from, ptrdiff_t line, int columns,
                                                  double *restrict to, ptrdiff_t stride)
{
    for (ptrdiff_t i = 0; i < n; ++i)
        for (int k = 0; k < columns; ++k)
            to[i * stride + k] = from[k * line + i];
}

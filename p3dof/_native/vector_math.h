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

#define P3DOF_REAL double
#define P3DOF_BITS uint64_t
#define P3DOF_BITS_OF P3DOF_NAME(bits_of)
#define P3DOF_REAL_OF P3DOF_NAME(double_of)
/* x * BEYOND overflows for |x| > 1e5, and infinity less infinity is NaN. No branch and no comparison of 64 bits: every
 * level vectorises it, and one sample gets the same fused operations as a vector of them. */
#define P3DOF_BEYOND 0x1.4f8b588e368f0p+1007
#define P3DOF_BOUNDED(x, value) ((value) - ((x) * P3DOF_BEYOND - (x) * P3DOF_BEYOND))
#define P3DOF_WHERE(condition, a, b) ((condition) ? (a) : (b))
#define P3DOF_ALL(number) (number)
#include "../_base/tracing/sincos.h"
#include "../_base/tracing/rsqrt.h"
#include "../_base/tracing/tanh.h"
#include "../_base/tracing/atan2.h"
#undef P3DOF_REAL
#undef P3DOF_BITS
#undef P3DOF_BITS_OF
#undef P3DOF_REAL_OF
#undef P3DOF_BOUNDED
#undef P3DOF_BEYOND
#undef P3DOF_WHERE
#undef P3DOF_ALL

/* The same for one number by itself, to the same bits: a branch that is guessed right spares what brings a small angle to
 * itself, of which the rest would wait. */
static P3DOF_INLINE P3DOF_TARGET void P3DOF_NAME(sincos_alone)(double x, double *sine, double *cosine)
{
    if (fabs(x) < 0.785)
        P3DOF_NAME(sincos_near)(x, sine, cosine);
    else
        P3DOF_NAME(sincos)(x, sine, cosine);
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

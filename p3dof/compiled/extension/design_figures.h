/* Figures of one design over a motion: the kernels on blocks that stay in the first level of the cache, reduced there.
 *
 * Included once per level, like vector_math.h. Lanes are kept apart until the end, so that every level adds up in
 * the same order. Samples are padded to whole lanes with the last one, whose weights are zero.
 */

/* Of three forces the largest size and where it comes first, by lanes from `start` on, and the weighted sum of squares;
 * all at once, as each waits for itself. */
static P3DOF_TARGET void P3DOF_NAME(reduce_forces)(ptrdiff_t n, double *const *force, const double *restrict weight,
                                                   ptrdiff_t start, DesignPeaks *restrict peaks)
{
    const double *restrict a = force[0], *restrict b = force[1], *restrict c = force[2];
    double *restrict top_a = peaks[0].top, *restrict when_a = peaks[0].when, *restrict square_a = peaks[0].square;
    double *restrict top_b = peaks[1].top, *restrict when_b = peaks[1].when, *restrict square_b = peaks[1].square;
    double *restrict top_c = peaks[2].top, *restrict when_c = peaks[2].when, *restrict square_c = peaks[2].square;
    for (ptrdiff_t i = 0; i < n; i += DESIGN_LANES) {
        const double at = (double)(start + i);
        P3DOF_SIMD
        for (int l = 0; l < DESIGN_LANES; ++l) {
            const double size_a = fabs(a[i + l]), size_b = fabs(b[i + l]), size_c = fabs(c[i + l]);
            when_a[l] = size_a > top_a[l] ? at : when_a[l];
            when_b[l] = size_b > top_b[l] ? at : when_b[l];
            when_c[l] = size_c > top_c[l] ? at : when_c[l];
            top_a[l] = size_a > top_a[l] ? size_a : top_a[l];
            top_b[l] = size_b > top_b[l] ? size_b : top_b[l];
            top_c[l] = size_c > top_c[l] ? size_c : top_c[l];
            square_a[l] += weight[i + l] * (size_a * size_a);
            square_b[l] += weight[i + l] * (size_b * size_b);
            square_c[l] += weight[i + l] * (size_c * size_c);
        }
    }
}

/* The least and the largest of a column. */
static P3DOF_TARGET void P3DOF_NAME(reduce_range)(ptrdiff_t n, const double *restrict x, double *restrict bottom,
                                                  double *restrict top)
{
    for (ptrdiff_t i = 0; i < n; i += DESIGN_LANES) {
        P3DOF_SIMD
        for (int l = 0; l < DESIGN_LANES; ++l) {
            bottom[l] = x[i + l] < bottom[l] ? x[i + l] : bottom[l];
            top[l] = x[i + l] > top[l] ? x[i + l] : top[l];
        }
    }
}

static P3DOF_TARGET void P3DOF_NAME(shift)(ptrdiff_t n, const double *restrict x, double by, double *restrict to)
{
    for (ptrdiff_t i = 0; i < n; ++i)
        to[i] = x[i] + by;
}

/* The largest demand on leg C across its guide-way, squared. */
static P3DOF_TARGET void P3DOF_NAME(reduce_demand)(const DesignMotion *motion, const double *lengths,
                                                   const double *offset, double *restrict most)
{
    const double r = lengths[0], R = lengths[1], by = offset[0];
    const double *restrict y_row = motion->rows, *restrict sines = motion->sines, *restrict cosines = motion->cosines;
    const double turned_sin = offset[2] == 0.0 ? 0.0 : sin(offset[2]), turned_cos = cos(offset[2]);
    const ptrdiff_t padded = motion->padded;
    for (ptrdiff_t i = 0; i < padded; i += DESIGN_LANES) {
        P3DOF_SIMD
        for (int l = 0; l < DESIGN_LANES; ++l) {
            const double y = y_row[i + l] + by;
            const double wc = R - r * (cosines[i + l] * turned_cos - sines[i + l] * turned_sin);
            const double square = y * y + wc * wc;
            most[l] = square > most[l] ? square : most[l];
        }
    }
}

/* The least s |s| of the sine s of the angle from the actuation singularity; NaN is left out. */
static P3DOF_TARGET void P3DOF_NAME(reduce_sine)(const DesignMotion *motion, const double *lengths,
                                                 const double *offset, double *restrict least)
{
    const double r = lengths[0], R = lengths[1], L = lengths[2], by = offset[0];
    const double *restrict y_row = motion->rows, *restrict sines = motion->sines, *restrict cosines = motion->cosines;
    const double turned_sin = offset[2] == 0.0 ? 0.0 : sin(offset[2]), turned_cos = cos(offset[2]);
    const ptrdiff_t padded = motion->padded;
    for (ptrdiff_t i = 0; i < padded; i += DESIGN_LANES) {
        P3DOF_SIMD
        for (int l = 0; l < DESIGN_LANES; ++l) {
            const double y = y_row[i + l] + by;
            const double cosine = cosines[i + l] * turned_cos - sines[i + l] * turned_sin;
            const double sine = sines[i + l] * turned_cos + cosines[i + l] * turned_sin;
            const double wc = R - r * cosine, u2 = (L - y) * (L + y);
            const double s = cosine * sqrt(u2 - wc * wc) - sine * wc, found = s * fabs(s) / u2;
            least[l] = found < least[l] ? found : least[l];
        }
    }
}

/* Slider speeds and, where asked, powers of a block. */
static P3DOF_TARGET void P3DOF_NAME(rates_of)(ptrdiff_t n, const double *const *moving, const double *const *turns,
                                              double *const *speed)
{
    const double *restrict vy = moving[3], *restrict vz = moving[4], *restrict vt = moving[5];
    const double *restrict ay = turns[3], *restrict by = turns[4], *restrict cy = turns[5], *restrict ct = turns[6];
    double *restrict a = speed[0], *restrict b = speed[1], *restrict c = speed[2];
    P3DOF_SIMD
    for (ptrdiff_t i = 0; i < n; ++i) {
        a[i] = ay[i] * vy[i] + vz[i];
        b[i] = by[i] * vy[i] + vz[i];
        c[i] = (cy[i] * vy[i] + vz[i]) + ct[i] * vt[i];
    }
}

static P3DOF_TARGET void P3DOF_NAME(multiply)(ptrdiff_t n, const double *restrict a, const double *restrict b,
                                              double *restrict to)
{
    for (ptrdiff_t i = 0; i < n; ++i)
        to[i] = a[i] * b[i];
}

/* Sums by lanes: of weighted numbers, and of what is positive. */
static P3DOF_TARGET void P3DOF_NAME(add_weighted)(ptrdiff_t n, const double *restrict weight, const double *restrict x,
                                                  double *restrict sum)
{
    for (ptrdiff_t i = 0; i < n; i += DESIGN_LANES) {
        P3DOF_SIMD
        for (int l = 0; l < DESIGN_LANES; ++l)
            sum[l] += weight[i + l] * x[i + l];
    }
}

static P3DOF_TARGET void P3DOF_NAME(add_positive)(ptrdiff_t n, const double *restrict x, double *restrict sum)
{
    for (ptrdiff_t i = 0; i < n; i += DESIGN_LANES) {
        P3DOF_SIMD
        for (int l = 0; l < DESIGN_LANES; ++l)
            sum[l] += x[i + l] > 0.0 ? x[i + l] : 0.0;
    }
}

/* The work of a power from each sample to the next, by the polynomial through those around. */
static P3DOF_TARGET void P3DOF_NAME(steps_of)(const DesignMotion *motion, const double *restrict power,
                                              double *restrict step)
{
    const ptrdiff_t steps = motion->samples - 1, points = motion->points, before = points / 2 - 1;
    const ptrdiff_t last = motion->samples - points;
    for (ptrdiff_t i = 0; i < motion->padded; ++i)
        step[i] = 0.0;
    for (ptrdiff_t k = 0; k < points; ++k) {
        const double *restrict weight = motion->steps + k * motion->padded;
        ptrdiff_t i = 0;
        for (; i < before && i < steps; ++i)
            step[i] += weight[i] * power[k];
        for (; i - before <= last && i < steps; ++i)
            step[i] += weight[i] * power[i - before + k];
        for (; i < steps; ++i)
            step[i] += weight[i] * power[last + k];
    }
}

#include "design_tracks.h"

static const DesignReductions P3DOF_NAME(REDUCTIONS) = {
    P3DOF_NAME(reduce_forces), P3DOF_NAME(reduce_range), P3DOF_NAME(reduce_demand), P3DOF_NAME(reduce_sine),
    P3DOF_NAME(shift),         P3DOF_NAME(rates_of),     P3DOF_NAME(multiply),      P3DOF_NAME(steps_of),
    P3DOF_NAME(add_weighted),  P3DOF_NAME(add_positive),
    P3DOF_NAME(track),         P3DOF_NAME(track_size),   P3DOF_NAME(add_products),  P3DOF_NAME(rates_of_power),
    P3DOF_NAME(add_rates),     P3DOF_NAME(margins_at),
};

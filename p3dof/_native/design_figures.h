/* Figures of one design over a motion: the kernels on blocks that stay in the first level of the cache, reduced there.
 *
 * Included once per level, like vector_math.h. Lanes are kept apart until the end, so that every level adds up in
 * the same order. Samples are padded to whole lanes with the last one, whose weights are zero.
 */

/* Of three forces the largest size and where it comes first, by lanes from `start` on, and the weighted sum of squares;
 * how near the actuation singularity is. All at once, as each waits for itself. */
static P3DOF_TARGET void P3DOF_NAME(reduce_forces)(ptrdiff_t n, double *const *force, const double *restrict weight,
                                                   ptrdiff_t start, DesignPeaks *restrict peaks,
                                                   DesignSine *restrict near)
{
    const double *restrict a = force[0], *restrict b = force[1], *restrict c = force[2], *restrict sine = force[3];
    double *restrict least = near->least, *restrict size = near->size;
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
            const double bare = fabs(sine[i + l]);
            least[l] = sine[i + l] < least[l] ? sine[i + l] : least[l];
            size[l] = bare < size[l] ? bare : size[l];
            square_a[l] += weight[i + l] * (size_a * size_a);
            square_b[l] += weight[i + l] * (size_b * size_b);
            square_c[l] += weight[i + l] * (size_c * size_c);
        }
    }
}

/* Positions of three sliders, then their speeds. */
static P3DOF_TARGET void P3DOF_NAME(reduce_slides)(ptrdiff_t n, double *const *slide, DesignSlides *restrict found)
{
    for (int leg = 0; leg < 3; ++leg) {
        const double *restrict x = slide[leg], *restrict v = slide[3 + leg];
        double *restrict low = found->low[leg], *restrict high = found->high[leg], *restrict fast = found->fast[leg];
        for (ptrdiff_t i = 0; i < n; i += DESIGN_LANES) {
            P3DOF_SIMD
            for (int l = 0; l < DESIGN_LANES; ++l) {
                const double speed = fabs(v[i + l]);
                low[l] = x[i + l] < low[l] ? x[i + l] : low[l];
                high[l] = x[i + l] > high[l] ? x[i + l] : high[l];
                fast[l] = speed > fast[l] ? speed : fast[l];
            }
        }
    }
}

/* y, z, sine and cosine of samples that are moved by an offset. */
static P3DOF_TARGET void P3DOF_NAME(place)(const DesignMotion *motion, const double *offset, ptrdiff_t start,
                                           ptrdiff_t n, double *const *to)
{
    const double by_y = offset[0], by_z = offset[1], turned_sin = sin(offset[2]), turned_cos = cos(offset[2]);
    const double *restrict y = motion->rows + start, *restrict z = y + motion->padded;
    const double *restrict sine = z + motion->padded, *restrict cosine = sine + motion->padded;
    double *restrict to_y = to[0], *restrict to_z = to[1], *restrict to_sine = to[2], *restrict to_cosine = to[3];
    P3DOF_SIMD
    for (ptrdiff_t i = 0; i < n; ++i) {
        to_y[i] = y[i] + by_y;
        to_z[i] = z[i] + by_z;
        to_sine[i] = sine[i] * turned_cos + cosine[i] * turned_sin;
        to_cosine[i] = cosine[i] * turned_cos - sine[i] * turned_sin;
    }
}

/* The largest demand on leg C across its guide-way, squared. */
static P3DOF_TARGET void P3DOF_NAME(reduce_demand)(const DesignMotion *motion, const double *lengths,
                                                   const double *offset, double *restrict most)
{
    const double r = lengths[0], R = lengths[1], by = offset[0];
    const ptrdiff_t padded = motion->padded;
    const double *restrict y_row = motion->rows, *restrict sines = motion->rows + ROW_SINE * padded;
    const double *restrict cosines = motion->rows + ROW_COSINE * padded;
    if (offset[0] == 0.0 && offset[2] == 0.0) {
        for (ptrdiff_t i = 0; i < padded; i += DESIGN_LANES) {
            P3DOF_SIMD
            for (int l = 0; l < DESIGN_LANES; ++l) {
                const double y = y_row[i + l], wc = R - r * cosines[i + l], square = y * y + wc * wc;
                most[l] = square > most[l] ? square : most[l];
            }
        }
        return;
    }
    const double turned_sin = sin(offset[2]), turned_cos = cos(offset[2]);
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

/* Powers of three actuators, `line` doubles apart. */
static P3DOF_TARGET void P3DOF_NAME(powers_of)(ptrdiff_t n, double *const *force, double *const *speed, double *to,
                                               ptrdiff_t line)
{
    for (int leg = 0; leg < 3; ++leg) {
        const double *restrict f = force[leg], *restrict v = speed[leg];
        double *restrict power = to + leg * line;
        for (ptrdiff_t i = 0; i < n; ++i)
            power[i] = f[i] * v[i];
    }
}

/* Sums by lanes of weighted numbers. */
static P3DOF_TARGET void P3DOF_NAME(add_weighted)(ptrdiff_t n, const double *restrict weight, const double *restrict x,
                                                  double *restrict sum)
{
    for (ptrdiff_t i = 0; i < n; i += DESIGN_LANES) {
        P3DOF_SIMD
        for (int l = 0; l < DESIGN_LANES; ++l)
            sum[l] += weight[i + l] * x[i + l];
    }
}

/* In which steps a power turns: where it has one sign before and the other after; returns how many there are. */
static P3DOF_TARGET ptrdiff_t P3DOF_NAME(turns_of)(ptrdiff_t samples, const double *restrict power,
                                                   ptrdiff_t *restrict where)
{
    ptrdiff_t count = 0, i = 0;
    for (; i + DESIGN_LANES < samples; i += DESIGN_LANES) {
        int64_t some = 0;
        P3DOF_SIMD_ANY(some)
        for (int l = 0; l < DESIGN_LANES; ++l)
            some |= power[i + l] * power[i + l + 1] < 0.0 ? 1 : 0;
        for (int l = 0; some && l < DESIGN_LANES; ++l)
            if (power[i + l] * power[i + l + 1] < 0.0)
                where[count++] = i + l;
    }
    for (; i + 1 < samples; ++i)
        if (power[i] * power[i + 1] < 0.0)
            where[count++] = i;
    return count;
}

/* The work of a power from each sample to the next, by the polynomial through those around. */
static P3DOF_TARGET void P3DOF_NAME(steps_of)(const DesignMotion *motion, const double *restrict power,
                                              double *restrict step)
{
    const ptrdiff_t steps = motion->samples - 1, points = motion->points, before = points / 2 - 1;
    const ptrdiff_t last = motion->samples - points, padded = motion->padded;
    const double *restrict weight = motion->steps;
    const ptrdiff_t from = before > 0 ? before : 0, to = last + from + 1 < steps ? last + from + 1 : steps;
    const ptrdiff_t whole = to < DESIGN_LANES ? to : DESIGN_LANES; /* from here on rows are aligned */
    for (ptrdiff_t i = steps > 0 ? steps : 0; i < padded; ++i)
        step[i] = 0.0;
    for (ptrdiff_t i = 0; i < from && i < steps; ++i) {
        step[i] = 0.0;
        for (ptrdiff_t k = 0; k < points; ++k)
            step[i] += weight[k * padded + i] * power[k];
    }
    for (ptrdiff_t i = from; i < (points == 6 ? whole : to); ++i) {
        step[i] = 0.0;
        for (ptrdiff_t k = 0; k < points; ++k)
            step[i] += weight[k * padded + i] * power[i - from + k];
    }
    if (points == 6) {
        const double *restrict w1 = weight + padded, *restrict w2 = w1 + padded, *restrict w3 = w2 + padded;
        const double *restrict w4 = w3 + padded, *restrict w5 = w4 + padded;
        P3DOF_SIMD
        for (ptrdiff_t i = whole; i < to; ++i)
            step[i] = ((weight[i] * power[i - 2] + w1[i] * power[i - 1]) + (w2[i] * power[i] + w3[i] * power[i + 1])) +
                      (w4[i] * power[i + 2] + w5[i] * power[i + 3]);
    }
    for (ptrdiff_t i = to; i < steps; ++i) {
        step[i] = 0.0;
        for (ptrdiff_t k = 0; k < points; ++k)
            step[i] += weight[k * padded + i] * power[last + k];
    }
}

/* The least and the largest of a power, its work, and what is positive of its steps. */
static P3DOF_TARGET void P3DOF_NAME(reduce_power)(const DesignMotion *motion, const double *restrict power,
                                                  double *restrict step, DesignPower *restrict found)
{
    const double *restrict weight = motion->work;
    P3DOF_NAME(steps_of)(motion, power, step);
    for (ptrdiff_t i = 0; i < motion->padded; i += DESIGN_LANES) {
        P3DOF_SIMD
        for (int l = 0; l < DESIGN_LANES; ++l) {
            found->low[l] = power[i + l] < found->low[l] ? power[i + l] : found->low[l];
            found->high[l] = power[i + l] > found->high[l] ? power[i + l] : found->high[l];
            found->work[l] += weight[i + l] * power[i + l];
            found->given[l] += step[i + l] > 0.0 ? step[i + l] : 0.0;
        }
    }
}

#include "design_tracks.h"

static const DesignReductions P3DOF_NAME(REDUCTIONS) = {
    P3DOF_NAME(reduce_forces), P3DOF_NAME(reduce_slides),  P3DOF_NAME(reduce_demand),
    P3DOF_NAME(place),         P3DOF_NAME(powers_of),      P3DOF_NAME(reduce_power),  P3DOF_NAME(turns_of),
    P3DOF_NAME(steps_of),      P3DOF_NAME(add_weighted),   P3DOF_NAME(track),         P3DOF_NAME(track_size),
    P3DOF_NAME(add_products),  P3DOF_NAME(rates_of_power), P3DOF_NAME(add_rates),     P3DOF_NAME(margins_at),
};

/* Reductions of gradients: what is largest with how it changes there, and sums of changes. Part of design_figures.h. */

/* The largest of sign * x, in the order of samples, so that of equal ones the first counts. */
static P3DOF_TARGET void P3DOF_NAME(track)(ptrdiff_t n, const double *restrict x, const double *restrict rate,
                                           double sign, ptrdiff_t start, DesignTrack *restrict found)
{
    for (ptrdiff_t i = 0; i < n; i += DESIGN_LANES) {
        const double at = (double)(start + i);
        P3DOF_SIMD
        for (int l = 0; l < DESIGN_LANES; ++l) {
            const double value = sign * x[i + l];
            found->when[l] = value > found->top[l] ? at : found->when[l];
            found->rate[l] = value > found->top[l] ? sign * rate[i + l] : found->rate[l];
            found->top[l] = value > found->top[l] ? value : found->top[l];
        }
    }
}

/* The same of the size of x. */
static P3DOF_TARGET void P3DOF_NAME(track_size)(ptrdiff_t n, const double *restrict x, const double *restrict rate,
                                                ptrdiff_t start, DesignTrack *restrict found)
{
    for (ptrdiff_t i = 0; i < n; i += DESIGN_LANES) {
        const double at = (double)(start + i);
        P3DOF_SIMD
        for (int l = 0; l < DESIGN_LANES; ++l) {
            const double value = fabs(x[i + l]), none = x[i + l] < 0.0 ? -rate[i + l] : 0.0;
            const double grows = x[i + l] > 0.0 ? rate[i + l] : none;
            found->when[l] = value > found->top[l] ? at : found->when[l];
            found->rate[l] = value > found->top[l] ? grows : found->rate[l];
            found->top[l] = value > found->top[l] ? value : found->top[l];
        }
    }
}

/* Sums by lanes of weighted squares, and of weighted products with what x changes by. */
static P3DOF_TARGET void P3DOF_NAME(add_products)(ptrdiff_t n, const double *restrict weight, const double *restrict x,
                                                  const double *restrict rate, double *restrict squares,
                                                  double *restrict products)
{
    for (ptrdiff_t i = 0; i < n; i += DESIGN_LANES) {
        P3DOF_SIMD
        for (int l = 0; l < DESIGN_LANES; ++l) {
            squares[l] += weight[i + l] * (x[i + l] * x[i + l]);
            products[l] += weight[i + l] * (x[i + l] * rate[i + l]);
        }
    }
}

/* A power and how it changes, from force and speed and how these do. */
static P3DOF_TARGET void P3DOF_NAME(rates_of_power)(ptrdiff_t n, const double *restrict force,
                                                    const double *restrict force_rate, const double *restrict speed,
                                                    const double *restrict speed_rate, double *restrict power,
                                                    double *restrict rate)
{
    for (ptrdiff_t i = 0; i < n; ++i) {
        power[i] = force[i] * speed[i];
        rate[i] = force_rate[i] * speed[i] + force[i] * speed_rate[i];
    }
}

/* Sum by lanes of what changes where x is positive. */
static P3DOF_TARGET void P3DOF_NAME(add_rates)(ptrdiff_t n, const double *restrict x, const double *restrict rate,
                                               double *restrict sum)
{
    for (ptrdiff_t i = 0; i < n; i += DESIGN_LANES) {
        P3DOF_SIMD
        for (int l = 0; l < DESIGN_LANES; ++l)
            sum[l] += x[i + l] > 0.0 ? rate[i + l] : 0.0;
    }
}

/* The squared demand on leg C across its guide-way, and s |s| of the sine s of the angle from the actuation
 * singularity, of samples from `start` on. */
static P3DOF_TARGET void P3DOF_NAME(margins_at)(const DesignMotion *motion, const double *lengths,
                                                const double *offset, ptrdiff_t start, ptrdiff_t n,
                                                double *restrict demand, double *restrict sized)
{
    const double r = lengths[0], R = lengths[1], L = lengths[2], by = offset[0];
    const double *restrict y_row = motion->rows + start, *restrict sines = motion->sines + start;
    const double *restrict cosines = motion->cosines + start;
    const double turned_sin = offset[2] == 0.0 ? 0.0 : sin(offset[2]), turned_cos = cos(offset[2]);
    P3DOF_SIMD
    for (ptrdiff_t i = 0; i < n; ++i) {
        const double y = y_row[i] + by;
        const double cosine = cosines[i] * turned_cos - sines[i] * turned_sin;
        const double sine = sines[i] * turned_cos + cosines[i] * turned_sin;
        const double wc = R - r * cosine, u2 = (L - y) * (L + y);
        const double s = cosine * sqrt(u2 - wc * wc) - sine * wc;
        demand[i] = y * y + wc * wc;
        sized[i] = s * fabs(s) / u2;
    }
}

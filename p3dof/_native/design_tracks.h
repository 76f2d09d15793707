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
 * singularity. */
static P3DOF_TARGET void P3DOF_NAME(margins_at)(const double *lengths, ptrdiff_t n, const double *const *in,
                                                double *restrict demand, double *restrict sized)
{
    const double r = lengths[0], R = lengths[1], L = lengths[2];
    const double *restrict y = in[0], *restrict sine = in[ROW_SINE], *restrict cosine = in[ROW_COSINE];
    P3DOF_SIMD
    for (ptrdiff_t i = 0; i < n; ++i) {
        const double wc = R - r * cosine[i], u2 = (L - y[i]) * (L + y[i]);
        const double s = cosine[i] * sqrt(u2 - wc * wc) - sine[i] * wc;
        demand[i] = y[i] * y[i] + wc * wc;
        sized[i] = s * fabs(s) / u2;
    }
}

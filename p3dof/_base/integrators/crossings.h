/* Where a run crosses a limit: the first margin that is no more positive, within one step of an integrator.
 *
 * The limits are looked at every 2 ms at least, and where a margin turns around in between: one that falls at the
 * start of a piece and rises at its end, so steeply that its tangents lead to zero, is least where its rate is zero.
 *
 * Included, or pasted, once for each system of equations, with these defined before:
 *
 *   CROSSINGS_NAME(f)                              a name of its own for f;
 *   CROSSINGS_SIZE, CROSSINGS_COUNT                how many numbers a state has, and how many margins there are;
 *   CROSSINGS_CONTEXT                              a type: what the two below need;
 *   CROSSINGS_STATE(context, t, y)                 writes the state at a time within the step;
 *   CROSSINGS_MARGINS(context, t, y, margins, rates)
 *                                                  writes the margins of a state, positive inside of the limits, and
 *                                                  their rates at its velocity [1/s]: 0 of a margin that is infinite;
 *   CROSSINGS_TARGET                               attributes of every function, or nothing.
 *
 * C99, and <float.h>, <math.h> included before. There is no include guard, for it may serve several systems.
 */
#ifndef CROSSINGS_CHECKED
#define CROSSINGS_CHECKED 2e-3 /* s */
#define CROSSINGS_EXACT 1e-12  /* to which times are found [s] */
#endif

typedef struct {
    double margin[CROSSINGS_COUNT], rate[CROSSINGS_COUNT];
} CROSSINGS_NAME(look);

static CROSSINGS_TARGET void CROSSINGS_NAME(look_at)(CROSSINGS_CONTEXT context, double t, CROSSINGS_NAME(look) * look)
{
    double y[CROSSINGS_SIZE];
    CROSSINGS_STATE(context, t, y);
    CROSSINGS_MARGINS(context, t, y, look->margin, look->rate);
}

/* Whether a margin falls first and rises at last, so steeply that it may reach zero in between. */
static CROSSINGS_TARGET int CROSSINGS_NAME(turns)(const CROSSINGS_NAME(look) * first, const CROSSINGS_NAME(look) * last,
                                                  double span, int i)
{
    const int turned = (first->rate[i] < 0.0) & (last->rate[i] > 0.0);
    const int steep = (first->margin[i] + first->rate[i] * span <= 0.0) | (last->margin[i] - last->rate[i] * span <= 0.0);
    return turned & steep;
}

/* Whether a limit may be crossed in a step between two states: what costs a dense output. */
static CROSSINGS_TARGET int CROSSINGS_NAME(possible)(const CROSSINGS_NAME(look) * first,
                                                     const CROSSINGS_NAME(look) * last, double span)
{
    int found = span > CROSSINGS_CHECKED;
    for (int i = 0; i < CROSSINGS_COUNT; ++i)
        found |= (last->margin[i] <= 0.0) | CROSSINGS_NAME(turns)(first, last, span, i);
    return found;
}

/* Find where a margin, or its rate, is zero between two times: R. P. Brent, Algorithms for Minimization without
 * Derivatives, Prentice-Hall 1973, 4. */
static CROSSINGS_TARGET double CROSSINGS_NAME(root)(CROSSINGS_CONTEXT context, int i, int of_rate, double from,
                                                    double to, double at_from, double at_to)
{
    double a = from, b = to, fa = at_from, fb = at_to, c = a, fc = fa, step = b - a, before = step;
    CROSSINGS_NAME(look) look;

    for (int trial = 0; trial < 200; ++trial) {
        if ((fb > 0.0) == (fc > 0.0)) {
            c = a;
            fc = fa;
            step = before = b - a;
        }
        if (fabs(fc) < fabs(fb)) { /* b is the best so far, the root between it and c */
            a = b;
            b = c;
            c = a;
            fa = fb;
            fb = fc;
            fc = fa;
        }
        const double least = 2.0 * DBL_EPSILON * fabs(b) + 0.5 * CROSSINGS_EXACT, half = 0.5 * (c - b);
        if (fb == 0.0 || fabs(half) <= least)
            break;
        double p = half, q = 1.0;
        if (fabs(before) >= least && fabs(fa) > fabs(fb)) {
            const double s = fb / fa, u = fa / fc, v = fb / fc;
            p = a == c ? 2.0 * half * s : s * (2.0 * half * u * (u - v) - (b - a) * (v - 1.0));
            q = a == c ? 1.0 - s : (u - 1.0) * (v - 1.0) * (s - 1.0);
            q = p > 0.0 ? -q : q;
            p = fabs(p);
            const double far = 3.0 * half * q - fabs(least * q), slow = fabs(before * q);
            if (2.0 * p < (far < slow ? far : slow)) {
                before = step;
                step = p / q;
            }
            else {
                before = step = half;
            }
        }
        else {
            before = step = half;
        }
        a = b;
        fa = fb;
        b += fabs(step) > least ? step : half > 0.0 ? least : -least;
        CROSSINGS_NAME(look_at)(context, b, &look);
        fb = of_rate ? look.rate[i] : look.margin[i];
    }
    return b;
}

/* Return the margin that is crossed first between two looks, and when; -1 if none is. */
static CROSSINGS_TARGET int CROSSINGS_NAME(crossed)(CROSSINGS_CONTEXT context, double from,
                                                    const CROSSINGS_NAME(look) * before, double to,
                                                    const CROSSINGS_NAME(look) * after, double *when)
{
    int found = -1;
    for (int i = 0; i < CROSSINGS_COUNT; ++i) {
        if (!(after->margin[i] <= 0.0))
            continue;
        const double t = before->margin[i] > 0.0 ? CROSSINGS_NAME(root)(context, i, 0, from, to, before->margin[i],
                                                                        after->margin[i])
                                                 : from;
        if (found < 0 || t < *when) {
            found = i;
            *when = t;
        }
    }
    return found;
}

/* Return the margin that is crossed first in a piece of a step, and when; -1 if none is. */
static CROSSINGS_TARGET int CROSSINGS_NAME(in_piece)(CROSSINGS_CONTEXT context, double low,
                                                     const CROSSINGS_NAME(look) * first, double high,
                                                     const CROSSINGS_NAME(look) * last, double *when)
{
    double times[CROSSINGS_COUNT], from = low;
    CROSSINGS_NAME(look) before = *first, look;
    int turns = 0, found = -1;

    for (int i = 0; i < CROSSINGS_COUNT; ++i) {
        if (!(last->margin[i] > 0.0) || !CROSSINGS_NAME(turns)(first, last, high - low, i))
            continue;
        const double t = CROSSINGS_NAME(root)(context, i, 1, low, high, first->rate[i], last->rate[i]);
        int at = turns++;
        for (; at > 0 && times[at - 1] > t; --at)
            times[at] = times[at - 1];
        times[at] = t;
    }
    for (int k = 0; k < turns && found < 0; ++k) {
        CROSSINGS_NAME(look_at)(context, times[k], &look);
        found = CROSSINGS_NAME(crossed)(context, from, &before, times[k], &look, when);
        before = look;
        from = times[k];
    }
    return found < 0 ? CROSSINGS_NAME(crossed)(context, from, &before, high, last, when) : found;
}

/* Return the margin that is crossed first in a step, and when; -1 if none is. */
static CROSSINGS_TARGET int CROSSINGS_NAME(first)(CROSSINGS_CONTEXT context, double start, double end, double *when)
{
    const double count = ceil((end - start) / CROSSINGS_CHECKED), pieces = count > 1.0 ? count : 1.0;
    CROSSINGS_NAME(look) first, last;
    double low = start;
    int found = -1;

    CROSSINGS_NAME(look_at)(context, start, &first);
    for (double piece = 1.0; piece <= pieces && found < 0; piece += 1.0) {
        const double high = piece < pieces ? start + (end - start) * (piece / pieces) : end;
        CROSSINGS_NAME(look_at)(context, high, &last);
        found = CROSSINGS_NAME(in_piece)(context, low, &first, high, &last, when);
        first = last;
        low = high;
    }
    return found;
}

/* The classical Runge-Kutta method of order 4 in equal steps, with a dense output that is cubic in time.
 *
 * The steps and states are those of p3dof.runs.integration, but for rounding. With dop853.h it shares the names of
 * its functions and what they return, so that the same text can drive both.
 *
 * Included, or pasted, once for each system of equations, with these defined before:
 *
 *   RK4_NAME(f)                      a name of its own for f;
 *   RK4_SIZE                         how many numbers a state has;
 *   RK4_CONTEXT                      a type: what the rate needs, such as `const struct machine *`;
 *   RK4_RATE(context, t, y, rate)    writes the derivative of y[RK4_SIZE] at t; NaN where there is none;
 *   RK4_TARGET                       attributes of every function, or nothing.
 *
 * C99, and <float.h>, <math.h> included before. There is no include guard, for it may serve several systems.
 *
 *     RK4_NAME(solver) s;
 *     if (RK4_NAME(start)(&s, context, t, y, bound, longest))
 *         while (RK4_NAME(step)(&s, context) == RK4_RUNNING) {
 *             RK4_NAME(interpolate)(&s, context);      one evaluation, that the next step need not make again
 *             RK4_NAME(at)(&s, s.t_old + 0.5 * (s.t - s.t_old), y);
 *         }
 */
#ifndef RK4_STATUS
#define RK4_STATUS
enum {
    RK4_RUNNING,  /* a step was taken, there are more */
    RK4_FINISHED, /* a step was taken, the last */
};
#endif

typedef struct {
    double t, y[RK4_SIZE];         /* the end of the last step */
    double t_old, y_old[RK4_SIZE]; /* its beginning */
    double begin, bound, length;   /* of all steps, and of each */
    double count, done;            /* how many steps there are */
    double first[RK4_SIZE], last[RK4_SIZE]; /* rates at the beginning of the last step, and, if `known`, at its end */
    int known;
    long evaluations;
} RK4_NAME(solver);

/* Begin at a time and state, in equal steps to the bound, none longer than `longest`. Return whether the derivative there
 * is finite. `evaluations` begins with zero. */
static RK4_TARGET int RK4_NAME(start)(RK4_NAME(solver) * s, RK4_CONTEXT context, double t, const double *y, double bound,
                                      double longest)
{
    const double count = ceil((bound - t) / longest - 1e-9); /* a rest of less is rounding */
    int finite = 1;
    s->count = count > 1.0 ? count : 1.0;
    s->done = 0.0;
    s->t = s->t_old = s->begin = t;
    s->bound = bound;
    s->length = (bound - t) / s->count;
    s->evaluations = 1;
    for (int i = 0; i < RK4_SIZE; ++i)
        s->y[i] = s->y_old[i] = y[i];
    RK4_RATE(context, t, s->y, s->last);
    s->known = 1;
    for (int i = 0; i < RK4_SIZE; ++i)
        finite &= fabs(s->last[i]) <= DBL_MAX;
    return finite;
}

/* Compute the rate at the end of the last step, for the dense output. */
static RK4_TARGET void RK4_NAME(interpolate)(RK4_NAME(solver) * s, RK4_CONTEXT context)
{
    if (s->known)
        return;
    RK4_RATE(context, s->t, s->y, s->last);
    s->known = 1;
    ++s->evaluations;
}

/* Take a step. */
static RK4_TARGET int RK4_NAME(step)(RK4_NAME(solver) * s, RK4_CONTEXT context)
{
    const double h = s->length, half = 0.5 * h, middle = s->t + half;
    double k2[RK4_SIZE], k3[RK4_SIZE], k4[RK4_SIZE], trial[RK4_SIZE];
    RK4_NAME(interpolate)(s, context);
    s->t_old = s->t;
    for (int i = 0; i < RK4_SIZE; ++i) {
        s->y_old[i] = s->y[i];
        s->first[i] = s->last[i];
        trial[i] = s->y_old[i] + half * s->first[i];
    }
    RK4_RATE(context, middle, trial, k2);
    for (int i = 0; i < RK4_SIZE; ++i)
        trial[i] = s->y_old[i] + half * k2[i];
    RK4_RATE(context, middle, trial, k3);
    for (int i = 0; i < RK4_SIZE; ++i)
        trial[i] = s->y_old[i] + h * k3[i];
    RK4_RATE(context, s->t_old + h, trial, k4);
    for (int i = 0; i < RK4_SIZE; ++i)
        s->y[i] = s->y_old[i] + h / 6.0 * (s->first[i] + 2.0 * (k2[i] + k3[i]) + k4[i]);
    s->evaluations += 3;
    s->known = 0;
    s->done += 1.0;
    s->t = s->done < s->count ? s->begin + s->done * h : s->bound;
    return s->done < s->count ? RK4_RUNNING : RK4_FINISHED;
}

/* Write the state at a time within the last step, after `interpolate`. */
static RK4_TARGET void RK4_NAME(at)(const RK4_NAME(solver) * s, double t, double *y)
{
    const double h = s->t - s->t_old, x = (t - s->t_old) / h, rest = 1.0 - x;
    for (int i = 0; i < RK4_SIZE; ++i) {
        const double bend = (1.0 - 2.0 * x) * (s->y[i] - s->y_old[i]) + h * ((x - 1.0) * s->first[i] + x * s->last[i]);
        y[i] = rest * s->y_old[i] + x * s->y[i] - x * rest * bend;
    }
}

/* The steps of a run by one integrator: their limits and samples. Part of machine_run.h, once for every integrator.
 *
 * Defined before: SOLVER(f), the names of dop853.h or rk4.h, which return the same, and of these:
 *
 *   SOLVER(begin)(s, m, until)   start at m->t, m->y; return whether there is a way from there;
 *   SOLVER(whole)(s, m)          take one step for all, where that is cheaper and good enough; return whether it was;
 *   SOLVER(lost)(s)              whether the last step led nowhere;
 *   SOLVER(next)(s)              length of the next step, for the interval after this one;
 *   SOLVER(give_up)(m, until)    go on where there was no step to take from m->t, m->y.
 */

typedef struct {
    MachineRun *run;
    const SOLVER(solver) * solver;
} SOLVER(within);

#define CROSSINGS_NAME(f) SOLVER(limits_##f)
#define CROSSINGS_SIZE 6
#define CROSSINGS_COUNT LIMITS
#define CROSSINGS_CONTEXT const SOLVER(within) *
#define CROSSINGS_STATE(context, t, y) SOLVER(at)((context)->solver, t, y)
#define CROSSINGS_MARGINS(context, t, y, margin, rate) P3DOF_NAME(margins)((context)->run, y, margin, rate)
#define CROSSINGS_TARGET P3DOF_TARGET
#include "../_base/integrators/crossings.h"
#undef CROSSINGS_NAME
#undef CROSSINGS_SIZE
#undef CROSSINGS_COUNT
#undef CROSSINGS_CONTEXT
#undef CROSSINGS_STATE
#undef CROSSINGS_MARGINS
#undef CROSSINGS_TARGET

/* Whether a step may cross a limit: looked at as often as crossings.h does, many looks at a time. */
static P3DOF_TARGET int SOLVER(any_near)(const MachineRun *m, const SOLVER(solver) * s)
{
    double columns[6 + 2 * WATCHED + 1][LOOKS], y[6];
    const double *in[6], span = s->t - s->t_old, pieces = fmax(ceil(span / CROSSINGS_CHECKED), 1.0);
    double *out[2 * WATCHED + 1];
    for (int i = 0; i < 6; ++i)
        in[i] = columns[i];
    for (int i = 0; i < 2 * WATCHED + 1; ++i)
        out[i] = columns[6 + i];
    for (double done = 0.0; done < pieces; done += LOOKS - 1) {
        const ptrdiff_t n = pieces - done < LOOKS - 1 ? (ptrdiff_t)(pieces - done) : LOOKS - 1;
        for (ptrdiff_t k = 0; k <= n; ++k) {
            SOLVER(at)(s, s->t_old + span * ((done + (double)k) / pieces), y);
            for (int i = 0; i < 6; ++i)
                columns[i][k] = y[i];
        }
        m->limits.run(n + 1, m->limits.constants, in, out);
        for (int i = 0; i < LIMITS; ++i) {
            const int b = P3DOF_NAME(behind)[i];
            const double *value = b < 0 ? columns[2] : out[b], *rate = b < 0 ? columns[5] : out[WATCHED + b];
            if (m->counted[i] && P3DOF_NAME(suspicious)(n, value, rate, m->bound[i], m->sign[i], span / pieces))
                return 1;
        }
    }
    return 0;
}

/* Return the limit that a step crosses first, and when; -1 for none. */
static P3DOF_TARGET int SOLVER(crossing)(MachineRun *m, const SOLVER(solver) * s, double *when)
{
    const SOLVER(within) step = {m, s};
    return SOLVER(any_near)(m, s) ? SOLVER(limits_first)(&step, s->t_old, s->t, when) : -1;
}

/* Whether a step of 2 ms or less may cross a limit; the margins at its end are kept for the next one. */
static P3DOF_TARGET int SOLVER(short_step_near)(MachineRun *m, const SOLVER(solver) * s)
{
    SOLVER(limits_look) first, last;
    double found[PLACED];
    if (m->looked) {
        memcpy(first.margin, m->seen, sizeof first.margin);
        memcpy(first.rate, m->falling, sizeof first.rate);
    }
    else {
        P3DOF_NAME(margins)(m, s->y_old, first.margin, first.rate);
    }
    P3DOF_NAME(placed_margins)(m, s->y, last.margin, last.rate, found);
    memcpy(m->placed, found, sizeof m->placed); /* sliders 6, ... */
    m->placed[6] = found[9];
    memcpy(m->seen, last.margin, sizeof last.margin);
    memcpy(m->falling, last.rate, sizeof last.rate);
    m->looked = 1;
    return SOLVER(limits_possible)(&first, &last, s->t - s->t_old);
}

/* Take the samples up to a time, where a step reaches beyond them: one at a tick belongs to the hold that begins. */
static P3DOF_TARGET void SOLVER(sample_within)(MachineRun *m, const SOLVER(solver) * s, double last)
{
    double y[6];
    for (; P3DOF_NAME(samples_before)(m, last); ++m->next) {
        SOLVER(at)(s, m->times[m->next], y);
        P3DOF_NAME(record)(m, m->times[m->next], y);
    }
}

/* Whether too many steps were so short a share of the run that they lead nowhere. */
static P3DOF_TARGET int SOLVER(crawls)(MachineRun *m, const SOLVER(solver) * s, int status)
{
    const int tiny = status == DOP853_RUNNING && s->t - s->t_old < 1e-13 * m->times[m->samples - 1];
    m->crawled = tiny ? m->crawled + 1 : 0;
    return m->crawled >= 1000;
}

/* Look into a step: take its samples, and end the run where it crosses a limit. Return -1 if it goes on. */
static P3DOF_TARGET int SOLVER(look_into)(MachineRun *m, SOLVER(solver) * s)
{
    const int long_step = s->t - s->t_old > CROSSINGS_CHECKED;
    const int near = long_step || SOLVER(short_step_near)(m, s);
    double when = s->t;
    if (near || P3DOF_NAME(samples_before)(m, s->t)) {
        SOLVER(interpolate)(s, m);
        if (SOLVER(lost)(s))
            return RUN_FAILED;
        const int index = near ? SOLVER(crossing)(m, s, &when) : -1;
        SOLVER(sample_within)(m, s, when);
        if (index >= 0) {
            m->index = index;
            m->t = when;
            SOLVER(at)(s, when, m->y);
            return P3DOF_NAME(ended)(m, RUN_CROSSED);
        }
        m->looked &= !long_step;
    }
    return -1;
}

/* Integrate to a time. Return -1 if the run goes on from there. */
static P3DOF_TARGET int SOLVER(interval)(MachineRun *m, double until)
{
    SOLVER(solver) s;
    int status = DOP853_RUNNING, found = -1;
    long polled = 0;

    if (!SOLVER(begin)(&s, m, until)) {
        m->evaluations += s.evaluations;
        return m->beyond ? RUN_BEYOND : P3DOF_NAME(ended)(m, RUN_FAILED);
    }
    const int seen = until - m->t > CROSSINGS_CHECKED || P3DOF_NAME(samples_before)(m, until); /* looked into anyway */
    const int whole = !seen && SOLVER(whole)(&s, m);
    while (found < 0 && status == DOP853_RUNNING) {
        status = whole ? DOP853_FINISHED : SOLVER(step)(&s, m);
        if (m->beyond)
            found = RUN_BEYOND;
        else if (status == DOP853_FAILED || SOLVER(lost)(&s) || SOLVER(crawls)(m, &s, status))
            found = RUN_FAILED;
        else
            found = SOLVER(look_into)(m, &s);
        if (found < 0) {
            m->t = s.t;
            memcpy(m->y, s.y, sizeof m->y);
            if (P3DOF_NAME(polled)(m, s.evaluations - polled))
                found = RUN_INTERRUPTED;
            polled = s.evaluations;
        }
    }
    m->evaluations += s.evaluations;
    if (found == RUN_FAILED)
        return SOLVER(give_up)(m, until);
    m->step = SOLVER(next)(&s);
    return found;
}

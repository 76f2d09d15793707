/* A run of one machine, from event to event: DOP853 over its forward dynamics, forces held or not, limits watched.
 *
 * The same as p3dof.simulation.integration, which stays what it is compared with. Included once per level, with
 * P3DOF_NAME and P3DOF_TARGET defined by the includer; the kernels come as pointers, of the same level.
 */

static P3DOF_INLINE P3DOF_TARGET int P3DOF_NAME(all_finite)(const double *x, int n)
{
    int finite = 1;
    for (int i = 0; i < n; ++i)
        finite &= fabs(x[i]) <= DBL_MAX;
    return finite;
}

/* Run a kernel on one sample of consecutive inputs, to consecutive outputs. */
static P3DOF_INLINE P3DOF_TARGET void P3DOF_NAME(one)(const Bound *bound, int inputs, const double *from, int outputs,
                                                      double *to)
{
    const double *in[MOST_RUN_INPUTS];
    double *out[MOST_RUN_OUTPUTS];
    for (int k = 0; k < inputs; ++k)
        in[k] = from + k;
    for (int k = 0; k < outputs; ++k)
        out[k] = to + k;
    bound->run(1, bound->constants, in, out);
}

/* What acts on the machine */

/* Write the load at a time, linear between its rows. */
static P3DOF_TARGET void P3DOF_NAME(load_at)(MachineRun *m, double t, double *w)
{
    const double *times = m->load_time, *rows = m->load;
    const ptrdiff_t last = m->loads - 1;
    ptrdiff_t k = m->at_load;
    if (last == 0 || t <= times[0] || t >= times[last]) {
        const double *row = rows + (last > 0 && t >= times[last] ? 3 * last : 0);
        w[0] = row[0];
        w[1] = row[1];
        w[2] = row[2];
        return;
    }
    while (k > 0 && times[k] > t)
        --k;
    while (k < last - 1 && times[k + 1] <= t)
        ++k;
    m->at_load = k;
    for (int i = 0; i < 3; ++i)
        w[i] = (rows[3 * k + 3 + i] - rows[3 * k + i]) / (times[k + 1] - times[k]) * (t - times[k]) + rows[3 * k + i];
}

/* Write sliders and their velocities. */
static P3DOF_TARGET void P3DOF_NAME(place_sliders)(const MachineRun *m, const double *y, double *sliders)
{
    double found[8]; /* sliders 3; their rates by y 3; that of C by theta; margin */
    P3DOF_NAME(one)(&m->kinematics, 3, y, 8, found);
    for (int i = 0; i < 3; ++i) {
        sliders[i] = found[i];
        sliders[3 + i] = y[4] + found[3 + i] * y[3] + (i == 2 ? found[6] * y[5] : 0.0);
    }
}

/* Write what the drives deliver of the forces that are held, (3). */
static P3DOF_TARGET void P3DOF_NAME(delivered)(const MachineRun *m, double t, double *forces)
{
    for (int i = 0; i < 3; ++i) {
        const double rest = m->lag[i] < INFINITY ? exp(-m->lag[i] * (t - m->switched)) : 0.0;
        forces[i] = m->held[i] + (m->begun[i] - m->held[i]) * rest;
    }
}

/* Write the forces of A, B, C, and those asked for, (6). */
static P3DOF_TARGET void P3DOF_NAME(actuate)(const MachineRun *m, const double *y, double *forces)
{
    double sliders[6];
    if (m->drive != DRIVE_SPRINGS) {
        memcpy(forces, m->held, 6 * sizeof *forces);
        return;
    }
    P3DOF_NAME(place_sliders)(m, y, sliders);
    for (int i = 0; i < 3; ++i) {
        const double stretched = m->stiffness[i] * (sliders[i] - m->rest[i]);
        const double asked = m->preload[i] - stretched - m->damping[i] * sliders[3 + i];
        forces[3 + i] = asked;
        forces[i] = asked > m->cut[i] ? m->cut[i] : asked < -m->cut[i] ? -m->cut[i] : asked;
    }
}

/* Write the derivative of the state. The kernel reads and writes where numbers are: copies would be waited for. */
static P3DOF_TARGET void P3DOF_NAME(rate)(MachineRun *m, double t, const double *y, double *rate)
{
    double forces[6], load[3], margin;
    const double *acting = m->held;
    P3DOF_NAME(load_at)(m, t, load);
    if (m->period == 0.0 && m->drive != DRIVE_HELD) {
        P3DOF_NAME(actuate)(m, y, forces);
        acting = forces;
    }
    else if (m->lagging) {
        P3DOF_NAME(delivered)(m, t, forces);
        acting = forces;
    }
    const double *const in[12] = {y, y + 1, y + 2, y + 3, y + 4, y + 5, acting, acting + 1, acting + 2,
                                  load, load + 1, load + 2};
    double *const out[4] = {rate + 3, rate + 4, rate + 5, &margin};
    m->forward.run(1, m->forward.constants, in, out);
    for (int i = 0; i < 3; ++i)
        rate[i] = y[3 + i];
    if (!(fabs(y[1]) <= DBL_MAX)) /* z does not enter */
        rate[3] = NAN;
}

#define DOP853_NAME(f) P3DOF_NAME(motion_##f)
#define DOP853_SIZE 6
#define DOP853_CONTEXT MachineRun *
#define DOP853_RATE P3DOF_NAME(rate)
#define DOP853_TARGET P3DOF_TARGET
#include "../../integrators/dop853.h"
#undef DOP853_NAME
#undef DOP853_SIZE
#undef DOP853_CONTEXT
#undef DOP853_RATE
#undef DOP853_TARGET

/* The limits */

/* Which watched number is behind a margin. */
static const int P3DOF_NAME(behind)[LIMITS] = {0, 1, 2, 0, 1, 2, -1, -1, 3, 4, 5, 6};

typedef struct {
    MachineRun *run;
    const P3DOF_NAME(motion_solver) * solver;
} P3DOF_NAME(within);

/* Write the margins of a state, and their rates. Out of reach there are no angles: only the legs' margins count. */
static P3DOF_TARGET void P3DOF_NAME(margins)(const MachineRun *m, const double *y, double *margins, double *rates)
{
    double found[2 * WATCHED + 1];
    P3DOF_NAME(one)(&m->limits, 6, y, 2 * WATCHED + 1, found);
    const int placed = P3DOF_NAME(all_finite)(found, 2 * WATCHED);
    for (int i = 0; i < LIMITS; ++i) {
        const int k = P3DOF_NAME(behind)[i];
        margins[i] = m->counted[i] && placed ? m->sign[i] * ((k < 0 ? y[2] : found[k]) - m->bound[i]) : INFINITY;
        rates[i] = m->counted[i] && placed ? m->sign[i] * (k < 0 ? y[5] : found[WATCHED + k]) : 0.0;
    }
    if (!placed) {
        const double width = m->R - m->r, across = m->R - m->r * cos(y[2]);
        const double needed[3] = {fabs(width + y[0]), fabs(width - y[0]), hypot(y[0], across)};
        for (int i = 0; i < 3; ++i)
            margins[8 + i] = m->L - needed[i] < 0.0 ? m->L - needed[i] : 0.0;
    }
}

#define CROSSINGS_NAME(f) P3DOF_NAME(limits_##f)
#define CROSSINGS_SIZE 6
#define CROSSINGS_COUNT LIMITS
#define CROSSINGS_CONTEXT const P3DOF_NAME(within) *
#define CROSSINGS_STATE(context, t, y) P3DOF_NAME(motion_at)((context)->solver, t, y)
#define CROSSINGS_MARGINS(context, t, y, margin, rate) P3DOF_NAME(margins)((context)->run, y, margin, rate)
#define CROSSINGS_TARGET P3DOF_TARGET
#include "../../integrators/crossings.h"
#undef CROSSINGS_NAME
#undef CROSSINGS_SIZE
#undef CROSSINGS_COUNT
#undef CROSSINGS_CONTEXT
#undef CROSSINGS_STATE
#undef CROSSINGS_MARGINS
#undef CROSSINGS_TARGET

/* Whether a margin is crossed, or may turn around at zero, between n + 1 looks: the rule of crossings.h, in lanes. */
static P3DOF_TARGET int P3DOF_NAME(suspicious)(ptrdiff_t n, const double *value, const double *rate, double bound,
                                               double sign, double span)
{
    int64_t found = 0;
    for (ptrdiff_t k = 0; k < n; ++k) {
        const double first = sign * (value[k] - bound), last = sign * (value[k + 1] - bound);
        const double falling = sign * rate[k], rising = sign * rate[k + 1];
        const int64_t crossed = last > 0.0 ? 0 : 1; /* or NaN */
        const int64_t deep = (first + falling * span <= 0.0 ? 1 : 0) | (last - rising * span <= 0.0 ? 1 : 0);
        found |= crossed | (deep & (falling < 0.0 ? 1 : 0) & (rising > 0.0 ? 1 : 0));
    }
    return found != 0;
}

/* Whether a step may cross a limit: looked at as often as crossings.h does, many looks at a time. */
static P3DOF_TARGET int P3DOF_NAME(any_near)(const MachineRun *m, const P3DOF_NAME(motion_solver) * s)
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
            P3DOF_NAME(motion_at)(s, s->t_old + span * ((done + (double)k) / pieces), y);
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
static P3DOF_TARGET int P3DOF_NAME(crossing)(MachineRun *m, const P3DOF_NAME(motion_solver) * s, double *when)
{
    const P3DOF_NAME(within) step = {m, s};
    return P3DOF_NAME(any_near)(m, s) ? P3DOF_NAME(limits_first)(&step, s->t_old, s->t, when) : -1;
}

/* Whether a step of 2 ms or less may cross a limit; the margins at its end are kept for the next one. */
static P3DOF_TARGET int P3DOF_NAME(short_step_near)(MachineRun *m, const P3DOF_NAME(motion_solver) * s)
{
    P3DOF_NAME(limits_look) first, last;
    if (m->looked) {
        memcpy(first.margin, m->seen, sizeof first.margin);
        memcpy(first.rate, m->falling, sizeof first.rate);
    }
    else {
        P3DOF_NAME(margins)(m, s->y_old, first.margin, first.rate);
    }
    P3DOF_NAME(margins)(m, s->y, last.margin, last.rate);
    memcpy(m->seen, last.margin, sizeof last.margin);
    memcpy(m->falling, last.rate, sizeof last.rate);
    m->looked = 1;
    return P3DOF_NAME(limits_possible)(&first, &last, s->t - s->t_old);
}

/* The times */

/* By how much times may differ that are the same but for rounding. */
static P3DOF_INLINE P3DOF_TARGET double P3DOF_NAME(slack)(const MachineRun *m, double t)
{
    return fmax(1e-15 * t, 1e-9 * m->period);
}

/* When a step that begins at t must end: at a tick, a kink of the load, or the end of the run. */
static P3DOF_TARGET double P3DOF_NAME(until)(MachineRun *m)
{
    const double end = m->times[m->samples - 1], tick = m->ticks * m->period;
    double until = m->period > 0.0 && end - tick >= 1e-9 * m->period ? tick : end;
    while (m->kink < m->kink_count && m->kinks[m->kink] <= m->t + P3DOF_NAME(slack)(m, m->t))
        ++m->kink;
    return m->kink < m->kink_count && m->kinks[m->kink] < until ? m->kinks[m->kink] : until;
}

static P3DOF_TARGET void P3DOF_NAME(record)(MachineRun *m, double t, const double *y)
{
    double *row = m->out + ROW * m->count++;
    row[0] = t;
    memcpy(row + 1, y, 6 * sizeof *row);
    if (m->period > 0.0)
        memcpy(row + 7, m->held, 6 * sizeof *row);
    else
        P3DOF_NAME(actuate)(m, y, row + 7);
    if (m->lagging)
        P3DOF_NAME(delivered)(m, t, row + 7);
}

/* Take the sample that is due at t, if one is. */
static P3DOF_TARGET void P3DOF_NAME(sample_here)(MachineRun *m)
{
    if (m->next < m->samples && fabs(m->times[m->next] - m->t) <= P3DOF_NAME(slack)(m, m->t))
        P3DOF_NAME(record)(m, m->times[m->next++], m->y);
}

/* Take the samples up to a time, where a step reaches beyond them: one at a tick belongs to the hold that begins. */
static P3DOF_TARGET void P3DOF_NAME(sample_within)(MachineRun *m, const P3DOF_NAME(motion_solver) * s, double last)
{
    const double edge = last - P3DOF_NAME(slack)(m, last);
    double y[6];
    for (; m->next < m->samples && m->times[m->next] < edge; ++m->next) {
        P3DOF_NAME(motion_at)(s, m->times[m->next], y);
        P3DOF_NAME(record)(m, m->times[m->next], y);
    }
}

/* End a run early; where it ended is its last sample. */
static P3DOF_TARGET int P3DOF_NAME(ended)(MachineRun *m, int status)
{
    if (m->count == 0 || m->out[ROW * (m->count - 1)] < m->t)
        P3DOF_NAME(record)(m, m->t, m->y);
    return status;
}

/* Whether too many steps were so short a share of the run that they lead nowhere. */
static P3DOF_TARGET int P3DOF_NAME(crawls)(MachineRun *m, const P3DOF_NAME(motion_solver) * s, int status)
{
    const int tiny = status == DOP853_RUNNING && s->t - s->t_old < 1e-13 * m->times[m->samples - 1];
    m->crawled = tiny ? m->crawled + 1 : 0;
    return m->crawled >= 1000;
}

static P3DOF_TARGET int P3DOF_NAME(polled)(MachineRun *m, long evaluations)
{
    m->since_poll += evaluations;
    if (m->since_poll < POLL_AFTER)
        return 0;
    m->since_poll = 0;
    return m->poll && m->poll(m);
}

/* Look into a step: take its samples, and end the run where it crosses a limit. Return -1 if it goes on. */
static P3DOF_TARGET int P3DOF_NAME(look_into)(MachineRun *m, P3DOF_NAME(motion_solver) * s)
{
    const int long_step = s->t - s->t_old > CROSSINGS_CHECKED;
    const int near = long_step || P3DOF_NAME(short_step_near)(m, s);
    double when = s->t;
    if (near || (m->next < m->samples && m->times[m->next] < s->t)) {
        P3DOF_NAME(motion_interpolate)(s, m);
        const int index = near ? P3DOF_NAME(crossing)(m, s, &when) : -1;
        P3DOF_NAME(sample_within)(m, s, when);
        if (index >= 0) {
            m->index = index;
            m->t = when;
            P3DOF_NAME(motion_at)(s, when, m->y);
            return P3DOF_NAME(ended)(m, RUN_CROSSED);
        }
        m->looked &= !long_step;
    }
    return -1;
}

/* Integrate to a time. Return -1 if the run goes on from there. */
static P3DOF_TARGET int P3DOF_NAME(interval)(MachineRun *m, double until)
{
    P3DOF_NAME(motion_solver) s;
    const double first = m->step > 0.0 ? fmin(m->step, until - m->t) : 0.0;
    int status = DOP853_RUNNING, found = -1;

    if (!P3DOF_NAME(motion_start)(&s, m, m->t, m->y, until, first, m->rtol, m->atol, m->longest))
        found = RUN_FAILED;
    while (found < 0 && status == DOP853_RUNNING) {
        const long before = s.evaluations;
        status = P3DOF_NAME(motion_step)(&s, m);
        if (status == DOP853_FAILED || !P3DOF_NAME(all_finite)(s.k[12], 6) || P3DOF_NAME(crawls)(m, &s, status)) {
            found = RUN_FAILED;
            break;
        }
        found = P3DOF_NAME(look_into)(m, &s);
        if (found < 0) {
            m->t = s.t;
            memcpy(m->y, s.y, sizeof m->y);
            if (P3DOF_NAME(polled)(m, s.evaluations - before))
                found = RUN_INTERRUPTED;
        }
    }
    m->evaluations += s.evaluations;
    m->step = s.next;
    return found == RUN_FAILED ? P3DOF_NAME(ended)(m, found) : found;
}

/* Let what drives the run act at a tick. Return whether it has an answer. */
static P3DOF_TARGET int P3DOF_NAME(controlled)(MachineRun *m)
{
    double sliders[6];
    int good = 1;
    if (m->drive == DRIVE_SPRINGS)
        P3DOF_NAME(actuate)(m, m->y, m->held);
    if (m->drive != DRIVE_CONTROL)
        return 1;
    if (m->ticks >= (double)m->planned)
        return 0;
    P3DOF_NAME(place_sliders)(m, m->y, sliders);
    m->act(m, sliders);
    for (int i = 0; i < 6; ++i)
        good &= fabs(m->held[i]) < m->huge; /* not if it is NaN */
    return good;
}

/* Go on until the run ends or somebody else is to act. */
static P3DOF_TARGET int P3DOF_NAME(advance)(MachineRun *m)
{
    const double end = m->times[m->samples - 1];
    int found = -1;
    while (m->t < end && found < 0) {
        if (m->period > 0.0 && fabs(m->t - m->ticks * m->period) <= P3DOF_NAME(slack)(m, m->t)) {
            if (m->lagging && !m->answered)
                P3DOF_NAME(delivered)(m, m->t, m->before);
            if (m->outside && !m->answered) {
                m->answered = 1;
                return RUN_TICK;
            }
            if (!P3DOF_NAME(controlled)(m)) {
                found = RUN_BEYOND;
                break;
            }
            memcpy(m->begun, m->ticks > 0.0 ? m->before : m->held, sizeof m->begun); /* drives start settled */
            m->switched = m->t;
            m->ticks += 1.0;
            m->answered = 0;
        }
        P3DOF_NAME(sample_here)(m);
        found = P3DOF_NAME(interval)(m, P3DOF_NAME(until)(m));
    }
    if (found < 0)
        P3DOF_NAME(sample_here)(m);
    return found < 0 ? RUN_FINISHED : found;
}

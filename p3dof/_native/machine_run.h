/* A run of one machine, from event to event: DOP853 or equal steps of RK4 over its forward dynamics, forces held or not,
 * limits watched.
 *
 * The same as p3dof.runs.integration, which stays what it is compared with. Included once per level, with
 * P3DOF_NAME and P3DOF_TARGET defined by the includer; the kernels come as pointers, of the same level.
 */

static P3DOF_INLINE P3DOF_TARGET int P3DOF_NAME(all_finite)(const double *x, int n)
{
    int finite = 1;
    for (int i = 0; i < n; ++i)
        finite &= fabs(x[i]) <= DBL_MAX;
    return finite;
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
    double found[10][1];
    m->place((const double(*)[1])m->place_constants, (const double(*)[1])y, found);
    memcpy(sliders, found, 6 * sizeof *sliders);
}

/* Write what the drives deliver of the forces that are held, (3). */
static P3DOF_TARGET void P3DOF_NAME(delivered)(const MachineRun *m, double t, double *forces)
{
    for (int i = 0; i < 3; ++i) {
        const double rest = m->lag[i] < INFINITY ? exp(-m->lag[i] * (t - m->switched)) : 0.0;
        forces[i] = m->held[i] + (m->begun[i] - m->held[i]) * rest;
    }
}

/* The limits */

/* Which watched number is behind a margin. */
static const int P3DOF_NAME(behind)[LIMITS] = {0, 1, 2, 0, 1, 2, -1, -1, 3, 4, 5, 6};

/* Write the margins of a state, and their rates. Out of reach there are no angles: only the legs' margins count. */
static P3DOF_TARGET void P3DOF_NAME(placed_margins)(const MachineRun *m, const double *y, double *margins, double *rates,
                                                     double *found)
{
    m->watch((const double(*)[1])m->watch_constants, (const double(*)[1])y, (double(*)[1])found);
    const double *f = found;
    const double value[LIMITS] = {f[0], f[1], f[2], f[0], f[1], f[2], y[2], y[2], f[6], f[7], f[8], f[9]};
    const double rate[LIMITS] = {f[3], f[4], f[5], f[3], f[4], f[5], y[5], y[5], f[10], f[11], f[12], f[13]};
    const int placed = P3DOF_NAME(all_finite)(found, PLACED);
    for (int i = 0; i < LIMITS; ++i) {
        const double margin = m->sign[i] * (value[i] - m->bound[i]), change = m->sign[i] * rate[i];
        const int counts = m->counted[i] & placed;
        margins[i] = counts ? margin : INFINITY;
        rates[i] = counts ? change : 0.0;
    }
    if (!placed) {
        const double width = m->R - m->r, across = m->R - m->r * cos(y[2]);
        const double needed[3] = {fabs(width + y[0]), fabs(width - y[0]), hypot(y[0], across)};
        for (int i = 0; i < 3; ++i)
            margins[8 + i] = m->L - needed[i] < 0.0 ? m->L - needed[i] : 0.0;
    }
}

static P3DOF_TARGET void P3DOF_NAME(margins)(const MachineRun *m, const double *y, double *margins, double *rates)
{
    double found[PLACED];
    P3DOF_NAME(placed_margins)(m, y, margins, rates, found);
}

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

/* What drives it */

/* Forces that are no numbers, or huge, out of a controller that acts all the time: beyond a limit there are none, where a
 * step leads that is refused; elsewhere somebody else has to say what is wrong. */
static P3DOF_TARGET void P3DOF_NAME(no_answer)(MachineRun *m, const double *y, double *forces)
{
    double margins[LIMITS], rates[LIMITS];
    int beyond = 0;
    P3DOF_NAME(margins)(m, y, margins, rates);
    for (int i = 0; i < LIMITS; ++i)
        beyond |= !(margins[i] > 0.0);
    m->beyond |= !beyond;
    for (int i = 0; i < 6; ++i)
        forces[i] = NAN;
}

/* Write the forces of A, B, C, and those asked for, (6). */
static P3DOF_TARGET void P3DOF_NAME(actuate)(MachineRun *m, double t, const double *y, double *forces)
{
    double sliders[6];
    int good = 1;
    if (m->drive != DRIVE_SPRINGS && m->drive != DRIVE_FOLLOW) {
        memcpy(forces, m->held, 6 * sizeof *forces);
        return;
    }
    P3DOF_NAME(place_sliders)(m, y, sliders);
    if (m->drive == DRIVE_FOLLOW) {
        m->follow(m, t, sliders, forces);
        for (int i = 0; i < 6; ++i)
            good &= fabs(forces[i]) < m->huge; /* not if it is NaN */
        if (!good)
            P3DOF_NAME(no_answer)(m, y, forces);
        return;
    }
    for (int i = 0; i < 3; ++i) {
        const double stretched = m->stiffness[i] * (sliders[i] - m->rest[i]);
        const double asked = m->preload[i] - stretched - m->damping[i] * sliders[3 + i];
        forces[3 + i] = asked;
        forces[i] = asked > m->cut[i] ? m->cut[i] : asked < -m->cut[i] ? -m->cut[i] : asked;
    }
}

/* Whether forces and load stay until the next step that ends where they change. */
static P3DOF_INLINE P3DOF_TARGET int P3DOF_NAME(stays)(const MachineRun *m)
{
    return m->loads == 1 && !m->lagging && (m->period > 0.0 || m->drive == DRIVE_HELD);
}

/* Write the derivative of the state. The kernel reads and writes where numbers are: copies would be waited for. */
static P3DOF_TARGET void P3DOF_NAME(rate)(MachineRun *m, double t, const double *y, double *rate)
{
    double forces[6], now[6];
    const double *push = m->push;
    if (!P3DOF_NAME(stays)(m)) {
        if (m->lagging)
            P3DOF_NAME(delivered)(m, t, forces);
        else if (m->period > 0.0)
            memcpy(forces, m->held, sizeof forces);
        else
            P3DOF_NAME(actuate)(m, t, y, forces);
        memcpy(now, forces, 3 * sizeof *now);
        P3DOF_NAME(load_at)(m, t, now + 3);
        push = now;
    }
    memcpy(rate, y + 3, 3 * sizeof *rate); /* before the kernel: what the next pose needs does not wait for it */
    m->motion(m->motion_constants, y, push, rate + 3);
    if (!(fabs(y[1]) <= DBL_MAX)) /* z does not enter */
        rate[3] = NAN;
}

#define DOP853_NAME(f) P3DOF_NAME(motion_##f)
#define DOP853_SIZE 6
#define DOP853_CONTEXT MachineRun *
#define DOP853_RATE P3DOF_NAME(rate)
#define DOP853_TARGET P3DOF_TARGET
#include "../_base/integrators/dop853.h"
#undef DOP853_NAME
#undef DOP853_SIZE
#undef DOP853_CONTEXT
#undef DOP853_RATE
#undef DOP853_TARGET

#define RK4_NAME(f) P3DOF_NAME(equal_##f)
#define RK4_SIZE 6
#define RK4_CONTEXT MachineRun *
#define RK4_RATE P3DOF_NAME(rate)
#define RK4_TARGET P3DOF_TARGET
#include "../_base/integrators/rk4.h"
#undef RK4_NAME
#undef RK4_SIZE
#undef RK4_CONTEXT
#undef RK4_RATE
#undef RK4_TARGET

/* The times */

/* By how much times may differ that are the same but for rounding. */
static P3DOF_INLINE P3DOF_TARGET double P3DOF_NAME(slack)(const MachineRun *m, double t)
{
    return fmax(1e-15 * t, 1e-9 * m->period);
}

/* When the forces of the next tick that has not acted yet begin to act. */
static P3DOF_INLINE P3DOF_TARGET double P3DOF_NAME(acting)(const MachineRun *m)
{
    return (m->acted + m->whole + m->part) * m->period;
}

/* When a step that begins at t must end: at a tick, where forces change, at a kink of the load, or the end of the run. */
static P3DOF_TARGET double P3DOF_NAME(until)(MachineRun *m)
{
    const double end = m->times[m->samples - 1];
    double until = end;
    if (m->period > 0.0) {
        const double change = m->acted < m->ticks ? P3DOF_NAME(acting)(m) : INFINITY;
        const double next = fmin(m->ticks * m->period, change);
        until = end - next >= 1e-9 * m->period ? next : end;
    }
    while (m->kink < m->kink_count && m->kinks[m->kink] <= m->t + P3DOF_NAME(slack)(m, m->t))
        ++m->kink;
    return m->kink < m->kink_count && m->kinks[m->kink] < until ? m->kinks[m->kink] : until;
}

/* Whether a step that ends at a time has samples in it: one at its end belongs to what begins there. */
static P3DOF_INLINE P3DOF_TARGET int P3DOF_NAME(samples_before)(const MachineRun *m, double t)
{
    return m->next < m->samples && m->times[m->next] < t - P3DOF_NAME(slack)(m, t);
}

static P3DOF_TARGET void P3DOF_NAME(record)(MachineRun *m, double t, const double *y)
{
    if (m->room > 0 && m->count == m->room)
        m->full(m);
    double *row = m->out + ROW * m->count++;
    row[0] = m->recorded = t;
    memcpy(row + 1, y, 6 * sizeof *row);
    if (m->period > 0.0)
        memcpy(row + 7, m->held, 6 * sizeof *row);
    else
        P3DOF_NAME(actuate)(m, t, y, row + 7);
    if (m->lagging)
        P3DOF_NAME(delivered)(m, t, row + 7);
}

/* Take the sample that is due at t, if one is. */
static P3DOF_TARGET void P3DOF_NAME(sample_here)(MachineRun *m)
{
    if (m->next < m->samples && fabs(m->times[m->next] - m->t) <= P3DOF_NAME(slack)(m, m->t))
        P3DOF_NAME(record)(m, m->times[m->next++], m->y);
}

/* End a run early; where it ended is its last sample. */
static P3DOF_TARGET int P3DOF_NAME(ended)(MachineRun *m, int status)
{
    if ((m->count == 0 && m->recorded == 0.0) || m->recorded < m->t)
        P3DOF_NAME(record)(m, m->t, m->y);
    return status;
}

static P3DOF_TARGET int P3DOF_NAME(polled)(MachineRun *m, long evaluations)
{
    m->since_poll += evaluations;
    if (m->since_poll < POLL_AFTER)
        return 0;
    m->since_poll = 0;
    return m->poll && m->poll(m);
}

static P3DOF_TARGET int P3DOF_NAME(motion_begin)(P3DOF_NAME(motion_solver) * s, MachineRun *m, double until)
{
    const double first = m->step > 0.0 ? fmin(m->step, until - m->t) : 0.0;
    return P3DOF_NAME(motion_start)(s, m, m->t, m->y, until, first, m->rtol, m->atol, m->longest);
}

static P3DOF_TARGET int P3DOF_NAME(motion_whole)(P3DOF_NAME(motion_solver) * s, MachineRun *m)
{
    return P3DOF_NAME(motion_at_once)(s, m, m->trials);
}

static P3DOF_TARGET int P3DOF_NAME(motion_lost)(const P3DOF_NAME(motion_solver) * s)
{
    return !P3DOF_NAME(all_finite)(s->k[12], 6);
}

static P3DOF_TARGET double P3DOF_NAME(motion_next)(const P3DOF_NAME(motion_solver) * s)
{
    return s->next;
}

static P3DOF_TARGET int P3DOF_NAME(motion_give_up)(MachineRun *m, double until)
{
    (void)until;
    return P3DOF_NAME(ended)(m, RUN_FAILED);
}

#define SOLVER(f) P3DOF_NAME(motion_##f)
#include "machine_steps.h"
#undef SOLVER

static P3DOF_TARGET int P3DOF_NAME(equal_begin)(P3DOF_NAME(equal_solver) * s, MachineRun *m, double until)
{
    return P3DOF_NAME(equal_start)(s, m, m->t, m->y, until, m->longest);
}

static P3DOF_TARGET int P3DOF_NAME(equal_whole)(P3DOF_NAME(equal_solver) * s, MachineRun *m)
{
    (void)s;
    (void)m;
    return 0;
}

static P3DOF_TARGET int P3DOF_NAME(equal_lost)(const P3DOF_NAME(equal_solver) * s)
{
    return !P3DOF_NAME(all_finite)(s->y, 6) || (s->known && !P3DOF_NAME(all_finite)(s->last, 6));
}

static P3DOF_TARGET double P3DOF_NAME(equal_next)(const P3DOF_NAME(equal_solver) * s)
{
    return s->length;
}

/* Shorter steps may do where equal ones do not. */
static P3DOF_TARGET int P3DOF_NAME(equal_give_up)(MachineRun *m, double until)
{
    m->looked = 0;
    return P3DOF_NAME(motion_interval)(m, until);
}

#define SOLVER(f) P3DOF_NAME(equal_##f)
#include "machine_steps.h"
#undef SOLVER

/* Let what drives the run act at a tick. Return whether it has an answer. */
static P3DOF_TARGET int P3DOF_NAME(controlled)(MachineRun *m)
{
    double sliders[6];
    int good = 1;
    if (m->drive == DRIVE_SPRINGS)
        P3DOF_NAME(actuate)(m, m->t, m->y, m->given);
    if (m->drive != DRIVE_CONTROL)
        return 1;
    if (!m->looked)
        P3DOF_NAME(place_sliders)(m, m->y, sliders);
    m->act(m, m->looked ? m->placed : sliders);
    for (int i = 0; i < 6; ++i)
        good &= fabs(m->given[i]) < m->huge; /* not if it is NaN */
    return good;
}

/* Let the forces of the next tick act from now on; drives follow them from where they are. */
static P3DOF_TARGET void P3DOF_NAME(change_forces)(MachineRun *m)
{
    if (m->lagging)
        P3DOF_NAME(delivered)(m, m->t, m->begun);
    memcpy(m->held, m->late + 6 * ((ptrdiff_t)m->acted % m->ring), sizeof m->held);
    m->switched = m->t;
    m->acted += 1.0;
}

/* Let the controller act if its time has come, and the forces change that are due. Return a status, or -1 to go on. */
static P3DOF_TARGET int P3DOF_NAME(tick)(MachineRun *m)
{
    const double slack = P3DOF_NAME(slack)(m, m->t);
    if (fabs(m->t - m->ticks * m->period) <= slack) {
        if (m->outside && !m->answered) {
            m->answered = 1;
            return RUN_TICK;
        }
        if (m->drive == DRIVE_CONTROL && m->ticks >= (double)m->planned)
            return RUN_ROWS;
        if (!P3DOF_NAME(controlled)(m))
            return RUN_BEYOND;
        memcpy(m->late + 6 * ((ptrdiff_t)m->ticks % m->ring), m->given, sizeof m->given);
        if (m->ticks == 0.0) { /* until others act; drives start settled */
            memcpy(m->held, m->given, sizeof m->held);
            memcpy(m->begun, m->given, sizeof m->begun);
        }
        m->ticks += 1.0;
        m->answered = 0;
    }
    while (m->acted < m->ticks && P3DOF_NAME(acting)(m) <= m->t + slack)
        P3DOF_NAME(change_forces)(m);
    return -1;
}

/* Go on until the run ends or somebody else is to act. */
static P3DOF_TARGET int P3DOF_NAME(advance)(MachineRun *m)
{
    const double end = m->times[m->samples - 1];
    int found = -1;
    while (m->t < end && found < 0) {
        found = m->period > 0.0 ? P3DOF_NAME(tick)(m) : -1;
        if (found >= 0)
            return found;
        P3DOF_NAME(sample_here)(m);
        memcpy(m->push, m->held, 3 * sizeof *m->push);
        P3DOF_NAME(load_at)(m, m->t, m->push + 3);
        const double until = P3DOF_NAME(until)(m);
        found = m->scheme == STEPS_EQUAL ? P3DOF_NAME(equal_interval)(m, until) : P3DOF_NAME(motion_interval)(m, until);
    }
    if (found < 0)
        P3DOF_NAME(sample_here)(m);
    return m->beyond ? RUN_BEYOND : found < 0 ? RUN_FINISHED : found;
}

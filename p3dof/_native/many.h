/* Many runs at once, one in each lane: RK4 in equal steps, everything watched and summed up on the way. No Python here.
 *
 * Included once for every level and every width, with P3DOF_LANE(f), P3DOF_NAME(f), P3DOF_TARGET and P3DOF_LANES defined
 * by the includer. Every lane does the same operations whatever is in the others, so that a run does not depend on its
 * neighbours. Time is cut into ticks (those of the controller, or steps where there is none) and these into steps. Where
 * a step crosses a limit, or a leg is nearly horizontal so that equal steps are not accurate any more, the run goes on
 * carefully: alone, by DOP853 (careful.h).
 */
typedef struct {
    /* What is given, a row of `inputs`. */
    double place[lane_place_constants][P3DOF_LANES];
    double limits[lane_limits_constants][P3DOF_LANES];
    double motion[lane_motion_with_friction_constants][P3DOF_LANES]; /* fewer without friction */
    double load[3][P3DOF_LANES];
    double bound[4][P3DOF_LANES]; /* travel, tilt; infinite if they do not count */
    double side[1][P3DOF_LANES];  /* 1 or -1: the side of the singular pose to stay on; 0 for any */
    double x[6][P3DOF_LANES];
    P3DOF_LANE(Control) control;
    /* Where it is. */
    double at[10][P3DOF_LANES]; /* sliders 3, their velocities 3, cosines 4 */
    double force[3][P3DOF_LANES];
    /* What it leaves. */
    double error_peak[3][P3DOF_LANES], error_sum[3][P3DOF_LANES];
    double force_peak[3][P3DOF_LANES], force_sum[3][P3DOF_LANES];
    double work[1][P3DOF_LANES], energy[1][P3DOF_LANES], samples[1][P3DOF_LANES];
} P3DOF_LANE(State);

enum {
    P3DOF_LANE(rows) = sizeof(P3DOF_LANE(State)) / sizeof(double[P3DOF_LANES]),
    P3DOF_LANE(input_rows) = offsetof(P3DOF_LANE(State), control.goal) / sizeof(double[P3DOF_LANES]),
};

typedef struct {
    P3DOF_LANE(State) m;
    ptrdiff_t run[P3DOF_LANES], tick[P3DOF_LANES], before[P3DOF_LANES]; /* run: -1 for none */
    const double *noise[P3DOF_LANES];
} P3DOF_LANE(Work);

typedef const double (*P3DOF_LANE(Rows))[P3DOF_LANES];

static P3DOF_TARGET void P3DOF_LANE(locate)(P3DOF_LANE(State) * m)
{
    P3DOF_LANE(lane_place)((P3DOF_LANE(Rows))m->place, (P3DOF_LANE(Rows))m->x, m->at);
}

static P3DOF_INLINE P3DOF_TARGET void P3DOF_LANE(accelerate)(const Batch *b, const P3DOF_LANE(State) * m,
                                                             const double (*given)[P3DOF_LANES],
                                                             double (*found)[P3DOF_LANES])
{
    if (b->friction && b->symmetric)
        P3DOF_LANE(lane_motion_with_friction_symmetric)((P3DOF_LANE(Rows))m->motion, given, found);
    else if (b->friction)
        P3DOF_LANE(lane_motion_with_friction)((P3DOF_LANE(Rows))m->motion, given, found);
    else if (b->symmetric)
        P3DOF_LANE(lane_motion_symmetric)((P3DOF_LANE(Rows))m->motion, given, found);
    else
        P3DOF_LANE(lane_motion)((P3DOF_LANE(Rows))m->motion, given, found);
}

/* The forces at a state by feedback that acts continuously. */
static P3DOF_TARGET void P3DOF_LANE(feedback)(const Batch *b, P3DOF_LANE(State) * m, const double (*x)[P3DOF_LANES],
                                              double (*asked)[P3DOF_LANES], double (*force)[P3DOF_LANES])
{
    P3DOF_ALIGNED double at[10][P3DOF_LANES];
    P3DOF_LANE(lane_place)((P3DOF_LANE(Rows))m->place, x, at);
    P3DOF_LANE(control_feedback)(&b->path, &m->control, (P3DOF_LANE(Rows))at, asked);
    for (int i = 0; i < 3; ++i)
        P3DOF_SIMD
        for (int l = 0; l < P3DOF_LANES; ++l) {
            const double most = m->control.cut[i][l], wish = asked[i][l];
            force[i][l] = wish > most ? most : wish < -most ? -most : wish;
        }
}

/* Forces and load of a stage of a step, where the state is in the first rows: 0 at its beginning, 1 in its middle, 2 at
 * its end. */
static P3DOF_TARGET void P3DOF_LANE(acting)(const Batch *b, P3DOF_LANE(Work) * w, int step, int stage, const double *h,
                                            double (*given)[P3DOF_LANES])
{
    P3DOF_LANE(State) *m = &w->m;
    P3DOF_ALIGNED double after[P3DOF_LANES], asked[3][P3DOF_LANES];
    if (b->continuous) {
        P3DOF_LANE(feedback)(b, m, (P3DOF_LANE(Rows))given, asked, given + 6);
    }
    else {
        for (int l = 0; l < P3DOF_LANES; ++l)
            after[l] = 0.5 * stage * h[l];
        P3DOF_LANE(control_force)(&b->path, &m->control, after, given + 6);
    }
    if (!b->loads)
        return;
    for (int i = 0; i < 3; ++i)
        for (int l = 0; l < P3DOF_LANES; ++l)
            given[9 + i][l] = m->load[i][l] + b->loads[9 * (w->tick[l] * b->steps + step) + 3 * stage + i];
}

static P3DOF_TARGET void P3DOF_LANE(step)(const Batch *b, P3DOF_LANE(Work) * w, int step, const double *restrict h)
{
    P3DOF_LANE(State) *m = &w->m;
    P3DOF_ALIGNED double given[12][P3DOF_LANES], found[3][P3DOF_LANES];
    P3DOF_ALIGNED double sum[6][P3DOF_LANES]; /* k1 + 2 (k2 + k3) + k4 */
    static const double share[4] = {0.0, 0.5, 0.5, 1.0}, weight[4] = {1.0, 2.0, 2.0, 1.0};
    memcpy(given, m->x, sizeof m->x);
    memcpy(given + 9, m->load, sizeof m->load);
    for (int k = 0; k < 4; ++k) {
        if (k > 0) {
            for (int i = 0; i < 3; ++i)
                P3DOF_SIMD
                for (int l = 0; l < P3DOF_LANES; ++l) {
                    const double ahead = share[k] * h[l], speed = given[3 + i][l];
                    given[i][l] = m->x[i][l] + ahead * speed;
                    given[3 + i][l] = m->x[3 + i][l] + ahead * found[i][l];
                }
        }
        if (k != 2 || b->continuous)
            P3DOF_LANE(acting)(b, w, step, k == 3 ? 2 : k > 0, h, given);
        P3DOF_LANE(accelerate)(b, m, (P3DOF_LANE(Rows))given, found);
        for (int i = 0; i < 3; ++i)
            P3DOF_SIMD
            for (int l = 0; l < P3DOF_LANES; ++l) {
                sum[i][l] = (k ? sum[i][l] : 0.0) + weight[k] * given[3 + i][l];
                sum[3 + i][l] = (k ? sum[3 + i][l] : 0.0) + weight[k] * found[i][l];
            }
    }
    for (int i = 0; i < 6; ++i)
        P3DOF_SIMD
        for (int l = 0; l < P3DOF_LANES; ++l)
            m->x[i][l] += h[l] * (1.0 / 6.0) * sum[i][l];
}

/* Mark lanes where a number is not between two bounds, or turned around within a step so steeply that the tangents at
 * both of its ends lead beyond one. */
static P3DOF_INLINE P3DOF_TARGET void P3DOF_LANE(watch_range)(
    const double *restrict first, const double *restrict first_rate, const double *restrict last,
    const double *restrict last_rate, const double *restrict low, const double *restrict high,
    const double *restrict h, double *restrict beyond)
{
    P3DOF_SIMD
    for (int l = 0; l < P3DOF_LANES; ++l) {
        const double ahead = first[l] + first_rate[l] * h[l], back = last[l] - last_rate[l] * h[l];
        const double turned = first_rate[l] * last_rate[l] < 0.0 ? 1.0 : 0.0;
        const double down = ahead < back ? ahead : back, up = ahead < back ? back : ahead;
        double bad = last[l] > low[l] ? 0.0 : 1.0; /* or NaN */
        bad = last[l] < high[l] ? bad : 1.0;
        bad = down > low[l] ? bad : bad + turned;
        bad = up < high[l] ? bad : bad + turned;
        beyond[l] += bad;
    }
}

/* Mark lanes beyond a limit, or that may have been beyond one within a step whose beginning is given. */
static P3DOF_TARGET void P3DOF_LANE(watch)(const P3DOF_LANE(State) * m, const double (*before)[P3DOF_LANES],
                                           const double *restrict theta, const double *restrict rate,
                                           const double *restrict h, double *restrict beyond)
{
    P3DOF_SIMD
    for (int l = 0; l < P3DOF_LANES; ++l) {
        const double side = m->side[0][l], held = side * m->at[9][l];
        double bad = m->at[6][l] > MANY_HORIZONTAL ? 0.0 : 1.0;
        bad = m->at[7][l] > MANY_HORIZONTAL ? bad : 1.0;
        bad = m->at[8][l] > MANY_HORIZONTAL ? bad : 1.0;
        beyond[l] = held > 0.0 - (side == 0.0 ? 1.0 : 0.0) ? bad : 1.0;
    }
    for (int i = 0; i < 3; ++i)
        P3DOF_LANE(watch_range)
        (before[i], before[3 + i], m->at[i], m->at[3 + i], m->bound[0], m->bound[1], h, beyond);
    P3DOF_LANE(watch_range)(theta, rate, m->x[2], m->x[5], m->bound[2], m->bound[3], h, beyond);
}

/* Count the errors of the lanes with weight 1, not those with 0. */
static P3DOF_TARGET void P3DOF_LANE(sample_error)(const Batch *b, P3DOF_LANE(Work) * w, const double *restrict weight)
{
    P3DOF_LANE(State) *m = &w->m;
    P3DOF_ALIGNED double goal[P3DOF_LANES];
    P3DOF_SIMD
    for (int l = 0; l < P3DOF_LANES; ++l)
        m->samples[0][l] += weight[l];
    if (!b->reference)
        return;
    for (int i = 0; i < 3; ++i) {
        for (int l = 0; l < P3DOF_LANES; ++l)
            goal[l] = b->reference[3 * w->tick[l] + i];
        P3DOF_SIMD
        for (int l = 0; l < P3DOF_LANES; ++l) {
            const double error = m->x[i][l] - goal[l], size = weight[l] > 0.0 ? fabs(error) : 0.0;
            m->error_peak[i][l] = size > m->error_peak[i][l] ? size : m->error_peak[i][l];
            m->error_sum[i][l] += size * size;
        }
    }
}

static P3DOF_TARGET void P3DOF_LANE(sample_force)(P3DOF_LANE(State) * m, const double *restrict weight)
{
    for (int i = 0; i < 3; ++i)
        P3DOF_SIMD
        for (int l = 0; l < P3DOF_LANES; ++l) {
            const double size = weight[l] > 0.0 ? fabs(m->force[i][l]) : 0.0;
            m->force_peak[i][l] = size > m->force_peak[i][l] ? size : m->force_peak[i][l];
            m->force_sum[i][l] += size * size;
        }
}

/* Write a row of a history. */
static P3DOF_TARGET void P3DOF_LANE(keep)(const Batch *b, const P3DOF_LANE(State) * m, int l, ptrdiff_t run, ptrdiff_t row,
                                          double time)
{
    double *to = b->history + (run * b->rows + row) * MANY_HISTORY;
    to[0] = time;
    for (int i = 0; i < 6; ++i)
        to[1 + i] = m->x[i][l];
    for (int i = 0; i < 3; ++i) {
        to[7 + i] = m->force[i][l];
        to[10 + i] = m->control.asked[i][l];
    }
}

/* Write what a run leaves. */
static P3DOF_TARGET void P3DOF_LANE(conclude)(const Batch *b, const P3DOF_LANE(State) * m, int l, ptrdiff_t run, int stop,
                                              double time, int careful)
{
    double *to = b->results + run * MANY_RESULTS;
    const double samples = m->samples[0][l];
    *to++ = stop;
    *to++ = time;
    for (int i = 0; i < 6; ++i)
        *to++ = m->x[i][l];
    for (int i = 0; i < 3; ++i)
        *to++ = b->reference ? m->error_peak[i][l] : NAN;
    for (int i = 0; i < 3; ++i)
        *to++ = b->reference ? sqrt(m->error_sum[i][l] / samples) : NAN;
    for (int i = 0; i < 3; ++i)
        *to++ = m->force_peak[i][l];
    for (int i = 0; i < 3; ++i)
        *to++ = sqrt(m->force_sum[i][l] / samples);
    *to++ = m->work[0][l];
    *to++ = m->energy[0][l];
    *to++ = careful;
    *to = samples;
}

/* The forces at this state and time, for samples. */
static P3DOF_TARGET void P3DOF_LANE(update_force)(const Batch *b, P3DOF_LANE(State) * m)
{
    P3DOF_ALIGNED double now[P3DOF_LANES] = {0.0};
    if (b->continuous)
        P3DOF_LANE(feedback)(b, m, (P3DOF_LANE(Rows))m->x, m->control.asked, m->force);
    else
        P3DOF_LANE(control_force)(&b->path, &m->control, now, m->force);
}

/* Add the work of the actuators in a step: exact where forces are held. */
static P3DOF_TARGET void P3DOF_LANE(add_work)(P3DOF_LANE(State) * m, const double (*sliders)[P3DOF_LANES],
                                              const double (*force)[P3DOF_LANES])
{
    for (int i = 0; i < 3; ++i)
        P3DOF_SIMD
        for (int l = 0; l < P3DOF_LANES; ++l) {
            const double done = 0.5 * (force[i][l] + m->force[i][l]) * (m->at[i][l] - sliders[i][l]);
            m->work[0][l] += done;
            m->energy[0][l] += fabs(done);
        }
}

/* The controllers act, at each lane's tick. */
static P3DOF_TARGET void P3DOF_LANE(control)(const Batch *b, P3DOF_LANE(Work) * w)
{
    P3DOF_LANE(State) *m = &w->m;
    if (!b->continuous) {
        P3DOF_LANE(control_wanted)(&b->path, &m->control, w->tick);
        P3DOF_LANE(control_act)(&b->path, &m->control, w->tick, w->noise, (P3DOF_LANE(Rows))m->at);
        for (int l = 0; l < P3DOF_LANES; ++l)
            w->before[l] = w->tick[l] - 1;
        P3DOF_LANE(control_switch)(&b->path, &m->control, b->change[0] == 2 ? w->before : w->tick);
    }
    P3DOF_LANE(update_force)(b, m);
}

/* How long a step is in each lane: less at the end of the last tick. */
static P3DOF_TARGET void P3DOF_LANE(lengths)(const Batch *b, const P3DOF_LANE(Work) * w, int step, double *h)
{
    double begin = 0.0;
    for (int s = 0; s < step; ++s)
        begin += b->length[s];
    for (int l = 0; l < P3DOF_LANES; ++l) {
        h[l] = b->length[step];
        if (w->tick[l] == b->ticks - 1) {
            const double left = b->end - ((double)w->tick[l] * b->tick + begin);
            h[l] = left < h[l] * (1.0 + 1e-9) ? (left > 0.0 ? left : 0.0) : h[l];
        }
    }
}

/* Forces that are late by a part of a period change, where a run has not ended before. */
static P3DOF_TARGET void P3DOF_LANE(change)(const Batch *b, P3DOF_LANE(Work) * w, const double *h)
{
    for (int l = 0; l < P3DOF_LANES; ++l)
        w->before[l] = w->tick[l] - (h[l] > 0.0 ? 0 : 1);
    P3DOF_LANE(control_switch)(&b->path, &w->m.control, w->before);
    P3DOF_LANE(update_force)(b, &w->m);
}

#if P3DOF_LANES == 1
#include "careful.h"
#endif

/* Put a run into a lane. */
static P3DOF_TARGET void P3DOF_LANE(load_run)(const Batch *b, P3DOF_LANE(Work) * w, int l, ptrdiff_t run)
{
    double *rows = (double *)&w->m;
    const double *from = b->inputs + run * P3DOF_LANE(input_rows);
    for (int k = 0; k < P3DOF_LANE(rows); ++k)
        rows[k * P3DOF_LANES + l] = k < P3DOF_LANE(input_rows) ? from[k] : 0.0;
    w->run[l] = run;
    w->tick[l] = 0;
    w->noise[l] = b->noise ? b->noise + run * 6 * b->ticks : NULL;
}

/* Let the run of a lane go on alone, from the beginning of a step. */
static P3DOF_TARGET void P3DOF_LANE(go_on_alone)(const Batch *b, P3DOF_LANE(Work) * w, int l, int step)
{
    P3DOF_NAME(Work_single) one;
    const double *from = (const double *)&w->m;
    double *to = (double *)&one.m;
    for (int k = 0; k < P3DOF_LANE(rows); ++k)
        to[k] = from[k * P3DOF_LANES + l];
    one.run[0] = w->run[l];
    one.tick[0] = w->tick[l];
    one.noise[0] = w->noise[l];
    P3DOF_NAME(careful_single)(b, &one, step);
    w->run[l] = -1;
    w->tick[l] = 0;
}

/* At a tick: end runs, begin others, let controllers act. Return whether there is any. */
static P3DOF_TARGET int P3DOF_LANE(at_tick)(const Batch *b, P3DOF_LANE(Work) * w, ptrdiff_t *next, ptrdiff_t stop)
{
    P3DOF_LANE(State) *m = &w->m;
    P3DOF_ALIGNED double weight[P3DOF_LANES], none[P3DOF_LANES] = {0.0}, beyond[P3DOF_LANES];
    int any = 0, fresh = 0;
    for (int l = 0; l < P3DOF_LANES; ++l)
        weight[l] = w->run[l] >= 0 ? 1.0 : 0.0;
    P3DOF_LANE(sample_error)(b, w, weight);
    for (int l = 0; l < P3DOF_LANES; ++l)
        weight[l] = w->run[l] >= 0 && w->tick[l] == b->ticks ? 1.0 : 0.0;
    P3DOF_LANE(sample_force)(m, weight);
    for (int l = 0; l < P3DOF_LANES; ++l)
        if (weight[l] > 0.0) {
            if (b->history)
                P3DOF_LANE(keep)(b, m, l, w->run[l], (b->ticks + b->every - 1) / b->every, b->end);
            P3DOF_LANE(conclude)(b, m, l, w->run[l], MANY_FINISHED, b->end, 0);
            w->run[l] = -1;
            w->tick[l] = 0;
        }
    for (int l = 0; l < P3DOF_LANES; ++l)
        weight[l] = 0.0;
    do {
        fresh = 0;
        for (int l = 0; l < P3DOF_LANES; ++l)
            if (w->run[l] < 0 && *next < stop) {
                P3DOF_LANE(load_run)(b, w, l, (*next)++);
                weight[l] = fresh = 1;
            }
        if (!fresh)
            break;
        P3DOF_LANE(locate)(m);
        P3DOF_LANE(watch)(m, (P3DOF_LANE(Rows))m->at, m->x[2], m->x[5], none, beyond);
        for (int l = 0; l < P3DOF_LANES; ++l)
            if (w->run[l] >= 0 && weight[l] > 0.0 && beyond[l] != 0.0) {
                const double placed = m->at[6][l] + m->at[7][l] + m->at[8][l] + m->at[9][l] + m->x[1][l];
                P3DOF_LANE(conclude)
                (b, m, l, w->run[l], fabs(placed) <= DBL_MAX ? MANY_START : MANY_NOWHERE, 0.0, 0);
                w->run[l] = -1;
                weight[l] = 0.0;
            }
    } while (*next < stop);
    P3DOF_LANE(sample_error)(b, w, weight);
    for (int l = 0; l < P3DOF_LANES; ++l)
        any |= w->run[l] >= 0;
    if (!any)
        return 0;
    P3DOF_LANE(control)(b, w);
    for (int l = 0; l < P3DOF_LANES; ++l) {
        weight[l] = w->run[l] >= 0 ? 1.0 : 0.0;
        if (b->history && w->run[l] >= 0 && w->tick[l] % b->every == 0)
            P3DOF_LANE(keep)(b, m, l, w->run[l], w->tick[l] / b->every, (double)w->tick[l] * b->tick);
    }
    P3DOF_LANE(sample_force)(m, weight);
    for (int l = 0; l < P3DOF_LANES; ++l) {
        const double least = m->at[6][l] < m->at[7][l] ? m->at[6][l] : m->at[7][l];
        if (w->run[l] >= 0 && (least < b->near || m->at[8][l] < b->near))
            P3DOF_LANE(go_on_alone)(b, w, l, 0);
    }
    return 1;
}

/* One tick of all lanes. */
static P3DOF_TARGET void P3DOF_LANE(advance)(const Batch *b, P3DOF_LANE(Work) * w)
{
    P3DOF_LANE(State) *m = &w->m;
    P3DOF_ALIGNED double h[P3DOF_LANES], beyond[P3DOF_LANES], x[6][P3DOF_LANES], at[10][P3DOF_LANES],
        force[3][P3DOF_LANES], since[P3DOF_LANES];
    for (int s = 0; s < b->steps; ++s) {
        P3DOF_LANE(lengths)(b, w, s, h);
        if (s > 0 && b->change[s])
            P3DOF_LANE(change)(b, w, h);
        memcpy(x, m->x, sizeof x);
        memcpy(at, m->at, sizeof at);
        memcpy(force, m->force, sizeof force);
        memcpy(since, m->control.since[0], sizeof since);
        P3DOF_LANE(step)(b, w, s, h);
        P3DOF_LANE(locate)(m);
        P3DOF_LANE(watch)(m, (P3DOF_LANE(Rows))at, x[2], x[5], h, beyond);
        for (int l = 0; l < P3DOF_LANES; ++l)
            if (w->run[l] >= 0 && beyond[l] != 0.0) {
                for (int i = 0; i < 6; ++i)
                    m->x[i][l] = x[i][l];
                for (int i = 0; i < 10; ++i)
                    m->at[i][l] = at[i][l];
                P3DOF_LANE(go_on_alone)(b, w, l, s);
            }
        for (int l = 0; l < P3DOF_LANES; ++l)
            m->control.since[0][l] = since[l] + h[l];
        if (b->continuous || b->path.lagging)
            P3DOF_LANE(update_force)(b, m);
        P3DOF_LANE(add_work)(m, (P3DOF_LANE(Rows))at, (P3DOF_LANE(Rows))force);
    }
    for (int l = 0; l < P3DOF_LANES; ++l)
        w->tick[l] += w->run[l] >= 0;
}

/* Runs from `next` on, before `stop`; less if they are cancelled. */
static P3DOF_TARGET void P3DOF_LANE(many)(const Batch *b, void *work, ptrdiff_t next, ptrdiff_t stop)
{
    P3DOF_LANE(Work) *w = work;
    memset(w, 0, sizeof *w);
    for (int l = 0; l < P3DOF_LANES; ++l)
        w->run[l] = -1;
    while (!*b->cancel && P3DOF_LANE(at_tick)(b, w, &next, stop))
        P3DOF_LANE(advance)(b, w);
}

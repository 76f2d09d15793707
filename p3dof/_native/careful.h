/* A run alone, by DOP853 with its limits located: where equal steps are not good enough. Part of many.h, in one lane. */

typedef struct {
    const Batch *b;
    P3DOF_LANE(Work) * w;
    int step;
    double h;
} P3DOF_LANE(Step);

/* The derivative of the state, a time after the beginning of a step. */
static P3DOF_TARGET void P3DOF_LANE(careful_rate)(const P3DOF_LANE(Step) * s, double t, const double *x, double *rate)
{
    double given[12][1], found[3][1], asked[3][1];
    P3DOF_LANE(State) *m = &s->w->m;
    memcpy(given, x, 6 * sizeof *x);
    memcpy(given + 9, m->load, sizeof m->load);
    if (s->b->continuous)
        P3DOF_LANE(feedback)(s->b, m, (P3DOF_LANE(Rows))given, asked, given + 6);
    else
        P3DOF_LANE(control_force)(&s->b->path, &m->control, &t, given + 6);
    if (s->b->loads && s->h > 0.0) { /* the parabola through the three loads of the step */
        const double *row = s->b->loads + 9 * (s->w->tick[0] * s->b->steps + s->step), u = t / s->h;
        for (int i = 0; i < 3; ++i)
            given[9 + i][0] += row[i] * (1.0 - u) * (1.0 - 2.0 * u) + row[3 + i] * 4.0 * u * (1.0 - u) +
                               row[6 + i] * u * (2.0 * u - 1.0);
    }
    P3DOF_LANE(accelerate)(s->b, m, (P3DOF_LANE(Rows))given, found);
    const double nothing = x[1] - x[1]; /* z does not enter; NaN if it is not finite */
    for (int i = 0; i < 3; ++i) {
        rate[i] = x[3 + i] + nothing;
        rate[3 + i] = found[i][0] + nothing;
    }
}

#define DOP853_NAME(f) P3DOF_LANE(alone_##f)
#define DOP853_SIZE 6
#define DOP853_CONTEXT const P3DOF_LANE(Step) *
#define DOP853_RATE P3DOF_LANE(careful_rate)
#define DOP853_TARGET P3DOF_TARGET
#include "../_base/integrators/dop853.h"
#undef DOP853_NAME
#undef DOP853_SIZE
#undef DOP853_CONTEXT
#undef DOP853_RATE
#undef DOP853_TARGET

/* The margins of a state, in the order of p3dof.runs.margins, and their rates. */
static P3DOF_TARGET void P3DOF_LANE(careful_margins)(const P3DOF_LANE(State) * m, const double *x, double *margin,
                                                     double *rate)
{
    double given[6][1], found[14][1]; /* sliders, their velocities, cosines, their rates */
    memcpy(given, x, sizeof given);
    P3DOF_LANE(lane_limits)((P3DOF_LANE(Rows))m->limits, (P3DOF_LANE(Rows))given, found);
    for (int i = 0; i < 3; ++i) {
        margin[i] = found[i][0] - m->bound[0][0];
        margin[3 + i] = m->bound[1][0] - found[i][0];
        margin[8 + i] = found[6 + i][0] - MANY_HORIZONTAL;
        rate[i] = found[3 + i][0];
        rate[3 + i] = -found[3 + i][0];
        rate[8 + i] = found[10 + i][0];
    }
    margin[6] = x[2] - m->bound[2][0];
    margin[7] = m->bound[3][0] - x[2];
    rate[6] = x[5];
    rate[7] = -x[5];
    margin[11] = m->side[0][0] == 0.0 ? INFINITY : m->side[0][0] * found[9][0];
    rate[11] = m->side[0][0] * found[13][0];
    int real = 1;
    for (int i = 0; i < 13; ++i)
        real &= fabs(found[i][0]) <= DBL_MAX;
    for (int i = 0; i < MANY_LIMITS; ++i) {
        if (!real) { /* out of reach there are no angles: the legs' margins say so */
            margin[i] = i >= 8 && i < 11 && !(found[i - 2][0] > 0.0) ? -1.0 : INFINITY;
            rate[i] = 0.0;
        }
        if (!(fabs(margin[i]) <= DBL_MAX))
            rate[i] = 0.0;
    }
}

typedef struct {
    const P3DOF_LANE(State) * m;
    const P3DOF_LANE(alone_solver) * solver;
} P3DOF_LANE(Within);

#define CROSSINGS_NAME(f) P3DOF_LANE(careful_limits_##f)
#define CROSSINGS_SIZE 6
#define CROSSINGS_COUNT MANY_LIMITS
#define CROSSINGS_CONTEXT const P3DOF_LANE(Within) *
#define CROSSINGS_STATE(context, t, y) P3DOF_LANE(alone_at)((context)->solver, t, y)
#define CROSSINGS_MARGINS(context, t, y, margin, rate) P3DOF_LANE(careful_margins)((context)->m, y, margin, rate)
#define CROSSINGS_TARGET P3DOF_TARGET
#include "../_base/integrators/crossings.h"
#undef CROSSINGS_NAME
#undef CROSSINGS_SIZE
#undef CROSSINGS_COUNT
#undef CROSSINGS_CONTEXT
#undef CROSSINGS_STATE
#undef CROSSINGS_MARGINS
#undef CROSSINGS_TARGET

/* Integrate a step. Return what ends the run within it, and when, or MANY_FINISHED. */
static P3DOF_TARGET int P3DOF_LANE(careful_step)(const P3DOF_LANE(Step) * s, double *when)
{
    P3DOF_LANE(State) *m = &s->w->m;
    P3DOF_LANE(alone_solver) solver;
    P3DOF_LANE(careful_limits_look) first, last;
    P3DOF_LANE(Within) within = {m, &solver};
    int status = DOP853_RUNNING, failed = 0, short_steps = 0;
    double x[6];
    *when = 0.0;
    memcpy(x, m->x, sizeof x);
    if (!(s->h > 0.0))
        return MANY_FINISHED;
    P3DOF_LANE(careful_margins)(m, x, first.margin, first.rate);
    if (!P3DOF_LANE(alone_start)(&solver, s, 0.0, x, s->h, 0.0, s->b->rtol, s->b->atol, INFINITY))
        failed = 1;
    while (!failed && status == DOP853_RUNNING) {
        status = P3DOF_LANE(alone_step)(&solver, s);
        short_steps = solver.t - solver.t_old < 1e-13 * s->b->end ? short_steps + 1 : 0;
        if (status == DOP853_FAILED || short_steps > 1000) {
            failed = 1;
            break;
        }
        P3DOF_LANE(careful_margins)(m, solver.y, last.margin, last.rate);
        if (P3DOF_LANE(careful_limits_possible)(&first, &last, solver.t - solver.t_old)) {
            P3DOF_LANE(alone_interpolate)(&solver, s);
            const int index = P3DOF_LANE(careful_limits_first)(&within, solver.t_old, solver.t, when);
            if (index >= 0) {
                P3DOF_LANE(alone_at)(&solver, *when, x);
                memcpy(m->x, x, sizeof x);
                return index;
            }
        }
        first = last;
        memcpy(x, solver.y, sizeof x);
        *when = solver.t;
    }
    memcpy(m->x, x, sizeof x);
    if (!failed)
        return MANY_FINISHED;
    int near = 0;
    for (int i = 1; i < MANY_LIMITS; ++i)
        near = first.margin[i] < first.margin[near] ? i : near;
    return first.margin[near] < 1e-6 ? near : MANY_ACCURACY;
}

static P3DOF_TARGET int P3DOF_LANE(commanded)(const P3DOF_LANE(State) * m)
{
    int good = 1;
    for (int i = 0; i < 3; ++i)
        good &= fabs(m->force[i][0]) <= DBL_MAX && fabs(m->control.held[i][0]) <= DBL_MAX;
    return good;
}

/* Go on from the beginning of a step, at which the controller has acted already, to the end. */
static P3DOF_TARGET void P3DOF_LANE(careful)(const Batch *b, P3DOF_LANE(Work) * w, int step)
{
    P3DOF_LANE(State) *m = &w->m;
    P3DOF_LANE(Step) s = {b, w, 0, 0.0};
    double at[10][1], force[3][1], one[1] = {1.0}, begin = 0.0, when = 0.0;
    int stop = P3DOF_LANE(commanded)(m) ? MANY_FINISHED : MANY_CONTROLLER, switched = 1;
    for (int k = 0; k < step; ++k)
        begin += b->length[k];
    while (stop == MANY_FINISHED && w->tick[0] < b->ticks && !*b->cancel) {
        for (; step < b->steps && stop == MANY_FINISHED; ++step) {
            P3DOF_LANE(lengths)(b, w, step, &s.h);
            if (!switched && step > 0 && b->change[step])
                P3DOF_LANE(change)(b, w, &s.h);
            switched = 0;
            s.step = step;
            memcpy(at, m->at, sizeof at);
            memcpy(force, m->force, sizeof force);
            stop = P3DOF_LANE(careful_step)(&s, &when);
            P3DOF_LANE(locate)(m);
            m->control.since[0][0] += when;
            if (b->continuous || b->path.lagging)
                P3DOF_LANE(update_force)(b, m);
            P3DOF_LANE(add_work)(m, (P3DOF_LANE(Rows))at, (P3DOF_LANE(Rows))force);
            begin += stop == MANY_FINISHED ? s.h : when;
        }
        if (stop != MANY_FINISHED)
            break;
        step = 0;
        begin = 0.0;
        ++w->tick[0];
        P3DOF_LANE(sample_error)(b, w, one);
        if (w->tick[0] == b->ticks) {
            P3DOF_LANE(sample_force)(m, one);
            break;
        }
        P3DOF_LANE(control)(b, w);
        P3DOF_LANE(sample_force)(m, one);
        if (b->history && w->tick[0] % b->every == 0)
            P3DOF_LANE(keep)(b, m, 0, w->run[0], w->tick[0] / b->every, (double)w->tick[0] * b->tick);
        stop = P3DOF_LANE(commanded)(m) ? MANY_FINISHED : MANY_CONTROLLER;
    }
    if (*b->cancel && stop == MANY_FINISHED && w->tick[0] < b->ticks)
        return;
    const int ended = stop != MANY_FINISHED;
    const double time = ended ? (double)w->tick[0] * b->tick + begin : b->end;
    if (b->history)
        P3DOF_LANE(keep)(b, m, 0, w->run[0], ended ? w->tick[0] / b->every + 1 : (b->ticks + b->every - 1) / b->every, time);
    P3DOF_LANE(conclude)(b, m, 0, w->run[0], stop, time, 1);
}

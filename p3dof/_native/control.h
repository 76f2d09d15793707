/* The path from what sliders do to the forces on them, in lanes: encoders, controller, cut, delay, lag.
 *
 * The same as p3dof.runs.controllers and p3dof.runs.actuation. Included once for every level and
 * every width, with P3DOF_LANE(f), P3DOF_NAME(f), P3DOF_TARGET and P3DOF_LANES defined by the includer, after
 * generated/lane_kernels.h; one lane is a run by itself. No Python here.
 *
 * At every tick: control_wanted (what the table of the motion says), control_act (forces of this tick, into the queue of
 * those that are late), control_switch where forces change; control_force gives those on the machine at a time after the
 * last change. If forces are late by a part of a period, control_switch is called at the tick with the tick before it,
 * and with the tick itself when that part is over.
 */
#include "control_state.h"

/* Read the row of the table at each lane's tick. */
static P3DOF_TARGET void P3DOF_LANE(control_wanted)(const ControlPath *path, P3DOF_LANE(Control) * m,
                                                    const ptrdiff_t *tick)
{
    double(*rows[9])[P3DOF_LANES];
    int same = 1;
    if (!path->table)
        return;
    for (int i = 0; i < 9; ++i)
        rows[i] = path->kind == CONTROL_TORQUE ? &m->goal[i]
                  : i < 3                      ? &m->base[i]
                  : i < 6                      ? &m->wanted[i - 3]
                                               : &m->rate[i - 6];
    for (int l = 1; l < P3DOF_LANES; ++l)
        same &= tick[l] == tick[0];
    for (int i = 0; i < 9; ++i) {
        if (same) {
            const double number = path->table[9 * (tick[0] - path->first) + i];
            for (int l = 0; l < P3DOF_LANES; ++l)
                (*rows[i])[l] = number;
        }
        else {
            for (int l = 0; l < P3DOF_LANES; ++l)
                (*rows[i])[l] = path->table[9 * (tick[l] - path->first) + i];
        }
    }
}

/* What the encoders tell: positions 3, velocities 3. `noise` holds six normal numbers a tick of each lane. */
static P3DOF_TARGET void P3DOF_LANE(control_measure)(const ControlPath *path, P3DOF_LANE(Control) * m,
                                                     const ptrdiff_t *tick, const double *const *noise,
                                                     const double (*sliders)[P3DOF_LANES],
                                                     double (*seen)[P3DOF_LANES])
{
    memcpy(seen, sliders, 6 * sizeof *seen);
    if (path->noisy) {
        for (int l = 0; l < P3DOF_LANES; ++l)
            if (noise[l])
                for (int i = 0; i < 6; ++i)
                    seen[i][l] += m->sigma[i / 3][l] * noise[l][6 * (tick[l] - path->first) + i];
    }
    if (path->counting) {
        for (int i = 0; i < 3; ++i)
            P3DOF_SIMD
            for (int l = 0; l < P3DOF_LANES; ++l) {
                const double turned = seen[i][l] / m->count[i][l], rounded = rint(turned) * m->count[i][l];
                seen[i][l] = m->count[i][l] > 0.0 ? rounded : seen[i][l];
            }
    }
    if (path->differencing) {
        for (int i = 0; i < 3; ++i)
            for (int l = 0; l < P3DOF_LANES; ++l) {
                seen[3 + i][l] = tick[l] == 0 ? sliders[3 + i][l] : (seen[i][l] - m->last[i][l]) / path->period;
                m->last[i][l] = seen[i][l];
            }
    }
}

/* The forces that the model needs for a motion: pose, velocity, acceleration. */
static P3DOF_TARGET void P3DOF_LANE(control_inverse)(const ControlPath *path, const double (*state)[P3DOF_LANES],
                                                     double (*found)[P3DOF_LANES])
{
    if (path->rough && path->symmetric)
        P3DOF_LANE(lane_inverse_with_friction_symmetric)(path->inverse, state, found);
    else if (path->rough)
        P3DOF_LANE(lane_inverse_with_friction)(path->inverse, state, found);
    else if (path->symmetric)
        P3DOF_LANE(lane_inverse_symmetric)(path->inverse, state, found);
    else
        P3DOF_LANE(lane_inverse)(path->inverse, state, found);
}

/* Computed torque at a pose, where `next` tells how fast the platform moves, where it is half a hold later, and the least
 * of what is left of the legs' reach there. Rows of `nowhere` are 0, or NaN where there is no answer. */
static P3DOF_INLINE P3DOF_TARGET void P3DOF_LANE(control_torque_at)(const ControlPath *path, P3DOF_LANE(Control) * m,
                                                                    const double (*pose)[P3DOF_LANES],
                                                                    const double (*next)[P3DOF_LANES],
                                                                    const double *nowhere,
                                                                    double (*found)[P3DOF_LANES])
{
    P3DOF_ALIGNED double state[9][P3DOF_LANES];
    const double half = 0.5 * path->period;
    P3DOF_SIMD
    for (int l = 0; l < P3DOF_LANES; ++l) {
        const double frozen = m->saturated[0][l] + m->saturated[1][l] + m->saturated[2][l];
        for (int i = 0; i < 3; ++i) {
            const double error = m->goal[i][l] - pose[i][l], acceleration = m->goal[6 + i][l];
            m->integral[i][l] += frozen > 0.0 ? 0.0 : error * m->share[i][l];
            state[i][l] = next[6][l] > 0.0 ? next[3 + i][l] : pose[i][l];
            state[3 + i][l] = next[i][l] + half * acceleration;
            state[6 + i][l] = acceleration + m->gain[0][l] * (error + m->integral[i][l]) +
                              m->damping[0][l] * (m->goal[3 + i][l] - next[i][l]) + nowhere[l];
        }
    }
    P3DOF_LANE(control_inverse)(path, (const double(*)[P3DOF_LANES])state, found);
}

#if P3DOF_LANES == 1
/* The same where the encoders tell all and the model has the machine's lengths: what would be computed from the sliders is
 * the platform's own pose and velocity, `path->known`. Return whether half a hold later is within reach. */
static P3DOF_TARGET int P3DOF_LANE(control_torque_known)(const ControlPath *path, P3DOF_LANE(Control) * m,
                                                         double (*found)[1])
{
    const double half = 0.5 * path->period, none = 0.0, *x = path->known;
    double next[7][1] = {{x[3]}, {x[4]}, {x[5]}, {0.0}, {0.0}, {0.0}, {1.0}}, integral[3][1];
    int good = 1;
    memcpy(integral, m->integral, sizeof integral);
    for (int i = 0; i < 3; ++i)
        next[3 + i][0] = x[i] + half * (x[3 + i] + 0.5 * half * m->goal[6 + i][0]);
    P3DOF_LANE(control_torque_at)(path, m, (const double(*)[1])x, (const double(*)[1])next, &none, found);
    for (int i = 0; i < 3; ++i)
        good &= fabs(found[i][0]) <= DBL_MAX;
    if (!good)
        memcpy(m->integral, integral, sizeof integral);
    return good;
}
#endif

/* Computed torque: forces from what was measured, and the errors of the pose. */
static P3DOF_TARGET void P3DOF_LANE(control_torque)(const ControlPath *path, P3DOF_LANE(Control) * m,
                                                    const double (*seen)[P3DOF_LANES], double (*found)[P3DOF_LANES])
{
    P3DOF_ALIGNED double at[10][P3DOF_LANES], next[7][P3DOF_LANES], nowhere[P3DOF_LANES];
#if P3DOF_LANES == 1
    if (path->known && P3DOF_LANE(control_torque_known)(path, m, found))
        return;
#endif
    P3DOF_LANE(lane_assembly)(path->assembly, seen, at);
    for (int l = 0; l < P3DOF_LANES; ++l) {
        at[2][l] -= at[2][l] > 0x1.921fb54442d18p+0 ? 0x1.921fb54442d18p+2 : 0.0;
        nowhere[l] = at[3][l] > 0.0 ? 0.0 : NAN; /* a leg would stand above its slider */
    }
    memcpy(at + 3, seen + 3, 3 * sizeof *at);
    memcpy(at + 6, m->goal + 6, 3 * sizeof *at);
    for (int l = 0; l < P3DOF_LANES; ++l)
        at[9][l] = 0.5 * path->period;
    P3DOF_LANE(lane_torque)(path->torque, (const double(*)[P3DOF_LANES])at, next);
    P3DOF_LANE(control_torque_at)
    (path, m, (const double(*)[P3DOF_LANES])at, (const double(*)[P3DOF_LANES])next, nowhere, found);
}

/* Springs, constant forces, PD, PID, feedforward. */
static P3DOF_INLINE P3DOF_TARGET void P3DOF_LANE(control_feedback)(const ControlPath *path, P3DOF_LANE(Control) * m,
                                                                   const double (*seen)[P3DOF_LANES],
                                                                   double (*found)[P3DOF_LANES])
{
    for (int i = 0; i < 3; ++i)
        P3DOF_SIMD
        for (int l = 0; l < P3DOF_LANES; ++l) {
            const double error = m->wanted[i][l] - seen[i][l], rate = m->rate[i][l] - seen[3 + i][l];
            if (path->integrating)
                m->integral[i][l] += m->saturated[i][l] > 0.0 ? 0.0 : error * m->share[i][l];
            found[i][l] = m->base[i][l] + (m->gain[i][l] * (error + m->integral[i][l]) + m->damping[i][l] * rate);
        }
}

/* Let the controller act at each lane's tick; its forces wait in the queue. */
static P3DOF_TARGET void P3DOF_LANE(control_act)(const ControlPath *path, P3DOF_LANE(Control) * m, const ptrdiff_t *tick,
                                                 const double *const *noise, const double (*sliders)[P3DOF_LANES])
{
    P3DOF_ALIGNED double seen[6][P3DOF_LANES], found[6][P3DOF_LANES];
    P3DOF_LANE(control_measure)(path, m, tick, noise, sliders, seen);
    if (path->kind == CONTROL_TORQUE)
        P3DOF_LANE(control_torque)(path, m, (const double(*)[P3DOF_LANES])seen, found);
    else
        P3DOF_LANE(control_feedback)(path, m, (const double(*)[P3DOF_LANES])seen, found);
    for (int i = 0; i < 3; ++i)
        P3DOF_SIMD
        for (int l = 0; l < P3DOF_LANES; ++l) {
            const double asked = found[i][l], most = m->cut[i][l];
            const double force = asked > most ? most : asked < -most ? -most : asked;
            m->saturated[i][l] = force == asked ? 0.0 : 1.0;
            found[3 + i][l] = force;
        }
    if (path->ring == 1) {
        memcpy(m->late[0], found, sizeof found);
        return;
    }
    for (int l = 0; l < P3DOF_LANES; ++l)
        for (int i = 0; i < 6; ++i)
            m->late[tick[l] % path->ring][i][l] = found[i][l];
}

/* The forces on the machine, a time after the command began to act. */
static P3DOF_INLINE P3DOF_TARGET void P3DOF_LANE(control_force)(const ControlPath *path, const P3DOF_LANE(Control) * m,
                                                                const double *restrict after,
                                                                double (*force)[P3DOF_LANES])
{
    if (!path->lagging) {
        memcpy(force, m->held, sizeof m->held);
        return;
    }
    for (int i = 0; i < 3; ++i)
        for (int l = 0; l < P3DOF_LANES; ++l) {
            const double rest = m->lag[i][l] < INFINITY ? exp(-m->lag[i][l] * (m->since[0][l] + after[l])) : 0.0;
            force[i][l] = m->held[i][l] + (m->begun[i][l] - m->held[i][l]) * rest;
        }
}

/* Change the commands that act to those of `whole` ticks ago, or those of the first tick until there are any; drives
 * start settled. */
static P3DOF_TARGET void P3DOF_LANE(control_switch)(const ControlPath *path, P3DOF_LANE(Control) * m,
                                                    const ptrdiff_t *tick)
{
    P3DOF_ALIGNED double force[3][P3DOF_LANES], now[P3DOF_LANES] = {0.0};
    if (!path->lagging && path->ring == 1) {
        memcpy(m->asked, m->late[0], sizeof m->asked);
        memcpy(m->held, m->late[0] + 3, sizeof m->held);
        return;
    }
    P3DOF_LANE(control_force)(path, m, now, force);
    for (int l = 0; l < P3DOF_LANES; ++l) {
        const ptrdiff_t from = tick[l] > path->whole ? tick[l] - path->whole : 0;
        const double(*row)[P3DOF_LANES] = (const double(*)[P3DOF_LANES])m->late[from % path->ring];
        for (int i = 0; i < 3; ++i) {
            m->begun[i][l] = tick[l] <= 0 ? row[3 + i][l] : force[i][l];
            m->asked[i][l] = row[i][l];
            m->held[i][l] = row[3 + i][l];
        }
        m->since[0][l] = 0.0;
    }
}

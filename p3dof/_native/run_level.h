/* What lets a controller of control.h act on a run of machine_run.h, in one lane: at a tick, and at any time. No Python.
 *
 * Included once per level, after many_level.h. Without P3DOF_TARGET: at every level a motion is the same to the last bit.
 */

#include "follow.h"

/* Whether the forward kinematics of the sliders gives the platform's pose: on its side of the singular pose, in its turn. */
static int P3DOF_NAME(pose_is_told)(const MachineRun *m)
{
    return m->looked && m->placed[6] > 0.0 && m->y[2] <= 0x1.921fb5p+0 && m->y[2] > -0x1.2d97c7p+2;
}

static void P3DOF_NAME(control_tick)(MachineRun *m, const double *sliders)
{
    P3DOF_NAME(Control_single) *control = m->control;
    ControlPath *path = m->path;
    const ptrdiff_t tick = (ptrdiff_t)m->ticks;
    const double *noise = m->noise;
    path->known = m->exact && P3DOF_NAME(pose_is_told)(m) ? m->y : NULL;
    P3DOF_NAME(control_wanted_single)(path, control, &tick);
    P3DOF_NAME(control_act_single)(path, control, &tick, &noise, (const double(*)[1])sliders);
    memcpy(m->given, control->late[0][3], 3 * sizeof(double));
    memcpy(m->given + 3, control->late[0][0], 3 * sizeof(double));
}

static void P3DOF_NAME(control_follow)(MachineRun *m, double t, const double *sliders, double *forces)
{
    P3DOF_NAME(Control_single) *control = m->control;
    const ControlPath *path = m->path;
    Followed *followed = m->followed;
    const ptrdiff_t tick = 0;
    const double *noise = NULL;
    double goal[9][1], at[10][1];
    followed_at(followed, t, goal[0]);
    if (path->kind == CONTROL_TORQUE) {
        memcpy(control->goal, goal, sizeof goal);
        memset(control->integral, 0, sizeof control->integral); /* perhaps NaN after a trial */
    }
    else {
        P3DOF_NAME(lane_place_single)((const double(*)[1])followed->place, (const double(*)[1])goal, at);
        memcpy(control->wanted, at, sizeof control->wanted);
        memcpy(control->rate, at + 3, sizeof control->rate);
        if (followed->forward)
            P3DOF_NAME(control_inverse_single)(path, (const double(*)[1])goal, control->base);
    }
    P3DOF_NAME(control_act_single)(path, control, &tick, &noise, (const double(*)[1])sliders);
    memcpy(forces, control->late[0][3], 3 * sizeof(double));
    memcpy(forces + 3, control->late[0][0], 3 * sizeof(double));
}

/* What CasADi calls, around the C of `p3dof loop codegen --prefix robot`: accelerations of the motors y, for x = (y, dy/dt)
 * and their forces u, and the Jacobian. The compiler is given AT_Q, AT_V and HOME. What is out of reach returns 1. */
#include <math.h>
#include "robot.h"

typedef long long int integer;
enum { N = ROBOT_INDEPENDENT, M = ROBOT_MOTORS };
static const int at[N] = AT_Q, row[N] = AT_V;
static const double home[ROBOT_NQ] = HOME;

/* Close the loops at y, from home in pieces of 0.2 [rad or m]: always on the branch of home. */
static int closed(const double *y, robot_state *state)
{
    double far = y ? 0.0 : 100.0;
    int i, k, pieces;
    for (i = 0; y && i < N; ++i)
        far += fabs(y[i] - home[at[i]]);
    if (!(far < 100.0) || robot_start(state, home) != ROBOT_OK)
        return 0;
    for (k = 1, pieces = 1 + (int)(far / 0.2); k <= pieces; ++k) {
        for (i = 0; i < N; ++i)
            state->q[at[i]] = home[at[i]] + k * (y[i] - home[at[i]]) / pieces;
        if (robot_start(state, state->q) != ROBOT_OK)
            return 0;
    }
    return 1;
}

int dynamics(const double **arg, double **res, integer *iw, double *w, int memory)
{
    double q[ROBOT_NQ], rate[ROBOT_NQ], v[ROBOT_NV], a[ROBOT_NV];
    robot_state at_y;
    (void)iw, (void)w, (void)memory;
    return !closed(arg[0], &at_y) || robot_flow(at_y.q, arg[0] + N, arg[1], q, rate, res[0], v, a, 0) != ROBOT_OK;
}

int jac_dynamics(const double **arg, double **res, integer *iw, double *w, int memory)
{
    double along[2 * N + M] = {0}, a[ROBOT_NV], da[ROBOT_NV], *dv = along + N, *du = along + 2 * N;
    robot_state at_y;
    int i, k, known = closed(arg[0], &at_y);
    for (k = 0; known && k < 2 * N + M; along[k++] = 0.0) {
        double *by = k < 2 * N ? res[0] : res[1], *column = by ? by + N * (k < 2 * N ? k : k - 2 * N) : 0;
        along[k] = 1.0;
        known = robot_tangent_of_accelerations(at_y.q, arg[0] + N, arg[1], along, dv, du, a, da, 0) == ROBOT_OK;
        for (i = 0; column && i < N; ++i)
            column[i] = da[row[i]];
    }
    return (void)iw, (void)w, (void)memory, !known;
}

static const integer of_x[] = {2 * N, 1, 1}, of_u[] = {M, 1, 1}, of_a[] = {N, 1, 1}, by_x[] = {N, 2 * N, 1}, by_u[] = {N, M, 1};
integer dynamics_n_in(void) { return 2; }
integer dynamics_n_out(void) { return 1; }
const integer *dynamics_sparsity_in(integer i) { return i ? of_u : of_x; }
const integer *dynamics_sparsity_out(integer i) { return i ? 0 : of_a; }
integer jac_dynamics_n_in(void) { return 3; }
integer jac_dynamics_n_out(void) { return 2; }
const integer *jac_dynamics_sparsity_in(integer i) { return i == 2 ? of_a : dynamics_sparsity_in(i); }
const integer *jac_dynamics_sparsity_out(integer i) { return i ? by_u : by_x; }

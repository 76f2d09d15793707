/* What a controller follows that acts all the time: a motion, quintic between its samples, at any time. No Python here.
 *
 * The same as p3dof.runs.controllers.
 */

/* Write pose, velocity and acceleration at a time, (9). */
static void followed_at(Followed *f, double t, double *goal)
{
    const int before = t < 0.0 || f->pieces == 0, after = !(t <= f->duration * (1.0 + 1e-14));
    if (before || after) {
        memset(goal, 0, 9 * sizeof *goal);
        memcpy(goal, before ? f->first : f->last, sizeof f->first);
        return;
    }
    t = t < f->duration ? t : f->duration;
    ptrdiff_t k = f->at;
    while (k > 0 && f->breaks[k] > t)
        --k;
    while (k < f->pieces - 1 && f->breaks[k + 1] <= t)
        ++k;
    f->at = k;
    const double s = t - f->breaks[k], *c = f->curve + 18 * k;
    for (int i = 0; i < 3; ++i) {
        double value = c[i], rate = 0.0, bend = 0.0; /* bend: half the second derivative */
        for (int j = 1; j < 6; ++j) {
            bend = bend * s + rate;
            rate = rate * s + value;
            value = value * s + c[3 * j + i];
        }
        goal[i] = value;
        goal[3 + i] = rate;
        goal[6 + i] = 2.0 * bend;
    }
}

/* What many.h is given: many runs at once. No Python here. */

enum {
    MANY_RESULTS = 24, /* stop, time, pose and velocity 6, peak and RMS error 3 + 3, the same of forces 3 + 3, work,
                        * energy, whether it went on carefully, samples */
    MANY_HISTORY = 13, /* time, pose and velocity 6, forces 3, forces asked for 3 */
    MANY_LIMITS = 12,
    MOST_STEPS = 4096, /* in a tick */
};
/* Stops besides the limits 0 ... 11. */
enum { MANY_FINISHED = -1, MANY_ACCURACY = 12, MANY_CONTROLLER = 13, MANY_START = 14, MANY_NOWHERE = 15 };
static const double MANY_HORIZONTAL = 1e-3; /* a leg is at its reach: share of its length that it hangs down */

typedef struct {
    ControlPath path;
    int continuous; /* feedback at every evaluation instead of at ticks */
    int symmetric;
    int friction; /* of the joints */
    ptrdiff_t ticks, every, rows; /* of a run; a row of the history every so many; rows of a history */
    int steps;                    /* of a tick */
    const double *length;         /* of each step [s] */
    const int64_t *change;        /* whether forces change at its beginning; 2 at a tick: they are late by a part of it */
    double tick, end, near, rtol, atol;
    const double *reference; /* pose 3 a tick, one more at the end; or NULL */
    const double *loads;     /* F_y, F_z, M_y at the beginning, middle and end of each step of each tick; or NULL */
    const double *inputs, *noise;
    double *results, *history;
    volatile const int64_t *cancel;
} Batch;

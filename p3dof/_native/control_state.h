/* What control.h works on: the path from the sliders to the forces, and where it is in lanes.
 *
 * Included once for every level and every width, as control.h is, and once by `_compiled.c`, for one lane.
 */
#ifndef CONTROL_PATH
#define CONTROL_PATH
enum {
    CONTROL_FEEDBACK, /* base + gain (wanted - position + integral) + damping (rate - velocity) */
    CONTROL_TORQUE,   /* inverse dynamics of a model; gain, damping [0] are omega^2 and 2 zeta omega */
};
enum {
    MOST_LATE = 16,       /* whole periods that forces may be late */
    FEEDBACK_COLUMNS = 9, /* of the table: base 3, wanted positions 3, velocities 3 */
    TORQUE_COLUMNS = 9,   /* pose 3, velocity 3, acceleration in the middle of the hold 3 */
};

/* What is the same for all lanes. */
typedef struct {
    int kind, noisy, counting, differencing, lagging, integrating;
    int symmetric, rough; /* the controller's model: whether its bodies are, whether its joints have friction */
    int whole;           /* periods that forces are late; a rest of one is up to the caller */
    int ring;            /* places in the queue: 1 if nothing is late, else whole + 2 */
    double period;
    const double *table; /* one row a tick; NULL: base, wanted and rate of the lanes stay */
    ptrdiff_t first;     /* the tick of the first row, and of the first six normal numbers */
    const double *assembly, *torque, *inverse; /* constants of the controller's model */
    const double *known; /* of one lane: pose and velocity, where measuring them gives just these; or NULL */
} ControlPath;
#endif

typedef struct {
    /* What is given. */
    double gain[3][P3DOF_LANES], damping[3][P3DOF_LANES];
    double share[3][P3DOF_LANES]; /* of an error that a period adds to the integral: period / T */
    double base[3][P3DOF_LANES], wanted[3][P3DOF_LANES], rate[3][P3DOF_LANES];
    double cut[3][P3DOF_LANES];   /* largest force, or infinity */
    double count[3][P3DOF_LANES]; /* of the encoders, 0 for any number [m] */
    double sigma[2][P3DOF_LANES]; /* of positions and velocities */
    double lag[3][P3DOF_LANES];   /* 2 pi bandwidth [1/s], or infinity */
    /* Where it is. */
    double goal[9][P3DOF_LANES];  /* of CONTROL_TORQUE: a row of its table */
    double integral[3][P3DOF_LANES], saturated[3][P3DOF_LANES], last[3][P3DOF_LANES];
    double asked[3][P3DOF_LANES], held[3][P3DOF_LANES]; /* of the command that acts */
    double begun[3][P3DOF_LANES];  /* forces when it began to act */
    double since[1][P3DOF_LANES];  /* how long it has acted [s] */
    double late[MOST_LATE + 2][6][P3DOF_LANES];
} P3DOF_LANE(Control);

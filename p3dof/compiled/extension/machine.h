/* A run of one machine in time: what it is given, and what it leaves. No Python here; see machine_run.h. */

typedef void Run(ptrdiff_t, const double *, const double *const *, double *const *); /* a batch kernel */

enum {
    LIMITS = 12,  /* three sliders at either end, two of the tilt, three legs' reach, the singular pose */
    WATCHED = 7,  /* sliders A, B, C; cosines of the legs' drops; that of the platform's arm */
    LOOKS = 65,   /* at the limits at a time */
    POLL_AFTER = 100000, /* evaluations, some milliseconds */
    MOST_RUN_INPUTS = 12,
    MOST_RUN_OUTPUTS = 15,
    ROW = 13,     /* of a sample: time, pose, velocity, forces, forces asked for */
};

enum {
    RUN_FINISHED,
    RUN_TICK,        /* a controller from outside is to fill `held` */
    RUN_CROSSED,     /* a limit, `index` */
    RUN_FAILED,      /* no step is small enough */
    RUN_INTERRUPTED, /* `poll` asked for it */
    RUN_BEYOND,      /* a controller has no answer, or one that needs a second look */
};

enum { DRIVE_HELD, DRIVE_SPRINGS, DRIVE_CONTROL };

typedef struct {
    Run *run;
    const double *constants;
} Bound; /* a kernel of one machine */

typedef struct MachineRun MachineRun;

struct MachineRun {
    /* The machine. */
    Bound forward, kinematics, limits; /* accelerations; sliders and their Jacobian; what limits are made of */
    double r, R, L;
    double bound[LIMITS], sign[LIMITS]; /* margin = sign (value - bound) */
    int counted[LIMITS];
    /* What acts on it. */
    int drive;
    double stiffness[3], rest[3], damping[3], preload[3]; /* of `DRIVE_SPRINGS` */
    double cut[3];                                        /* where forces are cut off */
    double held[6];                                       /* forces 3, asked 3, between ticks or for good */
    const double *load_time, *load;                       /* F_y, F_z, M_y, one row of three a time */
    ptrdiff_t loads;                                     /* one: it stays */
    void *control;            /* of `DRIVE_CONTROL`: see control.h, in one lane */
    const void *path;
    void (*act)(MachineRun *, const double *); /* fills `held` from sliders and their velocities */
    const double *noise;      /* six normal numbers a tick */
    ptrdiff_t planned;        /* ticks that there are tables for */
    double huge;              /* forces that need a second look */
    int lagging;              /* whether the drives follow `held` by a first-order lag, since `switched` from `begun` */
    double lag[3], begun[3], before[3], switched; /* lag: 2 pi bandwidth [1/s], or infinity */
    /* When something happens. */
    const double *times, *kinks;
    ptrdiff_t samples, kink_count;
    double period;
    int outside; /* whether `held` is filled from outside at every tick */
    double rtol, atol, longest;
    /* Where the run is. */
    double t, y[6], step; /* step: of the integrator, the next; zero where it is to choose */
    double ticks;
    ptrdiff_t next, kink, at_load;
    int answered, crawled, looked;
    double seen[LIMITS], falling[LIMITS]; /* the margins at t and their rates, if `looked` */
    long long evaluations, since_poll;
    int (*poll)(MachineRun *); /* returns whether to stop; called every now and then */
    /* What it leaves. */
    double *out; /* ROW numbers a sample */
    ptrdiff_t count;
    int index;
};

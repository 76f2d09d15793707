/* A run of one machine in time: what it is given, and what it leaves. No Python here; see machine_run.h. */

typedef void Run(ptrdiff_t, const double *, const double *const *, double *const *); /* a batch kernel */

/* A kernel of lane_kernels.h in one lane, and one whose state and what acts on it, forces 3 and load 3, are apart. */
typedef void Lane(const double (*restrict)[1], const double (*restrict)[1], double (*restrict)[1]);
typedef void Motion(const double *restrict, const double *restrict, const double *restrict, double *restrict);

enum {
    LIMITS = 12,  /* three sliders at either end, two of the tilt, three legs' reach, the singular pose */
    WATCHED = 7,  /* sliders A, B, C; cosines of the legs' drops; that of the platform's arm */
    LOOKS = 65,   /* at the limits at a time */
    POLL_AFTER = 100000, /* evaluations, some milliseconds */
    PLACED = 14,  /* sliders 3, their velocities 3, cosines 4, their rates 4 */
    ROW = 13,     /* of a sample: time, pose, velocity, forces, forces asked for */
};

enum {
    RUN_FINISHED,
    RUN_TICK,        /* a controller from outside is to fill `given` */
    RUN_CROSSED,     /* a limit, `index` */
    RUN_FAILED,      /* no step is small enough */
    RUN_INTERRUPTED, /* `poll` asked for it */
    RUN_BEYOND,      /* a controller has no answer, or one that needs a second look */
    RUN_ROWS,        /* the table of its controller has no row for this tick: more are to be given */
};

enum {
    DRIVE_HELD,
    DRIVE_SPRINGS, /* all the time, or at ticks */
    DRIVE_CONTROL, /* a controller of control.h, at ticks */
    DRIVE_FOLLOW,  /* the same all the time */
};

enum { STEPS_ADAPTIVE, STEPS_EQUAL };

/* What a controller follows that acts all the time: see follow.h. */
typedef struct {
    const double *breaks, *curve; /* ends of the pieces; of each 6 coefficients of y, z, theta, the highest power first */
    ptrdiff_t pieces, at;         /* at: the piece that was asked for last */
    double first[3], last[3], duration; /* where the motion rests before and after, and how long it takes [s] */
    const double *place;          /* constants of the model's kernel of sliders */
    int forward;                  /* whether the forces of the model are fed forward */
} Followed;

typedef struct {
    Run *run;
    const double *constants;
} Bound; /* a kernel of one machine */

typedef struct MachineRun MachineRun;

struct MachineRun {
    /* The machine. */
    Motion *motion;                    /* accelerations */
    Lane *place, *watch;               /* sliders and their velocities; the same with what limits are made of */
    const double *motion_constants, *place_constants, *watch_constants;
    Bound limits;                      /* what limits are made of, at many times */
    double r, R, L;
    double bound[LIMITS], sign[LIMITS]; /* margin = sign (value - bound) */
    int counted[LIMITS];
    /* What acts on it. */
    int drive;
    double stiffness[3], rest[3], damping[3], preload[3]; /* of `DRIVE_SPRINGS` */
    double cut[3];                                        /* where forces are cut off */
    double given[6];          /* forces 3, asked 3: those that stay, or of the last tick */
    double held[6];           /* those that act between ticks, or for good */
    double push[6];           /* the same forces, and the load, where both stay for a while */
    double whole, part;       /* periods after its tick that a force acts: whole ones, and a share of one */
    double *late;             /* forces of the last `ring` ticks, 6 each */
    ptrdiff_t ring;
    const double *load_time, *load;                       /* F_y, F_z, M_y, one row of three a time */
    ptrdiff_t loads;                                     /* one: it stays */
    void *control;            /* of `DRIVE_CONTROL`, `DRIVE_FOLLOW`: see control.h, in one lane */
    void *path;
    void *followed;           /* of `DRIVE_FOLLOW`: see follow.h */
    void (*act)(MachineRun *, const double *); /* fills `given` at a tick, from sliders and their velocities */
    void (*follow)(MachineRun *, double, const double *, double *); /* forces 3, asked 3 at a time, from these */
    const double *noise;      /* six normal numbers a tick */
    ptrdiff_t planned;        /* ticks that there are tables for */
    double huge;              /* forces that need a second look */
    int exact;                /* whether the pose that a controller computes from its sliders is the platform's own */
    int beyond;               /* whether `follow` had none, or such a force */
    int lagging;              /* whether the drives follow `held` by a first-order lag, since `switched` from `begun` */
    double lag[3], begun[3], switched; /* lag: 2 pi bandwidth [1/s], or infinity */
    /* When something happens. */
    const double *times, *kinks;
    ptrdiff_t samples, kink_count;
    double period;
    int outside; /* whether `given` is filled from outside at every tick */
    int scheme;
    double rtol, atol, longest; /* longest: step, or length of equal ones */
    /* Where the run is. */
    double t, y[6], step; /* step: of the integrator, the next; zero where it is to choose */
    double ticks, acted; /* how many there were, and of how many forces have begun to act */
    ptrdiff_t next, kink, at_load;
    int answered, crawled, looked;
    int trials[2]; /* of whole intervals: see dop853.h */
    double seen[LIMITS], falling[LIMITS], placed[7]; /* if `looked`: margins at t, their rates;
                                                           * sliders 6, the cosine of the singular pose */
    long long evaluations, since_poll;
    int (*poll)(MachineRun *); /* returns whether to stop; called every now and then */
    /* What it leaves. */
    double *out; /* ROW numbers a sample */
    ptrdiff_t count;
    ptrdiff_t room;             /* samples that it holds; zero for all of them */
    void (*full)(MachineRun *); /* takes `count` samples out, when there is no room for another */
    double recorded;            /* time of the last sample */
    int index;
};

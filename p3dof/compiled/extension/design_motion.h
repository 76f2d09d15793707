/* What the figures of designs are made from: a motion with its weights, and the loops over it. */

enum {
    DESIGN_LANES = 8,   /* numbers that are reduced side by side, at every level */
    DESIGN_BLOCK = 160, /* samples at a time, two blocks of the kernels: with the columns of the motion they fit into the first cache */
    DESIGN_LINE = DESIGN_BLOCK + 8,
};

typedef struct {
    ptrdiff_t samples, padded; /* the latter a multiple of `DESIGN_LANES` */
    ptrdiff_t points;          /* of the polynomials that integrate powers */
    const double *rows;        /* inputs × padded: y, z, theta, ... */
    const double *sines, *cosines; /* of theta */
    const double *mean, *work;     /* weights of the mean square and of the work */
    const double *steps;           /* points × padded: of the work from a sample to the next */
    const double *partial;         /* samples × points × points: of the work over the first part of such a step */
    double lowest, highest;        /* y */
    ptrdiff_t lowest_at, highest_at; /* where first */
} DesignMotion;

/* Of one force, by lanes. */
typedef struct {
    double top[DESIGN_LANES], when[DESIGN_LANES], square[DESIGN_LANES];
} DesignPeaks;

/* The largest of something, where it comes first, and how it changes there; by lanes. */
typedef struct {
    double top[DESIGN_LANES], when[DESIGN_LANES], rate[DESIGN_LANES];
} DesignTrack;

typedef struct {
    void (*forces)(ptrdiff_t, double *const *, const double *restrict, ptrdiff_t, DesignPeaks *restrict);
    void (*range)(ptrdiff_t, const double *restrict, double *restrict, double *restrict);
    void (*demand)(const DesignMotion *, const double *, const double *, double *restrict);
    void (*sine)(const DesignMotion *, const double *, const double *, double *restrict);
    void (*shift)(ptrdiff_t, const double *restrict, double, double *restrict);
    void (*rates)(ptrdiff_t, const double *const *, const double *const *, double *const *);
    void (*multiply)(ptrdiff_t, const double *restrict, const double *restrict, double *restrict);
    void (*steps)(const DesignMotion *, const double *restrict, double *restrict);
    void (*weighted)(ptrdiff_t, const double *restrict, const double *restrict, double *restrict);
    void (*positive)(ptrdiff_t, const double *restrict, double *restrict);
    /* Of gradients. */
    void (*track)(ptrdiff_t, const double *restrict, const double *restrict, double, ptrdiff_t, DesignTrack *restrict);
    void (*track_size)(ptrdiff_t, const double *restrict, const double *restrict, ptrdiff_t, DesignTrack *restrict);
    void (*products)(ptrdiff_t, const double *restrict, const double *restrict, const double *restrict,
                     double *restrict, double *restrict);
    void (*power_rates)(ptrdiff_t, const double *restrict, const double *restrict, const double *restrict,
                        const double *restrict, double *restrict, double *restrict);
    void (*positive_rates)(ptrdiff_t, const double *restrict, const double *restrict, double *restrict);
    void (*margins)(const DesignMotion *, const double *, const double *, ptrdiff_t, ptrdiff_t, double *restrict,
                    double *restrict);
} DesignReductions;

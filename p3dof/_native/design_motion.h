/* What the figures of designs are made from: a motion with its weights, and the loops over it. */

enum {
    DESIGN_LANES = 8,   /* numbers that are reduced side by side, at every level */
    DESIGN_BLOCK = 256, /* samples at a time: with the columns of the motion they fit into the first cache */
    DESIGN_LINE = DESIGN_BLOCK + 8,
    DESIGN_INPUTS = 13, /* of all kernels for designs */
    ROW_SINE = 2,
    ROW_COSINE = 3,
};

typedef struct {
    ptrdiff_t samples, padded; /* the latter a multiple of `DESIGN_LANES` */
    ptrdiff_t points;          /* of the polynomials that integrate powers */
    const double *rows;        /* DESIGN_INPUTS × padded: y, z, sine and cosine of theta, ... */
    const double *theta;
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

/* Of r^2 s |s|, with the sine s of the angle from the actuation singularity, the least and the least size; by lanes. */
typedef struct {
    double least[DESIGN_LANES], size[DESIGN_LANES];
} DesignSine;

/* The lowest and the highest of three sliders, and their largest speeds; by lanes. */
typedef struct {
    double low[3][DESIGN_LANES], high[3][DESIGN_LANES], fast[3][DESIGN_LANES];
} DesignSlides;

/* Of one power: the least, the largest, and the work; by lanes. */
typedef struct {
    double low[DESIGN_LANES], high[DESIGN_LANES], work[DESIGN_LANES], given[DESIGN_LANES];
} DesignPower;

typedef struct {
    void (*forces)(ptrdiff_t, double *const *, const double *restrict, ptrdiff_t, DesignPeaks *restrict,
                   DesignSine *restrict);
    void (*slides)(ptrdiff_t, double *const *, DesignSlides *restrict);
    void (*demand)(const DesignMotion *, const double *, const double *, double *restrict);
    void (*place)(const DesignMotion *, const double *, ptrdiff_t, ptrdiff_t, double *const *);
    void (*powers)(ptrdiff_t, double *const *, double *const *, double *, ptrdiff_t);
    void (*power)(const DesignMotion *, const double *restrict, double *restrict, DesignPower *restrict);
    ptrdiff_t (*turns)(ptrdiff_t, const double *restrict, ptrdiff_t *restrict);
    void (*steps)(const DesignMotion *, const double *restrict, double *restrict);
    void (*weighted)(ptrdiff_t, const double *restrict, const double *restrict, double *restrict);
    /* Of gradients. */
    void (*track)(ptrdiff_t, const double *restrict, const double *restrict, double, ptrdiff_t, DesignTrack *restrict);
    void (*track_size)(ptrdiff_t, const double *restrict, const double *restrict, ptrdiff_t, DesignTrack *restrict);
    void (*products)(ptrdiff_t, const double *restrict, const double *restrict, const double *restrict,
                     double *restrict, double *restrict);
    void (*power_rates)(ptrdiff_t, const double *restrict, const double *restrict, const double *restrict,
                        const double *restrict, double *restrict, double *restrict);
    void (*positive_rates)(ptrdiff_t, const double *restrict, const double *restrict, double *restrict);
    void (*margins)(const double *, ptrdiff_t, const double *const *, double *restrict, double *restrict);
} DesignReductions;

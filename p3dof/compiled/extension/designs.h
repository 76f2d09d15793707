/* `DesignLoop`: a motion, and for any number of designs the figures of their forces over it. */

/* What can be asked for, as bits, and where it goes in a row of results. */
enum { ASK_SINGULAR = 1, ASK_SLIDERS = 2, ASK_POWER = 4 };
enum {
    AT_STATUS = 0,
    AT_SAMPLE = 1,
    AT_REACH = 2,
    AT_ANGLE = 3,
    AT_PEAK = 4,
    AT_WHEN = 7,
    AT_SQUARE = 10,
    AT_LOW = 13,
    AT_HIGH = 16,
    AT_SPEED = 19,
    AT_POWER = 22,
    AT_BRAKING = 25,
    AT_WORK = 28,
    AT_GIVEN = 31,
    DESIGN_RESULTS = 34,
};
enum { DESIGN_GOOD = 0, DESIGN_OUT_OF_REACH = 1, DESIGN_DOUBTFUL = 2 };

/* Shares of L: what a leg must reach beyond the demand, and by how much that may be rounding. */
#define REACH_TOLERANCE 1e-14
#define REACH_DOUBT 1e-9

typedef struct {
    PyObject_HEAD
    vectorcallfunc vectorcall;
    Run *forces, *kinematics, *tangents[2], *sliding; /* the latter for gradients: of any bodies, of symmetric ones */
    const Level *level;
    const Kernel *kernel;
    int asked, kinematic_constants, tangent_constants[2], sliding_constants;
    double *numbers; /* what `motion` points to */
    DesignMotion motion;
} DesignLoop;

/* One design while it runs. */
typedef struct {
    const double *constants, *turning, *lengths, *offset;
    double *scratch; /* lines of `DESIGN_LINE` */
    double *power;   /* 3 × padded, then one line of steps */
    DesignPeaks peaks[3];
    double low[3][DESIGN_LANES], high[3][DESIGN_LANES], slow[3][DESIGN_LANES], fast[3][DESIGN_LANES];
} Design;

enum { LINES_OF_DESIGN = 3 + 4 + 8 + 3 }; /* shifted poses, forces, kinematics, speeds */

static double largest_of(const double *lanes)
{
    double found = lanes[0];
    for (int l = 1; l < DESIGN_LANES; ++l)
        found = lanes[l] > found ? lanes[l] : found;
    return found;
}

static double least_of(const double *lanes)
{
    double found = lanes[0];
    for (int l = 1; l < DESIGN_LANES; ++l)
        found = lanes[l] < found ? lanes[l] : found;
    return found;
}

/* The first sample whose force is the largest. */
static double first_of(const DesignPeaks *peaks, double largest)
{
    double found = HUGE_VAL;
    for (int l = 0; l < DESIGN_LANES; ++l)
        if (peaks->top[l] == largest && peaks->when[l] + l < found)
            found = peaks->when[l] + l;
    return found;
}

static double sum_of(const double *lanes)
{
    return ((lanes[0] + lanes[1]) + (lanes[2] + lanes[3])) + ((lanes[4] + lanes[5]) + (lanes[6] + lanes[7]));
}

static void start_design(Design *design)
{
    for (int leg = 0; leg < 3; ++leg) {
        for (int l = 0; l < DESIGN_LANES; ++l) {
            design->peaks[leg].top[l] = -1.0; /* the first sample is larger */
            design->peaks[leg].when[l] = design->peaks[leg].square[l] = 0.0;
            design->low[leg][l] = design->slow[leg][l] = HUGE_VAL;
            design->high[leg][l] = design->fast[leg][l] = -HUGE_VAL;
        }
    }
}

/* The reach margin over the motion, and where it is missed; returns the status. */
static int margins_of(const DesignLoop *self, const Design *design, double *out)
{
    const DesignMotion *motion = &self->motion;
    const double r = design->lengths[0], R = design->lengths[1], L = design->lengths[2], width = R - r;
    const double low = motion->lowest + design->offset[0], high = motion->highest + design->offset[0];
    const double sideways = width + (high > -low ? high : -low);
    double most[DESIGN_LANES] = {0.0}, least[DESIGN_LANES];

    self->level->reductions->demand(motion, design->lengths, design->offset, most);
    const double across_c = sqrt(largest_of(most));
    const double reach = L - (across_c > sideways ? across_c : sideways);
    out[AT_REACH] = reach;
    if (self->asked & ASK_SINGULAR && reach > 0.0) {
        for (int l = 0; l < DESIGN_LANES; ++l)
            least[l] = 1.0;
        self->level->reductions->sine(motion, design->lengths, design->offset, least);
        const double square = least_of(least);
        out[AT_ANGLE] = asin(square < 0.0 ? -sqrt(-square) : sqrt(square));
    }
    if (!(reach < -REACH_DOUBT * L))
        return reach > REACH_DOUBT * L ? DESIGN_GOOD : DESIGN_DOUBTFUL;
    for (ptrdiff_t i = 0; i < motion->samples; ++i) {
        const double y = motion->rows[i] + design->offset[0], theta = motion->rows[2 * motion->padded + i];
        const double left = width + fabs(y), across = hypot(y, R - r * cos(theta + design->offset[2]));
        if (!(L - (left > across ? left : across) > REACH_TOLERANCE * L)) {
            out[AT_SAMPLE] = (double)i;
            return DESIGN_OUT_OF_REACH;
        }
    }
    return DESIGN_DOUBTFUL;
}

static void run_sliders(const DesignLoop *self, Design *design, ptrdiff_t start, ptrdiff_t now,
                        const double *const *in, double *const *force, double *const *turns, double *const *speed)
{
    const DesignReductions *reduce = self->level->reductions;

    self->kinematics(now, design->turning, in, turns);
    reduce->rates(now, in, (const double *const *)turns, speed);
    for (int leg = 0; leg < 3; ++leg) {
        reduce->range(now, turns[leg], design->low[leg], design->high[leg]);
        reduce->range(now, speed[leg], design->slow[leg], design->fast[leg]);
        if (self->asked & ASK_POWER)
            reduce->multiply(now, force[leg], speed[leg], design->power + leg * self->motion.padded + start);
    }
}

/* Whether every sample is clearly good. */
static int run_samples(const DesignLoop *self, Design *design)
{
    const DesignMotion *motion = &self->motion;
    const DesignReductions *reduce = self->level->reductions;
    const int shifted = design->offset[0] != 0.0 || design->offset[1] != 0.0 || design->offset[2] != 0.0;
    const double *in[MOST_INPUTS];
    double *line[LINES_OF_DESIGN];

    for (int k = 0; k < LINES_OF_DESIGN; ++k)
        line[k] = design->scratch + k * DESIGN_LINE;
    for (ptrdiff_t start = 0, now; start < motion->padded; start += now) {
        now = motion->padded - start < DESIGN_BLOCK ? motion->padded - start : DESIGN_BLOCK;
        for (int k = 0; k < self->kernel->inputs; ++k)
            in[k] = motion->rows + k * motion->padded + start;
        for (int k = 0; shifted && k < 3; ++k) {
            reduce->shift(now, in[k], design->offset[k], line[k]);
            in[k] = line[k];
        }
        double *const *force = line + 3;
        self->forces(now, design->constants, in, force);
        if (!self->level->all_positive(now, force[3]))
            return 0;
        reduce->forces(now, force, motion->mean + start, start, design->peaks);
        if (self->asked & (ASK_SLIDERS | ASK_POWER))
            run_sliders(self, design, start, now, in, force, line + 7, line + 15);
    }
    return 1;
}

/* What a step in which the power turns gives more than as a whole: up to where it turns, and from there on. */
static double more_of_turn(const DesignMotion *motion, const double *power, ptrdiff_t i, double step)
{
    const ptrdiff_t points = motion->points, last = motion->samples - points;
    const double share = power[i] / (power[i] - power[i + 1]), *weight = motion->partial + i * points * points;
    ptrdiff_t from = i - (points / 2 - 1);
    double part = 0.0;

    from = from < 0 ? 0 : from > last ? last : from;
    for (ptrdiff_t m = points - 1; m >= 0; --m) {
        double coefficient = 0.0;
        for (ptrdiff_t k = 0; k < points; ++k)
            coefficient += weight[m * points + k] * power[from + k];
        part = (part + coefficient) * share;
    }
    const double rest = step - part;
    return (part > 0.0 ? part : 0.0) + (rest > 0.0 ? rest : 0.0) - (step > 0.0 ? step : 0.0);
}

/* The work that one power gives: what is positive of its integral, from sample to sample and to where it turns. */
static double given_by(const DesignLoop *self, const double *power, const double *step)
{
    double sums[DESIGN_LANES] = {0.0};

    self->level->reductions->positive(self->motion.padded, step, sums);
    double given = sum_of(sums);
    for (ptrdiff_t i = 0; i + 1 < self->motion.samples; ++i)
        if (power[i] * power[i + 1] < 0.0)
            given += more_of_turn(&self->motion, power, i, step[i]);
    return given;
}

static void write_powers(const DesignLoop *self, Design *design, double *out)
{
    const DesignMotion *motion = &self->motion;
    const DesignReductions *reduce = self->level->reductions;
    double *step = design->power + 3 * motion->padded;

    for (int leg = 0; leg < 3; ++leg) {
        const double *power = design->power + leg * motion->padded;
        double low[DESIGN_LANES] = {0.0}, high[DESIGN_LANES] = {0.0}, work[DESIGN_LANES] = {0.0};
        reduce->range(motion->padded, power, low, high);
        reduce->weighted(motion->padded, motion->work, power, work);
        reduce->steps(motion, power, step);
        out[AT_POWER + leg] = largest_of(high);
        out[AT_BRAKING + leg] = -least_of(low);
        out[AT_WORK + leg] = sum_of(work);
        out[AT_GIVEN + leg] = given_by(self, power, step);
    }
}

static void run_design(const DesignLoop *self, Design *design, double *out)
{
    for (int k = 0; k < DESIGN_RESULTS; ++k)
        out[k] = NAN;
    int status = margins_of(self, design, out);
    start_design(design);
    if (status == DESIGN_GOOD && !run_samples(self, design))
        status = DESIGN_DOUBTFUL;
    out[AT_STATUS] = (double)status;
    if (status != DESIGN_GOOD)
        return;
    for (int leg = 0; leg < 3; ++leg) {
        out[AT_PEAK + leg] = largest_of(design->peaks[leg].top);
        out[AT_WHEN + leg] = first_of(&design->peaks[leg], out[AT_PEAK + leg]);
        out[AT_SQUARE + leg] = sum_of(design->peaks[leg].square);
        if (!(self->asked & (ASK_SLIDERS | ASK_POWER)))
            continue;
        const double slow = -least_of(design->slow[leg]), fast = largest_of(design->fast[leg]);
        out[AT_LOW + leg] = least_of(design->low[leg]);
        out[AT_HIGH + leg] = largest_of(design->high[leg]);
        out[AT_SPEED + leg] = slow > fast ? slow : fast;
    }
    if (self->asked & ASK_POWER)
        write_powers(self, design, out);
}

/* The tables of a call, one row a design. */
typedef struct {
    Py_buffer views[5];
    int held;
    const double *constants, *turning, *lengths, *offsets;
    double *out;
    Py_ssize_t designs;
} DesignTables;

/* Take a table of doubles without gaps, `width` to a row; `designs` is known or -1. */
static double *take_table(DesignTables *tables, PyObject *object, int width, int writable, const char *what)
{
    Py_buffer *view = &tables->views[tables->held];

    if (!PyObject_CheckBuffer(object)) {
        PyErr_Format(PyExc_TypeError, "the %s must be a buffer of doubles, not %.100s", what,
                     Py_TYPE(object)->tp_name);
        return NULL;
    }
    if (PyObject_GetBuffer(object, view, PyBUF_C_CONTIGUOUS | PyBUF_FORMAT | (writable ? PyBUF_WRITABLE : 0)) < 0)
        return NULL;
    ++tables->held;
    if (!is_double(view) || (uintptr_t)view->buf % sizeof(double)) {
        PyErr_Format(PyExc_TypeError, "the %s must hold aligned doubles (format 'd')", what);
        return NULL;
    }
    const Py_ssize_t rows = view->len / ((Py_ssize_t)sizeof(double) * width);
    if (view->len % ((Py_ssize_t)sizeof(double) * width) || (tables->designs >= 0 && rows != tables->designs)) {
        PyErr_Format(PyExc_ValueError, "the %s must have %d numbers for each of the designs", what, width);
        return NULL;
    }
    tables->designs = rows;
    return view->buf;
}

/* Numbers of a design in the tables. */
typedef struct {
    int constants, turning, lengths;
} TableWidths;

static int take_tables(const DesignLoop *self, PyObject *const *args, TableWidths widths, DesignTables *tables)
{
    const int sliding = self->asked & (ASK_SLIDERS | ASK_POWER);

    tables->designs = -1;
    if (!(tables->constants = take_table(tables, args[0], widths.constants, 0, "constants")))
        return -1;
    if (sliding && !(tables->turning = take_table(tables, args[1], widths.turning, 0, "constants of the "
                                                                                            "kinematics")))
        return -1;
    if (!(tables->lengths = take_table(tables, args[2], widths.lengths, 0, "lengths")))
        return -1;
    if (args[3] != Py_None && !(tables->offsets = take_table(tables, args[3], 3, 0, "offsets")))
        return -1;
    return (tables->out = take_table(tables, args[4], DESIGN_RESULTS, 1, "results")) ? 0 : -1;
}

static const double NOWHERE[3] = {0.0, 0.0, 0.0};

static int run_designs(const DesignLoop *self, const DesignTables *tables)
{
    const size_t scratch = LINES_OF_DESIGN * DESIGN_LINE, power = 4 * (size_t)self->motion.padded;
    double *room = PyMem_RawMalloc((scratch + power + CACHE_LINE) * sizeof(double));
    Design design;

    if (!room)
        return -1;
    memset(&design, 0, sizeof design);
    design.scratch = room + CACHE_LINE - (uintptr_t)room / sizeof(double) % CACHE_LINE;
    design.power = design.scratch + scratch;
    for (Py_ssize_t k = 0; k < tables->designs; ++k) {
        design.constants = tables->constants + k * self->kernel->constants;
        design.turning = tables->turning ? tables->turning + k * self->kinematic_constants : NULL;
        design.lengths = tables->lengths + 3 * k;
        design.offset = tables->offsets ? tables->offsets + 3 * k : NOWHERE;
        run_design(self, &design, tables->out + k * DESIGN_RESULTS);
    }
    PyMem_RawFree(room);
    return 0;
}

static PyObject *DesignLoop_vectorcall(PyObject *callable, PyObject *const *args, size_t flagged, PyObject *names)
{
    const DesignLoop *self = (const DesignLoop *)callable;
    DesignTables tables;
    int done = -1;

    if (PyVectorcall_NARGS(flagged) != 5 || (names && PyTuple_GET_SIZE(names))) {
        PyErr_SetString(PyExc_TypeError, "a DesignLoop takes constants, those of the kinematics, lengths, offsets and "
                                         "results, by position");
        return NULL;
    }
    const TableWidths widths = {self->kernel->constants, self->kinematic_constants, 3};
    memset(&tables, 0, sizeof tables);
    if (take_tables(self, args, widths, &tables) == 0) {
        Py_BEGIN_ALLOW_THREADS
        done = run_designs(self, &tables);
        Py_END_ALLOW_THREADS
        if (done < 0)
            PyErr_NoMemory();
    }
    while (tables.held)
        PyBuffer_Release(&tables.views[--tables.held]);
    if (done < 0)
        return NULL;
    Py_RETURN_NONE;
}

#include "design_gradients.h"

/* Lay out the numbers of a motion: rows, sines, cosines, mean, work, steps, partial. */
static void lay_out(DesignLoop *self, double *numbers)
{
    DesignMotion *motion = &self->motion;
    const ptrdiff_t padded = motion->padded;

    motion->rows = numbers;
    motion->sines = numbers + self->kernel->inputs * padded;
    motion->cosines = motion->sines + padded;
    motion->mean = motion->cosines + padded;
    motion->work = motion->mean + padded;
    motion->steps = motion->work + padded;
    motion->partial = motion->steps + motion->points * padded;
    motion->lowest = motion->highest = motion->rows[0];
    for (ptrdiff_t i = 1; i < motion->samples; ++i) {
        const double y = motion->rows[i];
        if (y < motion->lowest) {
            motion->lowest = y;
            motion->lowest_at = i;
        }
        if (y > motion->highest) {
            motion->highest = y;
            motion->highest_at = i;
        }
    }
}

static int take_motion(DesignLoop *self, PyObject *object)
{
    DesignMotion *motion = &self->motion;
    Py_buffer view;

    if (motion->samples < 1 || motion->points < 1 || motion->points > 6 || motion->points > motion->samples ||
        motion->samples > (ptrdiff_t)1 << 40) {
        PyErr_SetString(PyExc_ValueError, "a motion must have a sample, and polynomials of 1 to 6 of its samples");
        return -1;
    }
    motion->padded = (motion->samples + DESIGN_LANES - 1) / DESIGN_LANES * DESIGN_LANES;
    const ptrdiff_t wanted = (self->kernel->inputs + 4 + motion->points) * motion->padded +
                             motion->samples * motion->points * motion->points;
    if (take_buffer(object, &view, 0, "the numbers of the motion, argument", 6) < 0)
        return -1;
    if (view.shape[0] != wanted)
        PyErr_Format(PyExc_ValueError, "the motion takes %zd numbers, not %zd", (Py_ssize_t)wanted, view.shape[0]);
    else if (!(self->numbers = PyMem_Malloc(((size_t)wanted + CACHE_LINE) * sizeof(double))))
        PyErr_NoMemory();
    else {
        double *to = self->numbers + CACHE_LINE - (uintptr_t)self->numbers / sizeof(double) % CACHE_LINE;
        for (ptrdiff_t k = 0; k < wanted; ++k)
            to[k] = *(const double *)((const char *)view.buf + k * view.strides[0]);
        lay_out(self, to);
    }
    PyBuffer_Release(&view);
    return self->numbers ? 0 : -1;
}

static Run *run_of(const DesignLoop *self, const char *name, int *constants)
{
    const Kernel *kernel = own_kernel(name);
    *constants = kernel->constants;
    return self->level->runs[kernel - KERNELS];
}

/* What goes with the forces: kinematics, and the kernels of gradients. */
static void take_kernels(DesignLoop *self)
{
    const int friction = strstr(self->kernel->name, "friction") != NULL;

    self->kinematics = run_of(self, "kinematics", &self->kinematic_constants);
    self->sliding = run_of(self, "sliders_tangent", &self->sliding_constants);
    self->tangents[0] = run_of(self, friction ? "forces_tangent_with_friction" : "forces_tangent",
                               &self->tangent_constants[0]);
    if (!friction)
        self->tangents[1] = run_of(self, "forces_tangent_symmetric", &self->tangent_constants[1]);
}

static PyObject *DesignLoop_new(PyTypeObject *type, PyObject *args, PyObject *keywords)
{
    static char *names[] = {"kernel", "level", "asked", "samples", "points", "motion", NULL};
    PyObject *kernel_name, *level_name, *numbers;
    int asked;
    Py_ssize_t samples, points;

    if (!PyArg_ParseTupleAndKeywords(args, keywords, "UUinnO:DesignLoop", names, &kernel_name, &level_name, &asked,
                                     &samples, &points, &numbers))
        return NULL;
    const Kernel *kernel = kernel_named(kernel_name);
    const Level *level = kernel ? level_named(level_name) : NULL;
    if (!level)
        return NULL;
    if (strncmp(kernel->name, "inverse_dynamics", 16) != 0 || kernel->outputs != 4)
        return PyErr_Format(PyExc_ValueError, "%s does not return three forces", kernel->name);
    DesignLoop *self = (DesignLoop *)type->tp_alloc(type, 0);
    if (!self)
        return NULL;
    self->vectorcall = DesignLoop_vectorcall;
    self->kernel = kernel;
    self->level = level;
    self->asked = asked;
    self->forces = level->runs[kernel - KERNELS];
    take_kernels(self);
    self->motion.samples = samples;
    self->motion.points = points;
    if (take_motion(self, numbers) < 0)
        Py_CLEAR(self);
    return (PyObject *)self;
}

static void DesignLoop_dealloc(PyObject *object)
{
    PyTypeObject *type = Py_TYPE(object);
    PyMem_Free(((DesignLoop *)object)->numbers);
    type->tp_free(object);
    Py_DECREF(type);
}

PyDoc_STRVAR(DesignLoop_doc,
             "DesignLoop(kernel, level, asked, samples, points, motion)\n--\n\n"
             "Figures of the forces of many designs over one motion.\n\n"
             "``loop(constants, turning, lengths, offsets, results)`` writes a row for each design; several threads\n"
             "may call it at once. A row has the status (0 good, 1 out of reach, 2 not clearly good), the first sample\n"
             "out of reach, least reach margin and angle from the actuation singularity, then of A, B, C: peaks of\n"
             "the force, their samples, mean squares; lowest and highest sliders, peaks of speed; peaks of power given\n"
             "and taken, work, and work given. What is not asked for, or not known, is NaN.\n\n"
             "Parameters\n----------\n"
             "kernel : str\n    One of `kernels` that returns forces.\n"
             "level : str\n    One of `levels`.\n"
             "asked : int\n    1 the angle, 2 sliders, 4 powers; or a sum of these.\n"
             "samples, points : int\n    Of the motion, and of the polynomials that integrate powers.\n"
             "motion : buffer of doubles\n    Inputs, sines and cosines of theta, weights; see p3dof.compiled.designs.\n\n"
             "Raises\n------\n"
             "TypeError\n    If something is not a buffer of doubles.\n"
             "ValueError\n    If a name is unknown, or a buffer does not fit.");

static PyMemberDef DesignLoop_members[] = {
    {"__vectorcalloffset__", T_PYSSIZET, offsetof(DesignLoop, vectorcall), READONLY, NULL},
    {NULL, 0, 0, 0, NULL},
};

static PyMethodDef DesignLoop_methods[] = {
    {"tangent", (PyCFunction)(void (*)(void))DesignLoop_tangent, METH_FASTCALL, DesignLoop_tangent_doc},
    {NULL, NULL, 0, NULL},
};

static PyType_Slot DesignLoop_slots[] = {
    {Py_tp_doc, (void *)DesignLoop_doc},
    {Py_tp_new, (void *)DesignLoop_new},
    {Py_tp_call, (void *)PyVectorcall_Call},
    {Py_tp_members, DesignLoop_members},
    {Py_tp_methods, DesignLoop_methods},
    {Py_tp_dealloc, (void *)DesignLoop_dealloc},
    {0, NULL},
};

static PyType_Spec DesignLoop_spec = {
    .name = "p3dof.compiled.extension._compiled.DesignLoop",
    .basicsize = sizeof(DesignLoop),
    .flags = Py_TPFLAGS_DEFAULT | Py_TPFLAGS_HAVE_VECTORCALL | Py_TPFLAGS_IMMUTABLETYPE,
    .slots = DesignLoop_slots,
};

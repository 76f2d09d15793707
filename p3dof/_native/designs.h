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
    DESIGN_RESULTS = 34, /* and what comes before sliders and powers, where these are not asked for */
    RESULTS_OF_FORCES = AT_LOW,
    RESULTS_OF_SLIDERS = AT_POWER,
};
enum { DESIGN_GOOD = 0, DESIGN_OUT_OF_REACH = 1, DESIGN_DOUBTFUL = 2 };

/* Shares of L: what a leg must reach beyond the demand, and by how much that may be rounding. */
#define REACH_TOLERANCE 1e-14
#define REACH_DOUBT 1e-9

/* The square of the sine of the angle from the actuation singularity below which a design is doubtful. */
#define SINGULAR_DOUBT 4e-12

typedef struct {
    PyObject_HEAD
    vectorcallfunc vectorcall;
    Run *run, *tangents[2], *sliding; /* the latter for gradients: of any bodies, of symmetric ones */
    const Level *level;
    const Kernel *kernel;
    int asked, width, tangent_constants[2], sliding_constants;
    double *numbers; /* what `motion` points to */
    DesignMotion motion;
} DesignLoop;

/* One design while it runs. */
typedef struct {
    const double *constants, *lengths, *offset;
    double *scratch; /* lines of `DESIGN_LINE` */
    double *power;   /* 3 × padded, then one line of steps */
    ptrdiff_t *turns;
    DesignPeaks peaks[3];
    DesignSine sine;
    DesignSlides slides;
} Design;

enum { LINES_OF_DESIGN = 4 + 10 }; /* shifted poses, results */

static double larger(double a, double b)
{
    return a > b ? a : b;
}

static double smaller(double a, double b)
{
    return a < b ? a : b;
}

static double largest_of(const double *lanes)
{
    return larger(larger(larger(lanes[0], lanes[1]), larger(lanes[2], lanes[3])),
                  larger(larger(lanes[4], lanes[5]), larger(lanes[6], lanes[7])));
}

static double least_of(const double *lanes)
{
    return smaller(smaller(smaller(lanes[0], lanes[1]), smaller(lanes[2], lanes[3])),
                   smaller(smaller(lanes[4], lanes[5]), smaller(lanes[6], lanes[7])));
}

/* The first sample whose force is the largest. */
static double first_of(const DesignPeaks *peaks, double largest)
{
    double places[DESIGN_LANES];
    for (int l = 0; l < DESIGN_LANES; ++l)
        places[l] = peaks->top[l] == largest ? peaks->when[l] + l : HUGE_VAL;
    return least_of(places);
}

static double sum_of(const double *lanes)
{
    return ((lanes[0] + lanes[1]) + (lanes[2] + lanes[3])) + ((lanes[4] + lanes[5]) + (lanes[6] + lanes[7]));
}

static void start_design(Design *design)
{
    memset(design->peaks, 0, sizeof design->peaks);
    for (int leg = 0; leg < 3; ++leg) {
        for (int l = 0; l < DESIGN_LANES; ++l) {
            design->peaks[leg].top[l] = -1.0; /* the first sample is larger */
            design->slides.low[leg][l] = HUGE_VAL;
            design->slides.high[leg][l] = -HUGE_VAL;
            design->slides.fast[leg][l] = 0.0;
        }
    }
    for (int l = 0; l < DESIGN_LANES; ++l) {
        design->sine.least[l] = design->sine.size[l] = HUGE_VAL;
    }
}

/* The reach margin over the motion, and where it is missed; returns the status. */
static int margins_of(const DesignLoop *self, const Design *design, double *out)
{
    const DesignMotion *motion = &self->motion;
    const double r = design->lengths[0], R = design->lengths[1], L = design->lengths[2], width = R - r;
    const double low = motion->lowest + design->offset[0], high = motion->highest + design->offset[0];
    const double sideways = width + (high > -low ? high : -low);
    double most[DESIGN_LANES] = {0.0};

    self->level->reductions->demand(motion, design->lengths, design->offset, most);
    const double across_c = sqrt(largest_of(most));
    const double reach = L - (across_c > sideways ? across_c : sideways);
    out[AT_REACH] = reach;
    if (!(reach < -REACH_DOUBT * L))
        return reach > REACH_DOUBT * L ? DESIGN_GOOD : DESIGN_DOUBTFUL;
    for (ptrdiff_t i = 0; i < motion->samples; ++i) {
        const double y = motion->rows[i] + design->offset[0], theta = motion->theta[i];
        const double left = width + fabs(y), across = hypot(y, R - r * cos(theta + design->offset[2]));
        if (!(L - (left > across ? left : across) > REACH_TOLERANCE * L)) {
            out[AT_SAMPLE] = (double)i;
            return DESIGN_OUT_OF_REACH;
        }
    }
    return DESIGN_DOUBTFUL;
}

/* Whether every force is finite, and every sample clearly away from the actuation singularity. */
static int holds(const Design *design)
{
    const double r = design->lengths[0], least = least_of(design->sine.size);
    double squares = 0.0;

    for (int leg = 0; leg < 3; ++leg)
        squares += sum_of(design->peaks[leg].square);
    return squares <= DBL_MAX && least > SINGULAR_DOUBT * (r * r);
}

/* The least angle from the actuation singularity. */
static double least_angle(const Design *design)
{
    const double r = design->lengths[0], square = least_of(design->sine.least) / (r * r), sine = sqrt(fabs(square));

    return asin(copysign(sine < 1.0 ? sine : 1.0, square));
}

/* Whether every sample is clearly good. */
static int run_samples(const DesignLoop *self, Design *design)
{
    const DesignMotion *motion = &self->motion;
    const DesignReductions *reduce = self->level->reductions;
    const double *offset = design->offset, *in[DESIGN_INPUTS];
    const int shifted = offset[0] != 0.0 || offset[1] != 0.0 || offset[2] != 0.0;
    double *line[LINES_OF_DESIGN], *const *found = line + 4;

    for (int k = 0; k < LINES_OF_DESIGN; ++k)
        line[k] = design->scratch + k * DESIGN_LINE;
    for (ptrdiff_t start = 0, now; start < motion->padded; start += now) {
        now = motion->padded - start < DESIGN_BLOCK ? motion->padded - start : DESIGN_BLOCK;
        for (int k = 0; k < DESIGN_INPUTS; ++k)
            in[k] = motion->rows + k * motion->padded + start;
        if (shifted) {
            reduce->place(motion, offset, start, now, line);
            for (int k = 0; k < 4; ++k)
                in[k] = line[k];
        }
        self->run(now, design->constants, in, found);
        reduce->forces(now, found, motion->mean + start, start, design->peaks, &design->sine);
        if (self->asked & (ASK_SLIDERS | ASK_POWER))
            reduce->slides(now, found + 4, &design->slides);
        if (self->asked & ASK_POWER)
            reduce->powers(now, found, found + 7, design->power + start, motion->padded);
    }
    return holds(design);
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

static void write_powers(const DesignLoop *self, Design *design, double *out)
{
    const DesignMotion *motion = &self->motion;
    const DesignReductions *reduce = self->level->reductions;
    double *step = design->power + 3 * motion->padded;

    for (int leg = 0; leg < 3; ++leg) {
        const double *power = design->power + leg * motion->padded;
        DesignPower found;
        memset(&found, 0, sizeof found);
        reduce->power(motion, power, step, &found);
        double given = sum_of(found.given);
        const ptrdiff_t count = reduce->turns(motion->samples, power, design->turns);
        for (ptrdiff_t k = 0; k < count; ++k)
            given += more_of_turn(motion, power, design->turns[k], step[design->turns[k]]);
        out[AT_POWER + leg] = largest_of(found.high);
        out[AT_BRAKING + leg] = -least_of(found.low);
        out[AT_WORK + leg] = sum_of(found.work);
        out[AT_GIVEN + leg] = given;
    }
}

static void run_design(const DesignLoop *self, Design *design, double *out)
{
    for (int k = 0; k < self->width; ++k)
        out[k] = NAN;
    int status = margins_of(self, design, out);
    if (status == DESIGN_GOOD) {
        start_design(design);
        if (!run_samples(self, design))
            status = DESIGN_DOUBTFUL;
    }
    out[AT_STATUS] = (double)status;
    if (status != DESIGN_GOOD)
        return;
    if (self->asked & ASK_SINGULAR)
        out[AT_ANGLE] = least_angle(design);
    for (int leg = 0; leg < 3; ++leg) {
        out[AT_PEAK + leg] = largest_of(design->peaks[leg].top);
        out[AT_WHEN + leg] = first_of(&design->peaks[leg], out[AT_PEAK + leg]);
        out[AT_SQUARE + leg] = sum_of(design->peaks[leg].square);
        if (!(self->asked & (ASK_SLIDERS | ASK_POWER)))
            continue;
        out[AT_LOW + leg] = least_of(design->slides.low[leg]);
        out[AT_HIGH + leg] = largest_of(design->slides.high[leg]);
        out[AT_SPEED + leg] = largest_of(design->slides.fast[leg]);
    }
    if (self->asked & ASK_POWER)
        write_powers(self, design, out);
}

/* The tables of a call, one row a design. */
typedef struct {
    Py_buffer views[5];
    int held;
    const double *constants, *turning, *lengths, *offsets; /* turning: only of gradients */
    double *out;
    Py_ssize_t designs;
} DesignTables;

/* Take a table of doubles without gaps, `width` to a row; `designs` is known or -1. */
static double *take_table(DesignTables *tables, PyObject *object, int width, int writable, const char *what)
{
    Py_buffer *view = &tables->views[tables->held];

    if (!PyObject_CheckBuffer(object)) {
        PyObject *type = name_of_type(object);
        if (type)
            PyErr_Format(PyExc_TypeError, "the %s must be a buffer of doubles, not %.100U", what, type);
        Py_XDECREF(type);
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
    int constants, turning, lengths, results;
} TableWidths;

static int take_tables(TableWidths widths, PyObject *const *args, DesignTables *tables)
{
    tables->designs = -1;
    if (!(tables->constants = take_table(tables, *args++, widths.constants, 0, "constants")))
        return -1;
    if (widths.turning && *args++ != Py_None &&
        !(tables->turning = take_table(tables, args[-1], widths.turning, 0, "constants of the sliders")))
        return -1;
    if (!(tables->lengths = take_table(tables, *args++, widths.lengths, 0, "lengths")))
        return -1;
    if (*args++ != Py_None && !(tables->offsets = take_table(tables, args[-1], 3, 0, "offsets")))
        return -1;
    return (tables->out = take_table(tables, *args, widths.results, 1, "results")) ? 0 : -1;
}

static const double NOWHERE[3] = {0.0, 0.0, 0.0};

static int run_designs(const DesignLoop *self, const DesignTables *tables)
{
    const size_t scratch = LINES_OF_DESIGN * DESIGN_LINE, padded = (size_t)self->motion.padded;
    double *room = malloc((scratch + 4 * padded + CACHE_LINE) * sizeof(double));
    ptrdiff_t *turns = malloc(padded * sizeof(ptrdiff_t));
    Design design;

    if (!room || !turns) {
        free(room);
        free(turns);
        return -1;
    }
    memset(&design, 0, sizeof design);
    design.scratch = room + CACHE_LINE - (uintptr_t)room / sizeof(double) % CACHE_LINE;
    design.power = design.scratch + scratch;
    design.turns = turns;
    for (Py_ssize_t k = 0; k < tables->designs; ++k) {
        design.constants = tables->constants + k * self->kernel->constants;
        design.lengths = tables->lengths + 3 * k;
        design.offset = tables->offsets ? tables->offsets + 3 * k : NOWHERE;
        run_design(self, &design, tables->out + k * self->width);
    }
    free(room);
    free(turns);
    return 0;
}

static PyObject *DesignLoop_vectorcall(PyObject *callable, PyObject *const *args, size_t flagged, PyObject *names)
{
    const DesignLoop *self = (const DesignLoop *)callable;
    DesignTables tables;
    int done = -1;

    if (PyVectorcall_NARGS(flagged) != 4 || (names && PyTuple_GET_SIZE(names))) {
        PyErr_SetString(PyExc_TypeError, "a DesignLoop takes constants, lengths, offsets and results, by position");
        return NULL;
    }
    const TableWidths widths = {self->kernel->constants, 0, 3, self->width};
    memset(&tables, 0, sizeof tables);
    if (take_tables(widths, args, &tables) == 0) {
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

/* Lay out the numbers of a motion: rows, theta, mean, work, steps, partial. */
static void lay_out(DesignLoop *self, double *numbers)
{
    DesignMotion *motion = &self->motion;
    const ptrdiff_t padded = motion->padded;

    motion->rows = numbers;
    motion->theta = numbers + DESIGN_INPUTS * padded;
    motion->mean = motion->theta + padded;
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
    const ptrdiff_t wanted = (DESIGN_INPUTS + 3 + motion->points) * motion->padded +
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

/* The kernels of gradients. */
static void take_kernels(DesignLoop *self)
{
    const int friction = strstr(self->kernel->name, "friction") != NULL;

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
    const int sliding = asked & (ASK_SLIDERS | ASK_POWER);
    if (strncmp(kernel->name, "design_", 7) != 0 || (sliding && kernel->outputs != 10))
        return PyErr_Format(PyExc_ValueError, "%s does not return what is asked for", kernel->name);
    DesignLoop *self = (DesignLoop *)PyType_GenericAlloc(type, 0);
    if (!self)
        return NULL;
    self->vectorcall = DesignLoop_vectorcall;
    self->kernel = kernel;
    self->level = level;
    self->asked = asked;
    self->width = asked & ASK_POWER ? DESIGN_RESULTS : sliding ? RESULTS_OF_SLIDERS : RESULTS_OF_FORCES;
    self->run = level->runs[kernel - KERNELS];
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
    PyObject_Free(object);
    Py_DECREF(type);
}

PyDoc_STRVAR(DesignLoop_doc,
             "DesignLoop(kernel, level, asked, samples, points, motion)\n--\n\n"
             "Figures of the forces of many designs over one motion.\n\n"
             "``loop(constants, lengths, offsets, results)`` writes a row for each design; several threads\n"
             "may call it at once. A row has the status (0 good, 1 out of reach, 2 not clearly good), the first sample\n"
             "out of reach, least reach margin and angle from the actuation singularity, then of A, B, C: peaks of\n"
             "the force, their samples, mean squares; lowest and highest sliders, peaks of speed; peaks of power given\n"
             "and taken, work, and work given. What is not known is NaN; rows end\n"
             "before the sliders (13 numbers) or powers (22) that are not asked for.\n\n"
             "Parameters\n----------\n"
             "kernel : str\n    One of `kernels` for designs.\n"
             "level : str\n    One of `levels`.\n"
             "asked : int\n    1 the angle, 2 sliders, 4 powers; or a sum of these.\n"
             "samples, points : int\n    Of the motion, and of the polynomials that integrate powers.\n"
             "motion : buffer of doubles\n    Inputs, theta, weights; see p3dof.closed_form.compiled.designs.\n\n"
             "Raises\n------\n"
             "TypeError\n    If something is not a buffer of doubles.\n"
             "ValueError\n    If a name is unknown, or a buffer does not fit.");

static PyMemberDef DesignLoop_members[] = {
    {"__vectorcalloffset__", Py_T_PYSSIZET, offsetof(DesignLoop, vectorcall), Py_READONLY, NULL},
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
    .name = "p3dof._native._compiled.DesignLoop",
    .basicsize = sizeof(DesignLoop),
    .flags = Py_TPFLAGS_DEFAULT | Py_TPFLAGS_HAVE_VECTORCALL | Py_TPFLAGS_IMMUTABLETYPE,
    .slots = DesignLoop_slots,
};

/* `run_many`: the engine of many.h at a level, in wide rows of lanes or in one, called with Python's buffers. */

/* The settings, in the order of p3dof.closed_form.compiled.many. */
enum {
    SETTING_KIND,
    SETTING_NOISY,
    SETTING_COUNTING,
    SETTING_DIFFERENCING,
    SETTING_LAGGING,
    SETTING_INTEGRATING,
    SETTING_MODEL_SYMMETRIC,
    SETTING_WHOLE,
    SETTING_RING,
    SETTING_CONTINUOUS,
    SETTING_FRICTION,
    SETTING_SYMMETRIC,
    SETTING_TICKS,
    SETTING_EVERY,
    SETTING_ROWS,
    SETTINGS,
};
enum { NUMBER_TICK, NUMBER_END, NUMBER_NEAR, NUMBER_RTOL, NUMBER_ATOL, MANY_NUMBERS };

/* The buffers, by position. */
enum {
    GIVEN_SETTINGS,
    GIVEN_NUMBERS,
    GIVEN_LENGTHS,
    GIVEN_CHANGES,
    GIVEN_CANCEL,
    GIVEN_INPUTS,
    GIVEN_RESULTS,
    GIVEN_TABLE,
    GIVEN_ASSEMBLY,
    GIVEN_TORQUE,
    GIVEN_INVERSE,
    GIVEN_REFERENCE,
    GIVEN_LOADS,
    GIVEN_NOISE,
    GIVEN_HISTORY,
    GIVEN,
};
static const char *const GIVEN_NAMES[GIVEN] = {"settings", "numbers", "lengths",   "changes", "cancel",
                                               "inputs",   "results", "table",     "assembly", "torque",
                                               "inverse",  "reference", "loads",   "noise",   "history"};

typedef struct {
    Py_buffer views[GIVEN];
    int held[GIVEN];
} ManyBuffers;

static void release_many(ManyBuffers *buffers)
{
    for (int k = 0; k < GIVEN; ++k)
        if (buffers->held[k])
            PyBuffer_Release(&buffers->views[k]);
}

static int take_many(ManyBuffers *buffers, PyObject *const *args)
{
    for (int k = 0; k < GIVEN; ++k) {
        const int writable = k == GIVEN_RESULTS || k == GIVEN_HISTORY;
        const int whole = k == GIVEN_SETTINGS || k == GIVEN_CHANGES || k == GIVEN_CANCEL;
        if (args[k] == Py_None && k > GIVEN_RESULTS)
            continue;
        if (PyObject_GetBuffer(args[k], &buffers->views[k],
                               PyBUF_C_CONTIGUOUS | PyBUF_FORMAT | (writable ? PyBUF_WRITABLE : 0)) < 0)
            return -1;
        buffers->held[k] = 1;
        const char *format = buffers->views[k].format ? buffers->views[k].format : "B";
        const int good = whole ? buffers->views[k].itemsize == 8 && (*format == 'l' || *format == 'q')
                               : is_double(&buffers->views[k]);
        if (!good) {
            PyErr_Format(PyExc_TypeError, "%s: expected %s", GIVEN_NAMES[k], whole ? "64-bit integers" : "doubles");
            return -1;
        }
    }
    return 0;
}

/* Whether a buffer has as many numbers as it must have, or there is none where there need not be one. */
static int has(const ManyBuffers *buffers, int k, ptrdiff_t count, int required)
{
    if (!buffers->held[k] && !required)
        return 1;
    if (buffers->held[k] && buffers->views[k].len == count * 8)
        return 1;
    PyErr_Format(PyExc_ValueError, "%s: expected %zd numbers, got %zd", GIVEN_NAMES[k], count,
                 buffers->held[k] ? buffers->views[k].len / 8 : 0);
    return 0;
}

static int in_range(const int64_t *settings, int k, int64_t least, int64_t most)
{
    if (settings[k] >= least && settings[k] <= most)
        return 1;
    PyErr_Format(PyExc_ValueError, "settings[%d]: expected %lld to %lld, got %lld", k, (long long)least,
                 (long long)most, (long long)settings[k]);
    return 0;
}

static int check_settings(const int64_t *settings)
{
    int good = in_range(settings, SETTING_KIND, CONTROL_FEEDBACK, CONTROL_TORQUE);
    for (int k = SETTING_NOISY; good && k <= SETTING_SYMMETRIC; ++k)
        if (k != SETTING_WHOLE && k != SETTING_RING)
            good = in_range(settings, k, 0, 1);
    good = good && in_range(settings, SETTING_WHOLE, 0, MOST_LATE);
    good = good && in_range(settings, SETTING_RING, settings[SETTING_WHOLE] ? settings[SETTING_WHOLE] + 2 : 1,
                            settings[SETTING_WHOLE] + 2);
    good = good && in_range(settings, SETTING_TICKS, 1, (int64_t)1 << 40);
    good = good && in_range(settings, SETTING_EVERY, 1, (int64_t)1 << 40);
    const int64_t rows = good ? (settings[SETTING_TICKS] + settings[SETTING_EVERY] - 1) / settings[SETTING_EVERY] + 2 : 1;
    return good && in_range(settings, SETTING_ROWS, rows, rows);
}

/* Fill in a batch and check the sizes of all buffers; return how many runs there are, or -1. */
static ptrdiff_t fill_batch(Batch *b, const ManyBuffers *buffers)
{
    const Py_buffer *v = buffers->views;
    if (!has(buffers, GIVEN_SETTINGS, SETTINGS, 1) || !has(buffers, GIVEN_NUMBERS, MANY_NUMBERS, 1) ||
        !has(buffers, GIVEN_CANCEL, 1, 1) || !check_settings(v[GIVEN_SETTINGS].buf))
        return -1;
    const int64_t *settings = v[GIVEN_SETTINGS].buf;
    const double *numbers = v[GIVEN_NUMBERS].buf;
    const ptrdiff_t ticks = (ptrdiff_t)settings[SETTING_TICKS], steps = v[GIVEN_LENGTHS].len / 8;
    const ptrdiff_t row = LEVELS[0]->many.row * 8, runs = v[GIVEN_INPUTS].len / row;
    const int torque = settings[SETTING_KIND] == CONTROL_TORQUE, symmetric = (int)settings[SETTING_MODEL_SYMMETRIC];
    if (steps < 1 || steps > MOST_STEPS) {
        PyErr_Format(PyExc_ValueError, "lengths: expected 1 to %d steps, got %zd", MOST_STEPS, steps);
        return -1;
    }
    if (!has(buffers, GIVEN_CHANGES, steps, 1) || !has(buffers, GIVEN_INPUTS, runs * (row / 8), 1) ||
        !has(buffers, GIVEN_RESULTS, runs * MANY_RESULTS, 1) || !has(buffers, GIVEN_TABLE, 9 * ticks, torque) ||
        !has(buffers, GIVEN_ASSEMBLY, lane_assembly_constants, torque) ||
        !has(buffers, GIVEN_TORQUE, lane_torque_constants, torque) ||
        !has(buffers, GIVEN_INVERSE, symmetric ? lane_inverse_symmetric_constants : lane_inverse_constants, torque) ||
        !has(buffers, GIVEN_REFERENCE, 3 * (ticks + 1), 0) || !has(buffers, GIVEN_LOADS, 9 * steps * ticks, 0) ||
        !has(buffers, GIVEN_NOISE, runs * ticks * 6, settings[SETTING_NOISY] != 0) ||
        !has(buffers, GIVEN_HISTORY, runs * (ptrdiff_t)settings[SETTING_ROWS] * MANY_HISTORY, 0))
        return -1;
    *b = (Batch){
        .path =
            {
                .kind = (int)settings[SETTING_KIND],
                .noisy = (int)settings[SETTING_NOISY],
                .counting = (int)settings[SETTING_COUNTING],
                .differencing = (int)settings[SETTING_DIFFERENCING],
                .lagging = (int)settings[SETTING_LAGGING],
                .integrating = (int)settings[SETTING_INTEGRATING],
                .symmetric = symmetric,
                .whole = (int)settings[SETTING_WHOLE],
                .ring = (int)settings[SETTING_RING],
                .period = numbers[NUMBER_TICK],
                .table = buffers->held[GIVEN_TABLE] ? v[GIVEN_TABLE].buf : NULL,
                .assembly = v[GIVEN_ASSEMBLY].buf,
                .torque = v[GIVEN_TORQUE].buf,
                .inverse = v[GIVEN_INVERSE].buf,
            },
        .continuous = (int)settings[SETTING_CONTINUOUS],
        .symmetric = (int)settings[SETTING_SYMMETRIC],
        .friction = (int)settings[SETTING_FRICTION],
        .ticks = ticks,
        .every = (ptrdiff_t)settings[SETTING_EVERY],
        .rows = (ptrdiff_t)settings[SETTING_ROWS],
        .steps = (int)steps,
        .length = v[GIVEN_LENGTHS].buf,
        .change = v[GIVEN_CHANGES].buf,
        .tick = numbers[NUMBER_TICK],
        .end = numbers[NUMBER_END],
        .near = numbers[NUMBER_NEAR],
        .rtol = numbers[NUMBER_RTOL],
        .atol = numbers[NUMBER_ATOL],
        .reference = buffers->held[GIVEN_REFERENCE] ? v[GIVEN_REFERENCE].buf : NULL,
        .loads = buffers->held[GIVEN_LOADS] ? v[GIVEN_LOADS].buf : NULL,
        .inputs = v[GIVEN_INPUTS].buf,
        .noise = buffers->held[GIVEN_NOISE] ? v[GIVEN_NOISE].buf : NULL,
        .results = v[GIVEN_RESULTS].buf,
        .history = buffers->held[GIVEN_HISTORY] ? v[GIVEN_HISTORY].buf : NULL,
        .cancel = v[GIVEN_CANCEL].buf,
    };
    return runs;
}

static PyObject *run_many(PyObject *module, PyObject *const *args, Py_ssize_t count)
{
    ManyBuffers buffers = {.held = {0}};
    Batch batch;
    (void)module;
    if (count != 2 + GIVEN) {
        PyErr_Format(PyExc_TypeError, "run_many takes a level, whether in lanes, and %d buffers", GIVEN);
        return NULL;
    }
    const Level *level = PyUnicode_Check(args[0]) ? level_named(args[0]) : NULL;
    const int wide = PyObject_IsTrue(args[1]);
    if (!level && !PyErr_Occurred())
        PyErr_SetString(PyExc_TypeError, "level: expected a name");
    if (!level || wide < 0)
        return NULL;
    const ptrdiff_t runs = take_many(&buffers, args + 2) < 0 ? -1 : fill_batch(&batch, &buffers);
    const ManyKernels *found = &level->many;
    void *room = runs < 0 ? NULL : malloc((wide ? found->wide_size : found->single_size) + 64);
    if (runs >= 0 && !room)
        PyErr_NoMemory();
    if (room) {
        void *aligned = (void *)(((uintptr_t)room + 63) & ~(uintptr_t)63);
        Py_BEGIN_ALLOW_THREADS
        (wide ? found->wide : found->single)(&batch, aligned, 0, runs);
        Py_END_ALLOW_THREADS
        free(room);
    }
    release_many(&buffers);
    if (!room)
        return NULL;
    Py_RETURN_NONE;
}

PyDoc_STRVAR(run_many_doc,
             "run_many(level, wide, settings, numbers, lengths, changes, cancel, inputs, results, table, assembly, "
             "torque, inverse, reference, loads, noise, history, /)\n--\n\n"
             "Run many machines in time; see p3dof.closed_form.compiled.many, which fills the buffers.\n\n"
             "Raises\n------\n"
             "TypeError\n    If a buffer has another type.\n"
             "ValueError\n    If a buffer has another size, or a setting is out of its range.");

/* `MachineRun`: a run of one machine in time, without Python between its steps. */

enum { RUN_TABLES = 21, RUN_NUMBERS = 23, RUN_LIVE = 13, RUN_SETTINGS = 10, RUN_GIVEN = 29, RUN_ENDS = 7, MOST_ROWS = 10000 };

static const struct {
    const char *name;
    int constants;
} MOTION_NAMES[MOTIONS] = {{"motion", lane_motion_constants},
                           {"motion_symmetric", lane_motion_symmetric_constants},
                           {"motion_with_friction", lane_motion_with_friction_constants},
                           {"motion_with_friction_symmetric", lane_motion_with_friction_symmetric_constants}};

typedef struct {
    PyObject_HEAD
    MachineRun run;
    const Level *level;
    double *tables[RUN_TABLES];
    ControlPath path;
    OneControl control;
    Followed followed;
    MachineRun first; /* where it begins, for runs from elsewhere by the same tables */
    OneControl first_control;
    PyObject *drain; /* what takes the samples when there is no room; likewise */
    int spilt;       /* whether it raised */
    PyThreadState *saved;
    PyObject *told; /* what `poll` calls; borrowed from the caller of `advance` */
    int busy;
} RunObject;

/* Copy a buffer of doubles, of a length or (-1) of any; for PyMem_Free. */
static double *copy_doubles(PyObject *object, const char *what, Py_ssize_t expected, Py_ssize_t *length)
{
    Py_buffer view;
    double *copy = NULL;

    if (take_buffer(object, &view, 0, what, 0) < 0)
        return NULL;
    *length = view.shape[0];
    if (expected >= 0 && *length != expected)
        PyErr_Format(PyExc_ValueError, "%s must have %zd numbers, not %zd", what, expected, *length);
    else if (!(copy = PyMem_Malloc((size_t)(*length + 1) * sizeof(double))))
        PyErr_NoMemory();
    for (Py_ssize_t k = 0; copy && k < *length; ++k)
        copy[k] = *(const double *)((const char *)view.buf + k * view.strides[0]);
    PyBuffer_Release(&view);
    return copy;
}

static int poll_python(MachineRun *run)
{
    RunObject *self = (RunObject *)((char *)run - offsetof(RunObject, run));
    PyEval_RestoreThread(self->saved);
    int stop = self->spilt || PyErr_CheckSignals() < 0;
    if (!stop && self->told) {
        PyObject *found = PyObject_CallFunction(self->told, "n", (Py_ssize_t)run->next);
        stop = !found;
        Py_XDECREF(found);
    }
    self->saved = PyEval_SaveThread();
    return stop;
}

/* Let Python take the rows that there are; what it raises ends the run at its next look. */
static void drain_python(MachineRun *run)
{
    RunObject *self = (RunObject *)((char *)run - offsetof(RunObject, run));
    if (!self->spilt) {
        PyEval_RestoreThread(self->saved);
        PyObject *found = NULL;
        if (self->drain)
            found = PyObject_CallFunction(self->drain, "n", (Py_ssize_t)run->count);
        else
            PyErr_SetString(PyExc_ValueError, "advance: so many samples need a drain");
        self->spilt = !found;
        Py_XDECREF(found);
        self->saved = PyEval_SaveThread();
    }
    run->since_poll = self->spilt ? POLL_AFTER : run->since_poll;
    run->count = 0;
}

static PyObject *Run_advance(PyObject *object, PyObject *const *args, Py_ssize_t count)
{
    RunObject *self = (RunObject *)object;
    if (count < 1 || count > 2) {
        PyErr_SetString(PyExc_TypeError, "advance: expected told, and perhaps drain");
        return NULL;
    }
    if (self->busy) {
        PyErr_SetString(PyExc_RuntimeError, "this run is already going on");
        return NULL;
    }
    self->busy = 1;
    self->told = args[0] == Py_None ? NULL : args[0];
    self->drain = count < 2 || args[1] == Py_None ? NULL : args[1];
    self->saved = PyEval_SaveThread();
    const int status = self->level->advance(&self->run);
    PyEval_RestoreThread(self->saved);
    self->busy = 0;
    return status == RUN_INTERRUPTED || self->spilt ? NULL : PyLong_FromLong(status);
}

/* Take a writable buffer of doubles of a length. */
static int take_room(PyObject *object, Py_buffer *view, Py_ssize_t expected)
{
    if (take_buffer(object, view, 1, "the buffer, argument", 1) < 0)
        return -1;
    if (view->shape[0] == expected && view->strides[0] == (Py_ssize_t)sizeof(double))
        return 0;
    PyErr_Format(PyExc_ValueError, "expected a row of %zd doubles", expected);
    PyBuffer_Release(view);
    return -1;
}

static PyObject *Run_live(PyObject *object, PyObject *into)
{
    const RunObject *self = (RunObject *)object;
    Py_buffer view;
    if (take_room(into, &view, RUN_LIVE) < 0)
        return NULL;
    double *to = view.buf;
    to[0] = self->run.t;
    memcpy(to + 1, self->run.y, sizeof self->run.y);
    self->level->place_sliders(&self->run, self->run.y, to + 7);
    PyBuffer_Release(&view);
    Py_RETURN_NONE;
}

static PyObject *Run_samples(PyObject *object, PyObject *into)
{
    const RunObject *self = (RunObject *)object;
    Py_buffer view;
    if (take_room(into, &view, ROW * self->run.count) < 0)
        return NULL;
    memcpy(view.buf, self->run.out, (size_t)(ROW * self->run.count) * sizeof(double));
    PyBuffer_Release(&view);
    Py_RETURN_NONE;
}

static PyObject *Run_hold(PyObject *object, PyObject *forces)
{
    RunObject *self = (RunObject *)object;
    Py_ssize_t length;
    double *found = copy_doubles(forces, "the forces, argument", 6, &length);
    if (!found)
        return NULL;
    memcpy(self->run.given, found, 6 * sizeof *found);
    if (self->run.period == 0.0)
        memcpy(self->run.held, found, 6 * sizeof *found);
    PyMem_Free(found);
    Py_RETURN_NONE;
}

/* Begin again, elsewhere: pose 3, velocity 3, and on which side of the singular pose, 1 or -1. */
static PyObject *Run_begin(PyObject *object, PyObject *start)
{
    RunObject *self = (RunObject *)object;
    Py_ssize_t length;
    double *found = copy_doubles(start, "the start, argument", 7, &length);
    if (!found)
        return NULL;
    if (self->busy || self->path.first) {
        PyErr_SetString(PyExc_RuntimeError, "this run is going on, or its first rows are gone");
        PyMem_Free(found);
        return NULL;
    }
    self->run = self->first;
    self->control = self->first_control;
    self->followed.at = 0;
    self->spilt = 0;
    memset(self->run.late, 0, (size_t)self->run.ring * 6 * sizeof(double));
    memcpy(self->run.y, found, sizeof self->run.y);
    self->run.sign[LIMITS - 1] = found[6];
    PyMem_Free(found);
    Py_RETURN_NONE;
}

/* Take the rows of the controller's table, and of its noise, that come next. */
static PyObject *Run_rows(PyObject *object, PyObject *args)
{
    RunObject *self = (RunObject *)object;
    PyObject *parts[2];
    double *found[2] = {NULL, NULL};
    Py_ssize_t lengths[2] = {0, 0};
    if (!PyArg_ParseTuple(args, "OO:rows", &parts[0], &parts[1]))
        return NULL;
    for (int k = 0; k < 2; ++k)
        if (!(found[k] = copy_doubles(parts[k], "the rows, one", -1, &lengths[k]))) {
            PyMem_Free(found[0]);
            return NULL;
        }
    const int rows = self->path.table != NULL;
    const Py_ssize_t count = rows ? lengths[0] / 9 : lengths[1] / 6;
    if (self->busy || count < 1 || lengths[0] != (rows ? 9 * count : 0) ||
        (self->path.noisy && lengths[1] != 6 * count)) {
        PyErr_SetString(PyExc_ValueError, "rows: expected nine numbers a tick, and six of noise if there is some");
        PyMem_Free(found[0]);
        PyMem_Free(found[1]);
        return NULL;
    }
    for (int k = 0; k < 2; ++k) {
        PyMem_Free(self->tables[11 + k]);
        self->tables[11 + k] = found[k];
    }
    self->path.table = rows ? found[0] : NULL;
    self->run.noise = found[1];
    self->path.first = self->run.planned;
    self->run.planned += count;
    Py_RETURN_NONE;
}

/* Put the tables where the run looks for them: see `Run_doc`. */
static int set_tables(RunObject *self, const Py_ssize_t *lengths)
{
    MachineRun *m = &self->run;
    double **tables = self->tables;

    m->motion_constants = tables[0];
    m->place_constants = tables[1];
    m->watch_constants = tables[20];
    m->limits.constants = tables[2];
    memcpy(m->bound, tables[3], sizeof m->bound);
    memcpy(m->sign, tables[3] + LIMITS, sizeof m->sign);
    for (int k = 0; k < LIMITS; ++k)
        m->counted[k] = tables[3][2 * LIMITS + k] != 0.0;
    m->drive = lengths[4] ? DRIVE_SPRINGS : DRIVE_HELD;
    if (m->drive == DRIVE_SPRINGS) {
        memcpy(m->stiffness, tables[4], sizeof m->stiffness);
        memcpy(m->rest, tables[4] + 3, sizeof m->rest);
        memcpy(m->damping, tables[4] + 6, sizeof m->damping);
        memcpy(m->preload, tables[4] + 9, sizeof m->preload);
    }
    m->load_time = tables[5];
    m->load = tables[6];
    m->loads = lengths[5];
    m->kinks = tables[7];
    m->kink_count = lengths[7];
    m->times = tables[8];
    m->samples = lengths[8];
    if (m->loads < 1 || lengths[6] != 3 * m->loads || m->samples < 1 || (lengths[4] && lengths[4] != 12)) {
        PyErr_SetString(PyExc_ValueError, "tables: a load, its times, springs or the samples do not fit");
        return -1;
    }
    return 0;
}

/* Set what a controller follows all the time: breaks, curve, ends, constants of its model's sliders. */
static int set_followed(RunObject *self, double **tables, const Py_ssize_t *lengths, int forward)
{
    Followed *f = &self->followed;
    f->pieces = lengths[0] > 0 ? lengths[0] - 1 : 0;
    f->breaks = tables[0];
    f->curve = tables[1];
    if (lengths[2] != RUN_ENDS || lengths[1] != 18 * f->pieces || lengths[3] != lane_place_constants) {
        PyErr_SetString(PyExc_ValueError, "tables: what the controller follows does not fit");
        return -1;
    }
    memcpy(f->first, tables[2], sizeof f->first);
    memcpy(f->last, tables[2] + 3, sizeof f->last);
    f->duration = tables[2][6];
    f->place = tables[3];
    f->forward = forward;
    self->run.followed = f;
    return 0;
}

/* Set the controller of the last eleven tables; none if its settings are empty. */
static int set_controller(RunObject *self, const Py_ssize_t *lengths)
{
    MachineRun *m = &self->run;
    double **tables = self->tables + 9;
    ControlPath *path = &self->path;

    if (lengths[9] == 0)
        return 0;
    if (lengths[9] != RUN_SETTINGS || lengths[10] != RUN_GIVEN) {
        PyErr_SetString(PyExc_ValueError, "tables: settings or gains of the controller do not fit");
        return -1;
    }
    path->kind = tables[0][0] != 0.0 ? CONTROL_TORQUE : CONTROL_FEEDBACK;
    path->noisy = tables[0][1] != 0.0;
    path->counting = tables[0][2] != 0.0;
    path->differencing = tables[0][3] != 0.0;
    path->integrating = tables[0][4] != 0.0;
    path->symmetric = tables[0][5] != 0.0;
    path->rough = tables[0][7] != 0.0;
    path->ring = 1; /* what is late waits in `late` of the run */
    path->period = m->period;
    path->table = lengths[11] ? tables[2] : NULL;
    path->assembly = tables[4];
    path->torque = tables[5];
    path->inverse = tables[6];
    m->planned = lengths[11] ? lengths[11] / 9 : PTRDIFF_MAX;
    if (path->noisy && lengths[12] / 6 < m->planned)
        m->planned = lengths[12] / 6;
    const int inverse = path->rough && path->symmetric ? lane_inverse_with_friction_symmetric_constants
                        : path->rough                  ? lane_inverse_with_friction_constants
                        : path->symmetric              ? lane_inverse_symmetric_constants
                                                       : lane_inverse_constants;
    const int torque = path->kind == CONTROL_TORQUE, follows = lengths[18] > 0;
    const int forward = follows && tables[0][8] != 0.0;
    if ((torque && ((!path->table && !follows) || lengths[13] != lane_assembly_constants ||
                    lengths[14] != lane_torque_constants)) ||
        ((torque || forward) && lengths[15] != inverse)) {
        PyErr_SetString(PyExc_ValueError, "tables: the model of the controller does not fit");
        return -1;
    }
    if (follows && set_followed(self, tables + 7, lengths + 16, forward) < 0)
        return -1;
    memcpy(&self->control, tables[1], RUN_GIVEN * sizeof(double));
    m->drive = follows ? DRIVE_FOLLOW : DRIVE_CONTROL;
    m->huge = tables[0][6];
    m->exact = tables[0][9] != 0.0;
    m->noise = tables[3];
    m->path = path;
    m->control = &self->control;
    m->act = self->level->run.act;
    m->follow = self->level->run.follow;
    return 0;
}

static void set_numbers(MachineRun *m, const double *numbers)
{
    m->r = numbers[0];
    m->R = numbers[1];
    m->L = numbers[2];
    m->period = numbers[3];
    m->rtol = numbers[4];
    m->atol = numbers[5];
    m->longest = numbers[6];
    memcpy(m->cut, numbers + 7, sizeof m->cut);
    m->outside = numbers[10] != 0.0;
    memcpy(m->y, numbers + 11, sizeof m->y);
    memcpy(m->lag, numbers + 17, sizeof m->lag);
    for (int i = 0; i < 3; ++i)
        m->lagging |= m->period > 0.0 && m->lag[i] < INFINITY;
    m->scheme = numbers[20] != 0.0 ? STEPS_EQUAL : STEPS_ADAPTIVE;
    m->whole = numbers[21];
    m->part = numbers[22];
}

/* Make room for the forces of ticks that do not act yet. */
static int make_ring(MachineRun *m)
{
    if (!(m->whole >= 0.0 && m->whole < 1e9 && m->part >= 0.0 && m->part < 1.0)) {
        PyErr_SetString(PyExc_ValueError, "numbers: forces are late by whole periods and a part of one");
        return -1;
    }
    m->ring = (ptrdiff_t)m->whole + 2;
    m->late = PyMem_Calloc((size_t)m->ring * 6, sizeof(double));
    if (!m->late)
        PyErr_NoMemory();
    return m->late ? 0 : -1;
}

static Bound bound_kernel(const Level *level, const Kernel *kernel)
{
    const Bound found = {level->runs[kernel - KERNELS], NULL};
    return found;
}

static int fill_run(RunObject *self, int motion, PyObject *tables, PyObject *numbers)
{
    const Kernel *limits = own_kernel("limits");
    const RunKernels *kernels = &self->level->run;
    Py_ssize_t expected[RUN_TABLES], lengths[RUN_TABLES], count;

    if (!PyTuple_Check(tables) || PyTuple_GET_SIZE(tables) != RUN_TABLES) {
        PyErr_Format(PyExc_ValueError, "expected a tuple of %d tables", RUN_TABLES);
        return -1;
    }
    for (int k = 0; k < RUN_TABLES; ++k)
        expected[k] = -1;
    expected[0] = MOTION_NAMES[motion].constants;
    expected[1] = lane_place_constants;
    expected[2] = limits->constants;
    expected[3] = 3 * LIMITS;
    expected[20] = lane_limits_constants;
    for (int k = 0; k < RUN_TABLES; ++k) {
        self->tables[k] = copy_doubles(PyTuple_GET_ITEM(tables, k), "tables: one", expected[k], &lengths[k]);
        if (!self->tables[k])
            return -1;
    }
    self->run.motion = kernels->motions[motion];
    self->run.place = kernels->place;
    self->run.watch = kernels->watch;
    self->run.limits = bound_kernel(self->level, limits);
    if (set_tables(self, lengths) < 0)
        return -1;
    double *found = copy_doubles(numbers, "numbers", RUN_NUMBERS, &count);
    if (!found)
        return -1;
    set_numbers(&self->run, found);
    PyMem_Free(found);
    if (make_ring(&self->run) < 0 || set_controller(self, lengths) < 0)
        return -1;
    self->run.poll = poll_python;
    self->run.full = drain_python;
    self->run.room = self->run.samples < MOST_ROWS ? 0 : MOST_ROWS;
    self->run.out = PyMem_Malloc((size_t)((self->run.room ? self->run.room : self->run.samples + 1) * ROW) * sizeof(double));
    if (!self->run.out)
        PyErr_NoMemory();
    self->first = self->run;
    self->first_control = self->control;
    return self->run.out ? 0 : -1;
}

static PyObject *Run_new(PyTypeObject *type, PyObject *args, PyObject *keywords)
{
    static char *names[] = {"kernel", "level", "tables", "numbers", NULL};
    PyObject *kernel_name, *level_name, *tables, *numbers;

    if (!PyArg_ParseTupleAndKeywords(args, keywords, "UUOO:MachineRun", names, &kernel_name, &level_name, &tables,
                                     &numbers))
        return NULL;
    int motion = 0;
    while (motion < MOTIONS && PyUnicode_CompareWithASCIIString(kernel_name, MOTION_NAMES[motion].name) != 0)
        ++motion;
    if (motion == MOTIONS)
        PyErr_Format(PyExc_ValueError, "no kernel %R of motion", kernel_name);
    const Level *level = motion < MOTIONS ? level_named(level_name) : NULL;
    RunObject *self = level ? (RunObject *)PyType_GenericAlloc(type, 0) : NULL;
    if (!self)
        return NULL;
    self->level = level;
    if (fill_run(self, motion, tables, numbers) < 0)
        Py_CLEAR(self);
    return (PyObject *)self;
}

static void Run_dealloc(PyObject *object)
{
    RunObject *self = (RunObject *)object;
    PyTypeObject *type = Py_TYPE(object);
    for (int k = 0; k < RUN_TABLES; ++k)
        PyMem_Free(self->tables[k]);
    PyMem_Free(self->run.late);
    PyMem_Free(self->run.out);
    PyObject_Free(object);
    Py_DECREF(type);
}

PyDoc_STRVAR(Run_doc,
             "MachineRun(kernel, level, tables, numbers)\n--\n\n"
             "A run of one machine in time.\n\n"
             "Parameters\n----------\n"
             "kernel : str\n    `motion`, or with `_with_friction`, and with `_symmetric`, of lane_kernels.h.\n"
             "level : str\n    One of `levels`.\n"
             "tables : tuple of 21 buffers of doubles\n"
             "    Constants of that kernel, of lane_place and of limits; limits: bounds 12, signs 12, whether they\n"
             "    count 12; springs: stiffness 3, rest 3, damping 3, preload 3, or nothing; times of the load, its\n"
             "    rows of F_y, F_z, M_y; kinks; times of the samples. A controller of control.h, or eleven empty ones:\n"
             "    whether it is computed torque, noisy, counting, differencing, integrating, of a symmetric model,\n"
             "    largest forces, whether its model has friction, whether it feeds forces forward, whether what\n"
             "    it measures is just so and its model has the machine's lengths; gains; its table; noise;\n"
             "    constants of assembly, torque and inverse. If it acts all the time, the motion: ends of its\n"
             "    pieces; six coefficients of y, z, theta of each, the highest power first; first and last pose and\n"
             "    duration, 7; constants of place. Always the constants of lane_limits.\n"
             "numbers : buffer of 23 doubles\n"
             "    r, R, L, period, rtol, atol, longest step, largest forces 3, whether a controller outside\n"
             "    acts at every tick, pose 3, velocity 3, 2 pi bandwidth of the drives 3, whether steps are equal,\n"
             "    how many periods forces are late: whole ones, and a part of one.\n\n"
             "Raises\n------\n"
             "TypeError\n    If something is not a buffer of doubles.\n"
             "ValueError\n    If a name is unknown, or a buffer does not fit.");

PyDoc_STRVAR(advance_doc, "advance(told, drain=None, /)\n--\n\n"
                          "Go on; return 0 at the end, 1 where forces are to be held, 2 at a limit, 3 where no step is "
                          "small enough, 5 where the controller has no answer, 6 where it needs `rows`. `told`, or "
                          "None, is called with the number of samples every now and then; `drain` with the number "
                          "of rows that `samples` writes now, when there is no room for more: then they are forgotten.");
PyDoc_STRVAR(hold_doc, "hold(forces, /)\n--\n\nTake the forces of A, B, C, and those asked for, 6.");
PyDoc_STRVAR(live_doc, "live(into, /)\n--\n\nWrite time, pose 3, velocity 3, sliders 3 and their velocities 3.");
PyDoc_STRVAR(samples_doc,
             "samples(into, /)\n--\n\nWrite `count` rows of 13: time, pose, velocity, forces, forces asked for.");

PyDoc_STRVAR(begin_doc,
             "begin(start, /)\n--\n\nBegin again by the same tables: pose 3, velocity 3, the sign of the last limit, 7.");
PyDoc_STRVAR(rows_doc, "rows(table, noise, /)\n--\n\nTake the rows of the controller that come next, where `advance` "
                       "returned 6; none for no noise.");

static PyMethodDef Run_methods[] = {
    {"begin", Run_begin, METH_O, begin_doc},
    {"rows", Run_rows, METH_VARARGS, rows_doc},
    {"advance", (PyCFunction)(void (*)(void))Run_advance, METH_FASTCALL, advance_doc},
    {"hold", Run_hold, METH_O, hold_doc},
    {"live", Run_live, METH_O, live_doc},
    {"samples", Run_samples, METH_O, samples_doc},
    {NULL, NULL, 0, NULL},
};

static PyMemberDef Run_members[] = {
    {"time", Py_T_DOUBLE, offsetof(RunObject, run.t), Py_READONLY, "Where the run is [s]."},
    {"evaluations", Py_T_LONGLONG, offsetof(RunObject, run.evaluations), Py_READONLY, "Of the equations of motion."},
    {"count", Py_T_PYSSIZET, offsetof(RunObject, run.count), Py_READONLY, "How many samples there are."},
    {"index", Py_T_INT, offsetof(RunObject, run.index), Py_READONLY, "Which limit ended the run."},
    {NULL, 0, 0, 0, NULL},
};

static PyType_Slot Run_slots[] = {
    {Py_tp_doc, (void *)Run_doc},
    {Py_tp_new, (void *)Run_new},
    {Py_tp_methods, Run_methods},
    {Py_tp_members, Run_members},
    {Py_tp_dealloc, (void *)Run_dealloc},
    {0, NULL},
};

static PyType_Spec Run_spec = {
    .name = "p3dof._native._compiled.MachineRun",
    .basicsize = sizeof(RunObject),
    .flags = Py_TPFLAGS_DEFAULT | Py_TPFLAGS_IMMUTABLETYPE,
    .slots = Run_slots,
};

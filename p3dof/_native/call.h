/* `Call`: a kernel bound to columns of doubles, which runs all of them or a part. */

/* How a column reaches the kernel. */
typedef enum {
    PASSED,          /* as it is */
    REPEATED,        /* one number, stride 0 */
    MOVED,           /* through scratch */
    FIRST_OF_THREE,  /* through scratch with the next two: all of rows of three */
    FIRST_OF_ROW,    /* through scratch with the next ones: neighbours in rows of any length */
    WITH_FIRST,      /* with one before it */
    KEPT_IN_SCRATCH, /* the margin when nobody asked for it */
} Way;

typedef struct {
    double *data;     /* of the first sample; NULL for `KEPT_IN_SCRATCH` */
    ptrdiff_t stride; /* in doubles */
    Way way;
    int together; /* of `FIRST_...`: how many columns */
} Column;

typedef struct {
    PyObject_HEAD
    vectorcallfunc vectorcall;
    Run *run; /* NULL once the garbage collector took the buffers */
    const Level *level;
    const Kernel *kernel;
    Py_ssize_t size;  /* samples */
    int in_place;     /* whether all columns are passed as they are */
    double *constants;
    Column *columns; /* inputs, then outputs */
    Py_buffer *views;
    int held; /* how many views are held */
    const char *kernel_name, *level_name;
} Call;

/* Running */

static int run_in_place(const Call *self, Py_ssize_t start, Py_ssize_t count)
{
    const int inputs = self->kernel->inputs, outputs = self->kernel->outputs;
    const Column *column = self->columns;
    const double *in[MOST_INPUTS];
    double *out[MOST_OUTPUTS], margins[IN_PLACE_BLOCK];
    int good = 1;

    for (int k = 0; k < inputs; ++k, ++column)
        in[k] = column->data + start * column->stride;
    for (int k = 0; k < outputs; ++k, ++column)
        out[k] = column->way == KEPT_IN_SCRATCH ? margins : column->data + start * column->stride;
    if (count == 1) {
        self->run(1, self->constants, in, out);
        return out[outputs - 1][0] > 0.0;
    }
    for (;;) {
        const Py_ssize_t now = count < IN_PLACE_BLOCK ? count : IN_PLACE_BLOCK;
        self->run(now, self->constants, in, out);
        good &= self->level->all_positive(now, out[outputs - 1]);
        count -= now;
        if (count <= 0)
            return good;
        for (int k = 0; k < inputs; ++k)
            in[k] += now;
        for (int k = 0; k < outputs; ++k)
            out[k] += out[k] == margins ? 0 : now;
    }
}

static void gather_columns(const Call *self, Py_ssize_t start, Py_ssize_t now, const double **in, double *scratch)
{
    for (int k = 0; k < self->kernel->inputs; ++k) {
        const Column *column = &self->columns[k];
        const double *from = column->data + start * column->stride;
        double *to = scratch + k * LINE;
        if (column->way == PASSED)
            in[k] = from;
        else if (column->way == MOVED)
            self->level->gather(now, from, column->stride, to);
        else if (column->way == FIRST_OF_THREE)
            self->level->gather_three(now, from, to, LINE);
    }
}

static void scatter_columns(const Call *self, Py_ssize_t start, Py_ssize_t now, const double *scratch)
{
    for (int k = self->kernel->inputs; k < self->kernel->inputs + self->kernel->outputs; ++k) {
        const Column *column = &self->columns[k];
        double *to = column->data + start * column->stride;
        const double *from = scratch + k * LINE;
        if (column->way == MOVED)
            self->level->scatter(now, from, to, column->stride);
        else if (column->way == FIRST_OF_THREE)
            self->level->scatter_three(now, from, LINE, to);
        else if (column->way == FIRST_OF_ROW)
            self->level->scatter_rows(now, from, LINE, column->together, to, column->stride);
    }
}

static int run_through_scratch(const Call *self, Py_ssize_t start, Py_ssize_t stop)
{
    const int inputs = self->kernel->inputs, outputs = self->kernel->outputs;
    const double *in[MOST_INPUTS];
    double *out[MOST_OUTPUTS], room[MOST_COLUMNS * LINE + CACHE_LINE];
    double *scratch = room + CACHE_LINE - (uintptr_t)room / sizeof(double) % CACHE_LINE;
    int good = 1;

    for (int k = 0; k < inputs; ++k) {
        in[k] = scratch + k * LINE;
        if (self->columns[k].way == REPEATED)
            self->level->gather(BLOCK, self->columns[k].data, 0, scratch + k * LINE);
    }
    for (int k = 0; k < outputs; ++k)
        out[k] = scratch + (inputs + k) * LINE;
    for (Py_ssize_t now; start < stop; start += now) {
        now = stop - start < BLOCK ? stop - start : BLOCK;
        gather_columns(self, start, now, in, scratch);
        for (int k = 0; k < outputs; ++k)
            if (self->columns[inputs + k].way == PASSED)
                out[k] = self->columns[inputs + k].data + start;
        self->run(now, self->constants, in, out);
        good &= self->level->all_positive(now, out[outputs - 1]);
        scatter_columns(self, start, now, scratch);
    }
    return good;
}

static int run_part(const Call *self, Py_ssize_t start, Py_ssize_t stop)
{
    if (stop <= start)
        return 1;
    if (self->in_place || stop - start == 1)
        return run_in_place(self, start, stop - start);
    return run_through_scratch(self, start, stop);
}

static int read_part(const Call *self, PyObject *const *args, Py_ssize_t *start, Py_ssize_t *stop)
{
    *start = PyNumber_AsSsize_t(args[0], PyExc_ValueError);
    if (*start == -1 && PyErr_Occurred())
        return -1;
    *stop = PyNumber_AsSsize_t(args[1], PyExc_ValueError);
    if (*stop == -1 && PyErr_Occurred())
        return -1;
    if (*start < 0 || *stop < *start || *stop > self->size) {
        PyErr_Format(PyExc_ValueError, "a part must have 0 <= start <= stop <= %zd, not start %zd and stop %zd",
                     self->size, *start, *stop);
        return -1;
    }
    return 0;
}

static PyObject *Call_vectorcall(PyObject *callable, PyObject *const *args, size_t flagged, PyObject *names)
{
    Call *self = (Call *)callable;
    const Py_ssize_t count = PyVectorcall_NARGS(flagged);
    Py_ssize_t start = 0, stop = self->size;
    int good;

    if ((count != 0 && count != 2) || (names && PyTuple_GET_SIZE(names))) {
        PyErr_SetString(PyExc_TypeError, "a Call takes nothing, or the start and stop of a part, by position");
        return NULL;
    }
    if (count && read_part(self, args, &start, &stop) < 0)
        return NULL;
    if (!self->run) {
        PyErr_SetString(PyExc_ValueError, "the buffers of this Call are gone");
        return NULL;
    }
    if (stop - start > RELEASE_GIL) {
        Py_BEGIN_ALLOW_THREADS
        good = run_part(self, start, stop);
        Py_END_ALLOW_THREADS
    }
    else {
        good = run_part(self, start, stop);
    }
    return PyBool_FromLong(good);
}

/* Binding */

static int is_double(const Py_buffer *view)
{
    const char *format = view->format ? view->format : "B";
    if (*format == '@' || *format == '=' || *format == (PY_LITTLE_ENDIAN ? '<' : '>'))
        ++format;
    return strcmp(format, "d") == 0 && view->itemsize == (Py_ssize_t)sizeof(double);
}

/* Take a one-dimensional buffer of doubles; `what` and `index` name it in errors. */
static int take_buffer(PyObject *object, Py_buffer *view, int writable, const char *what, int index)
{
    if (!PyObject_CheckBuffer(object)) {
        PyObject *type = name_of_type(object);
        if (type)
            PyErr_Format(PyExc_TypeError, "%s %d must be a buffer of doubles, not %.100U", what, index, type);
        Py_XDECREF(type);
        return -1;
    }
    if (PyObject_GetBuffer(object, view, PyBUF_RECORDS_RO) < 0)
        return -1;
    if (!is_double(view))
        PyErr_Format(PyExc_TypeError, "%s %d must hold doubles (format 'd'), not format '%.20s'", what, index,
                     view->format ? view->format : "B");
    else if (view->ndim != 1)
        PyErr_Format(PyExc_ValueError, "%s %d must have one dimension, not %d", what, index, view->ndim);
    else if ((uintptr_t)view->buf % sizeof(double) || view->strides[0] % (Py_ssize_t)sizeof(double))
        PyErr_Format(PyExc_ValueError, "%s %d must be aligned to whole doubles", what, index);
    else if (writable && view->readonly)
        PyErr_Format(PyExc_ValueError, "%s %d must be writable, but is read-only", what, index);
    else if (writable && view->strides[0] == 0 && view->shape[0] > 1)
        PyErr_Format(PyExc_ValueError, "%s %d must have room for every sample, but its stride is 0", what, index);
    else
        return 0;
    PyBuffer_Release(view);
    return -1;
}

/* Return a copy of a buffer of constants, for PyMem_Free. */
static double *copy_constants(const Kernel *kernel, PyObject *constants)
{
    Py_buffer view;
    double *copy = NULL;

    if (take_buffer(constants, &view, 0, "the buffer of constants, argument", 3) < 0)
        return NULL;
    if (view.shape[0] != kernel->constants)
        PyErr_Format(PyExc_ValueError, "%s takes %d constants, not %zd", kernel->name, kernel->constants,
                     view.shape[0]);
    else if (!(copy = PyMem_Malloc((size_t)kernel->constants * sizeof(double))))
        PyErr_NoMemory();
    for (Py_ssize_t k = 0; copy && k < view.shape[0]; ++k)
        copy[k] = *(const double *)((const char *)view.buf + k * view.strides[0]);
    PyBuffer_Release(&view);
    return copy;
}

static int take_column(Call *self, PyObject *object, int writable, int index)
{
    Column *column = &self->columns[writable ? self->kernel->inputs + index : index];
    Py_buffer *view = &self->views[self->held];
    const char *what = writable ? "output" : "input";

    if (take_buffer(object, view, writable, what, index) < 0)
        return -1;
    ++self->held;
    if (self->held == 1)
        self->size = view->shape[0];
    if (view->shape[0] != self->size) {
        PyErr_Format(PyExc_ValueError, "%s %d has %zd samples, but input 0 has %zd", what, index, view->shape[0],
                     self->size);
        return -1;
    }
    column->data = view->buf;
    column->stride = view->strides[0] / (Py_ssize_t)sizeof(double);
    return 0;
}

static int take_columns(Call *self, PyObject *sequence, int writable)
{
    const int expected = writable ? self->kernel->outputs : self->kernel->inputs;
    const char *what = writable ? "outputs" : "inputs";
    PyObject *given = PySequence_Tuple(sequence);
    int result = 0;

    if (!given)
        return -1;
    if (PyTuple_GET_SIZE(given) != expected) {
        PyErr_Format(PyExc_ValueError, "%s takes %d %s, not %zd", self->kernel->name, expected, what,
                     PyTuple_GET_SIZE(given));
        result = -1;
    }
    for (int k = 0; k < expected && result == 0; ++k) {
        PyObject *object = PyTuple_GET_ITEM(given, k);
        if (writable && k == expected - 1 && object == Py_None)
            self->columns[self->kernel->inputs + k].way = KEPT_IN_SCRATCH;
        else
            result = take_column(self, object, writable, k);
    }
    Py_DECREF(given);
    return result;
}

static uintptr_t magnitude(ptrdiff_t stride)
{
    return (uintptr_t)(stride < 0 ? -stride : stride);
}

/* Whether a sample of one column may be a sample of the other. Exact but for columns of different strides whose ends
 * alone keep them apart: their numbers lie on lattices, and are apart for sure when these are. */
static int may_overlap(const Column *a, const Column *b, Py_ssize_t size)
{
    const ptrdiff_t length_a = (size - 1) * a->stride, length_b = (size - 1) * b->stride;
    const double *low_a = a->data + (length_a < 0 ? length_a : 0), *high_a = a->data + (length_a > 0 ? length_a : 0);
    const double *low_b = b->data + (length_b < 0 ? length_b : 0), *high_b = b->data + (length_b > 0 ? length_b : 0);
    uintptr_t step = magnitude(a->stride), rest = magnitude(b->stride);

    if (size == 0 || (uintptr_t)low_a > (uintptr_t)high_b || (uintptr_t)low_b > (uintptr_t)high_a)
        return 0;
    while (rest) { /* the greatest common divisor */
        const uintptr_t next = step % rest;
        step = rest;
        rest = next;
    }
    const uintptr_t apart = (uintptr_t)low_a > (uintptr_t)low_b ? (uintptr_t)low_a - (uintptr_t)low_b
                                                                 : (uintptr_t)low_b - (uintptr_t)low_a;
    return step == 0 || apart / sizeof(double) % step == 0;
}

/* The kernels may write any output before they have read every input of the sample. */
static int check_overlap(const Call *self)
{
    const int inputs = self->kernel->inputs, columns = inputs + self->kernel->outputs;
    for (int k = inputs; k < columns; ++k) {
        if (self->columns[k].way == KEPT_IN_SCRATCH)
            continue;
        for (int other = 0; other < k; ++other) {
            if (may_overlap(&self->columns[k], &self->columns[other], self->size)) {
                PyErr_Format(PyExc_ValueError, "output %d shares memory with %s %d", k - inputs,
                             other < inputs ? "input" : "output", other < inputs ? other : other - inputs);
                return -1;
            }
        }
    }
    return 0;
}

/* How many columns from this one on are neighbours in the same rows. */
static int count_neighbours(const Column *column, int left)
{
    int count = 1;
    while (count < left && column[count].data == column->data + count && column[count].stride == column->stride)
        ++count;
    return count;
}

static Way way_of(Column *column, int left, int writable)
{
    column->together = 1;
    if (column->way == KEPT_IN_SCRATCH)
        return KEPT_IN_SCRATCH;
    if (column->stride == 0)
        return REPEATED;
    if (column->stride == 1)
        return PASSED;
    const int neighbours = count_neighbours(column, left);
    if (column->stride == 3 && neighbours >= 3) {
        column->together = 3;
        return FIRST_OF_THREE;
    }
    if (writable && neighbours > 1) {
        column->together = neighbours;
        return FIRST_OF_ROW;
    }
    return MOVED;
}

static void plan_columns(Column *columns, int count, int writable)
{
    for (int k = 0; k < count; k += columns[k].together) {
        columns[k].way = way_of(&columns[k], count - k, writable);
        for (int with = 1; with < columns[k].together; ++with)
            columns[k + with].way = WITH_FIRST;
    }
}

static void plan(Call *self)
{
    const int count = self->kernel->inputs + self->kernel->outputs;

    plan_columns(self->columns, self->kernel->inputs, 0);
    plan_columns(self->columns + self->kernel->inputs, self->kernel->outputs, 1);
    self->in_place = 1;
    for (int k = 0; k < count; ++k)
        self->in_place &= self->columns[k].way == PASSED || self->columns[k].way == KEPT_IN_SCRATCH;
}

static const Kernel *kernel_named(PyObject *name)
{
    for (int k = 0; k < KERNEL_COUNT; ++k)
        if (PyUnicode_CompareWithASCIIString(name, KERNELS[k].name) == 0)
            return &KERNELS[k];
    PyErr_Format(PyExc_ValueError, "there is no kernel %R; `kernels` has their names", name);
    return NULL;
}

/* A kernel that there is. */
static const Kernel *own_kernel(const char *name)
{
    int k = 0;
    while (strcmp(KERNELS[k].name, name) != 0)
        ++k;
    return &KERNELS[k];
}

static const Level *level_named(PyObject *name)
{
    const int runnable = runnable_levels();
    for (int k = 0; k < runnable; ++k)
        if (PyUnicode_CompareWithASCIIString(name, LEVELS[k]->name) == 0)
            return LEVELS[k];
    PyErr_Format(PyExc_ValueError, "this CPU runs no level %R; `levels` has the names of those that it does", name);
    return NULL;
}

static int reserve(Call *self)
{
    const int columns = self->kernel->inputs + self->kernel->outputs;
    self->columns = PyMem_Calloc((size_t)columns, sizeof(Column));
    self->views = PyMem_Calloc((size_t)columns, sizeof(Py_buffer));
    if (self->columns && self->views)
        return 0;
    PyErr_NoMemory();
    return -1;
}

static PyObject *Call_new(PyTypeObject *type, PyObject *args, PyObject *keywords)
{
    static char *names[] = {"kernel", "level", "constants", "inputs", "outputs", NULL};
    PyObject *kernel_name, *level_name, *constants, *inputs, *outputs;

    if (!PyArg_ParseTupleAndKeywords(args, keywords, "UUOOO:Call", names, &kernel_name, &level_name, &constants,
                                     &inputs, &outputs))
        return NULL;
    const Kernel *kernel = kernel_named(kernel_name);
    const Level *level = kernel ? level_named(level_name) : NULL;
    if (!level)
        return NULL;
    Call *self = (Call *)PyType_GenericAlloc(type, 0);
    if (!self)
        return NULL;
    self->kernel = kernel;
    self->level = level;
    self->kernel_name = kernel->name;
    self->level_name = level->name;
    self->vectorcall = Call_vectorcall;
    self->constants = copy_constants(kernel, constants);
    if (!self->constants || reserve(self) < 0 || take_columns(self, inputs, 0) < 0 ||
        take_columns(self, outputs, 1) < 0 || check_overlap(self) < 0) {
        Py_DECREF(self);
        return NULL;
    }
    plan(self);
    self->run = level->runs[kernel - KERNELS];
    return (PyObject *)self;
}

static int Call_traverse(PyObject *object, visitproc visit, void *arg)
{
    Call *self = (Call *)object;
    for (int k = 0; k < self->held; ++k)
        Py_VISIT(self->views[k].obj);
    Py_VISIT(Py_TYPE(object));
    return 0;
}

static int Call_clear(PyObject *object)
{
    Call *self = (Call *)object;
    self->run = NULL;
    while (self->held)
        PyBuffer_Release(&self->views[--self->held]);
    return 0;
}

static void Call_dealloc(PyObject *object)
{
    Call *self = (Call *)object;
    PyTypeObject *type = Py_TYPE(object);
    PyObject_GC_UnTrack(object);
    Call_clear(object);
    PyMem_Free(self->constants);
    PyMem_Free(self->columns);
    PyMem_Free(self->views);
    PyObject_GC_Del(object);
    Py_DECREF(type);
}

PyDoc_STRVAR(Call_doc,
             "Call(kernel, level, constants, inputs, outputs)\n--\n\n"
             "A kernel bound to its columns.\n\n"
             "``call()`` runs all samples, ``call(start, stop)`` a part of them, so that several threads can share the\n"
             "work; both return whether every margin was > 0.\n\n"
             "Parameters\n----------\n"
             "kernel : str\n    One of `kernels`.\n"
             "level : str\n    One of `levels`.\n"
             "constants : buffer of doubles\n    The numbers of the machine; copied.\n"
             "inputs, outputs : sequence of buffers of doubles\n"
             "    One column each, of the same length and any stride; held as long as the call lives. Outputs must be\n"
             "    writable and share no memory with an input or another output. The last output is the margin;\n"
             "    None if nobody wants it.\n\n"
             "Raises\n------\n"
             "TypeError\n    If something is not a buffer of doubles.\n"
             "ValueError\n    If a name is unknown, or a buffer does not fit.");

static PyMemberDef Call_members[] = {
    {"__vectorcalloffset__", Py_T_PYSSIZET, offsetof(Call, vectorcall), Py_READONLY, NULL},
    {"kernel", Py_T_STRING, offsetof(Call, kernel_name), Py_READONLY, "Name of the kernel."},
    {"level", Py_T_STRING, offsetof(Call, level_name), Py_READONLY, "Name of the level."},
    {"size", Py_T_PYSSIZET, offsetof(Call, size), Py_READONLY, "How many samples the columns have."},
    {NULL, 0, 0, 0, NULL},
};

static PyType_Slot Call_slots[] = {
    {Py_tp_doc, (void *)Call_doc},
    {Py_tp_new, (void *)Call_new},
    {Py_tp_call, (void *)PyVectorcall_Call},
    {Py_tp_members, Call_members},
    {Py_tp_traverse, (void *)Call_traverse},
    {Py_tp_clear, (void *)Call_clear},
    {Py_tp_dealloc, (void *)Call_dealloc},
    {0, NULL},
};

static PyType_Spec Call_spec = {
    .name = "p3dof._native._compiled.Call",
    .basicsize = sizeof(Call),
    .flags = Py_TPFLAGS_DEFAULT | Py_TPFLAGS_HAVE_GC | Py_TPFLAGS_HAVE_VECTORCALL | Py_TPFLAGS_IMMUTABLETYPE,
    .slots = Call_slots,
};

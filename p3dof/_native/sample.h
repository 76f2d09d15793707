/* `Sample`: a kernel of one sample, from small arrays or lists of numbers into an array; or of some rows of samples. */

typedef struct {
    int length; /* numbers of an argument */
    int first;  /* of `taken` */
    int count;  /* how many of its numbers the kernel reads */
} Argument;

typedef struct {
    int output;   /* of the kernel; -1: the constant */
    double value; /* the constant */
} Entry;

enum { MOST_ARGUMENTS = 4, MOST_NUMBERS = 8, MOST_ENTRIES = 30 };

typedef struct {
    PyObject_HEAD
    vectorcallfunc vectorcall;
    Run *run;
    const Kernel *kernel;
    double *constants;
    PyObject *empty, *shape; /* what makes an array, and what it is called with */
    Argument arguments[MOST_ARGUMENTS];
    Entry entries[MOST_ENTRIES];
    int argument_count, entry_count, dimensions;
    int in_order; /* whether the entries are the first three outputs, as they come */
    const Level *level;
    Py_ssize_t sizes[2];
    int taken[MOST_INPUTS];
    const char *kernel_name, *level_name;
} Sample;

/* Where numbers came from: nothing may be written there. */
typedef struct {
    uintptr_t low, high;
} Range;

static Range range_of(const Py_buffer *view)
{
    uintptr_t low = (uintptr_t)view->buf, high = low + (uintptr_t)view->itemsize;
    for (int k = 0; k < view->ndim; ++k) {
        const ptrdiff_t length = (view->shape[k] - 1) * view->strides[k];
        if (length < 0)
            low -= (uintptr_t)-length;
        else
            high += (uintptr_t)length;
    }
    const Range range = {low, high};
    return range;
}

/* Read a list or tuple of plain numbers; 0 if it is something else. Runs no code of the numbers. */
static int read_sequence(PyObject *given, int length, double *numbers)
{
#ifdef Py_GIL_DISABLED
    if (!PyTuple_CheckExact(given)) /* another thread may change a list */
        return 0;
#else
    if (!PyList_CheckExact(given) && !PyTuple_CheckExact(given))
        return 0;
#endif
    if (PySequence_Fast_GET_SIZE(given) != length)
        return 0;
    for (int k = 0; k < length; ++k) {
        PyObject *item = PySequence_Fast_GET_ITEM(given, k);
        if (!PyFloat_Check(item) && !PyLong_CheckExact(item))
            return 0;
        numbers[k] = PyFloat_AsDouble(item);
        if (numbers[k] == -1.0 && PyErr_Occurred()) { /* an integer beyond all doubles */
            PyErr_Clear();
            return 0;
        }
    }
    return 1;
}

/* Whether an object lends its numbers: not if its class was written in Python, where a mask may hide some of them. */
static int lends_numbers(PyObject *given)
{
    return PyObject_CheckBuffer(given) && !PyType_HasFeature(Py_TYPE(given), Py_TPFLAGS_HEAPTYPE);
}

/* Read an array of doubles; 0 if it is something else. */
static int read_array(PyObject *given, int length, double *numbers, Range *range)
{
    Py_buffer view;
    int good = 0;

    if (!lends_numbers(given))
        return 0;
    if (PyObject_GetBuffer(given, &view, PyBUF_RECORDS_RO) < 0) {
        PyErr_Clear();
        return 0;
    }
    if (view.ndim == 1 && view.shape[0] == length && is_double(&view)) {
        for (int k = 0; k < length; ++k)
            memcpy(&numbers[k], (const char *)view.buf + k * view.strides[0], sizeof(double));
        *range = range_of(&view);
        good = 1;
    }
    PyBuffer_Release(&view);
    return good;
}

/* Read all arguments into the inputs of the kernel; 0 if one is no row of plain finite numbers. */
static int read_arguments(const Sample *self, PyObject *const *given, double *inputs, Range *ranges)
{
    double numbers[MOST_NUMBERS];

    for (int k = 0; k < self->argument_count; ++k) {
        const Argument *argument = &self->arguments[k];
        ranges[k].low = ranges[k].high = 0;
        if (!read_sequence(given[k], argument->length, numbers) &&
            !read_array(given[k], argument->length, numbers, &ranges[k]))
            return 0;
        for (int i = 0; i < argument->length; ++i)
            if (!isfinite(numbers[i]))
                return 0;
        for (int i = argument->first; i < argument->first + argument->count; ++i)
            inputs[i] = numbers[self->taken[i]];
    }
    return 1;
}

static int fits(const Sample *self, const Py_buffer *view, const Range *ranges)
{
    if (view->readonly || view->ndim != self->dimensions || !is_double(view))
        return 0;
    for (int k = 0; k < self->dimensions; ++k)
        if (view->shape[k] != self->sizes[k] || view->strides[k] == 0)
            return 0;
    const Range range = range_of(view);
    for (int k = 0; k < self->argument_count; ++k)
        if (range.low < ranges[k].high && ranges[k].low < range.high)
            return 0;
    return 1;
}

/* Write the entries into an array; 0 if it does not fit, -1 after an error. */
static int write_entries(const Sample *self, PyObject *array, const double *outputs, const Range *ranges)
{
    Py_buffer view;
    int entry = 0, good;

    if (!PyObject_CheckBuffer(array))
        return 0;
    if (PyObject_GetBuffer(array, &view, PyBUF_RECORDS) < 0) { /* such as one that is read-only */
        PyErr_Clear();
        return 0;
    }
    good = fits(self, &view, ranges);
    const Py_ssize_t rows = self->dimensions == 2 ? self->sizes[0] : 1;
    const Py_ssize_t columns = self->sizes[self->dimensions - 1];
    for (Py_ssize_t row = 0; good && row < rows; ++row) {
        char *to = (char *)view.buf + (self->dimensions == 2 ? row * view.strides[0] : 0);
        for (Py_ssize_t column = 0; column < columns; ++column, ++entry) {
            const Entry *from = &self->entries[entry];
            const double value = from->output < 0 ? from->value : outputs[from->output];
            memcpy(to + column * view.strides[self->dimensions - 1], &value, sizeof value);
        }
    }
    PyBuffer_Release(&view);
    return good;
}

/* Some rows of samples at once */

/* The numbers of an argument: of every sample, or one row for all of them. */
typedef struct {
    const double *data;
    ptrdiff_t step; /* from a row to the next, in doubles; 0: for all of them */
    double own[MOST_NUMBERS];
} Rows;

static int has_doubles(const Py_buffer *view, int dimensions)
{
    const ptrdiff_t size = sizeof(double);
    return view->ndim == dimensions && is_double(view) && (uintptr_t)view->buf % sizeof(double) == 0 &&
           view->strides[0] % size == 0 && (view->shape[dimensions - 1] == 1 || view->strides[dimensions - 1] == size);
}

/* Whether all numbers of an argument are finite, where the kernel's margin would not tell: where it reads not all. */
static int all_finite(const Argument *argument, const Rows *rows, Py_ssize_t count)
{
    if (rows->step && argument->count == argument->length)
        return 1;
    for (Py_ssize_t row = 0; row < (rows->step ? count : 1); ++row)
        for (int i = 0; i < argument->length; ++i)
            if (!isfinite(rows->data[row * rows->step + i]))
                return 0;
    return 1;
}

/* Take all arguments; 0 if one is neither rows of doubles, as many as the others have, nor a row for all. */
static int take_rows(const Sample *self, PyObject *const *given, Rows *rows, Range *ranges, Py_buffer *views, int *held,
                     Py_ssize_t *count)
{
    for (int k = 0; k < self->argument_count; ++k) {
        const int length = self->arguments[k].length;
        Py_buffer *view = &views[*held];
        ranges[k].low = ranges[k].high = 0;
        rows[k].step = 0;
        rows[k].data = rows[k].own;
        if (read_sequence(given[k], length, rows[k].own) || read_array(given[k], length, rows[k].own, &ranges[k]))
            continue;
        if (!lends_numbers(given[k]))
            return 0;
        if (PyObject_GetBuffer(given[k], view, PyBUF_RECORDS_RO) < 0) {
            PyErr_Clear();
            return 0;
        }
        ++*held;
        if (!has_doubles(view, 2) || view->shape[1] != length || view->shape[0] < 1 || view->shape[0] > RELEASE_GIL ||
            (*count && view->shape[0] != *count))
            return 0;
        *count = view->shape[0];
        rows[k].data = view->buf;
        rows[k].step = view->strides[0] / (ptrdiff_t)sizeof(double);
        if (rows[k].step == 0)
            memcpy(rows[k].own, view->buf, (size_t)length * sizeof(double));
        ranges[k] = range_of(view);
    }
    for (int k = 0; k < self->argument_count; ++k)
        if (!all_finite(&self->arguments[k], &rows[k], *count))
            return 0;
    return *count > 0;
}

static void gather_rows(const Sample *self, const Rows *rows, Py_ssize_t start, Py_ssize_t now, double *scratch)
{
    for (int k = 0; k < self->argument_count; ++k) {
        const Argument *argument = &self->arguments[k];
        const double *from = rows[k].data + start * rows[k].step;
        double *to = scratch + argument->first * LINE;
        const int *taken = &self->taken[argument->first];
        if (rows[k].step == 3 && argument->count == 3 && taken[0] == 0 && taken[1] == 1 && taken[2] == 2)
            self->level->gather_three(now, from, to, LINE);
        else
            for (int i = 0; i < argument->count; ++i)
                self->level->gather(now, from + taken[i], rows[k].step, to + i * LINE);
    }
}

static void scatter_entries(const Sample *self, Py_ssize_t now, const double *outputs, double *to)
{
    if (self->in_order) {
        self->level->scatter_three(now, outputs, LINE, to);
        return;
    }
    for (int k = 0; k < self->entry_count; ++k) {
        const Entry *entry = &self->entries[k];
        if (entry->output < 0)
            for (Py_ssize_t row = 0; row < now; ++row)
                to[row * self->entry_count + k] = entry->value;
        else
            self->level->scatter(now, outputs + entry->output * LINE, to + k, self->entry_count);
    }
}

/* Whether every sample is clearly good; what has been written is not to be used otherwise. */
static int compute_rows(const Sample *self, const Rows *rows, Py_ssize_t count, double *to)
{
    const int inputs = self->kernel->inputs, outputs = self->kernel->outputs;
    const double *in[MOST_INPUTS];
    double *out[MOST_OUTPUTS], room[MOST_COLUMNS * LINE + CACHE_LINE];
    double *scratch = room + CACHE_LINE - (uintptr_t)room / sizeof(double) % CACHE_LINE;

    for (int k = 0; k < inputs; ++k)
        in[k] = scratch + k * LINE;
    for (int k = 0; k < outputs; ++k)
        out[k] = scratch + (inputs + k) * LINE;
    for (Py_ssize_t start = 0; start < count; start += BLOCK) {
        const Py_ssize_t now = count - start < BLOCK ? count - start : BLOCK;
        gather_rows(self, rows, start, now, scratch);
        self->run(now, self->constants, in, out);
        if (!self->level->all_positive(now, out[outputs - 1]))
            return 0;
        scatter_entries(self, now, out[0], to + start * self->entry_count);
    }
    return 1;
}

/* Whether an array has room for rows of results, in the order of C, apart from what they are computed from. */
static int fits_rows(const Sample *self, const Py_buffer *view, Py_ssize_t count, const Range *ranges)
{
    if (view->readonly || !has_doubles(view, 1 + self->dimensions) || view->shape[0] != count ||
        !PyBuffer_IsContiguous(view, 'C'))
        return 0;
    for (int k = 0; k < self->dimensions; ++k)
        if (view->shape[1 + k] != self->sizes[k])
            return 0;
    const Range range = range_of(view);
    for (int k = 0; k < self->argument_count; ++k)
        if (range.low < ranges[k].high && ranges[k].low < range.high)
            return 0;
    return 1;
}

static PyObject *new_rows(const Sample *self, Py_ssize_t count)
{
    PyObject *shape = self->dimensions == 1 ? Py_BuildValue("(nn)", count, self->sizes[0])
                                            : Py_BuildValue("(nnn)", count, self->sizes[0], self->sizes[1]);
    PyObject *array = shape ? PyObject_CallOneArg(self->empty, shape) : NULL;
    Py_XDECREF(shape);
    return array;
}

/* The results of rows in an array; None where somebody must look closer, NULL after an error. */
static PyObject *run_rows(const Sample *self, PyObject *out, PyObject *const *given)
{
    Rows rows[MOST_ARGUMENTS];
    Range ranges[MOST_ARGUMENTS];
    Py_buffer views[MOST_ARGUMENTS], room;
    PyObject *array = NULL;
    Py_ssize_t count = 0;
    int held = 0, good = 0;

    if (take_rows(self, given, rows, ranges, views, &held, &count)) {
        array = out == Py_None ? new_rows(self, count) : Py_NewRef(out);
        if (array && PyObject_CheckBuffer(array)) {
            if (PyObject_GetBuffer(array, &room, PyBUF_RECORDS) == 0) {
                good = fits_rows(self, &room, count, ranges) && compute_rows(self, rows, count, room.buf);
                PyBuffer_Release(&room);
            }
            else
                PyErr_Clear();
        }
    }
    for (int k = 0; k < held; ++k)
        PyBuffer_Release(&views[k]);
    if (good || PyErr_Occurred())
        return array;
    Py_XDECREF(array);
    Py_RETURN_NONE;
}

static PyObject *Sample_vectorcall(PyObject *callable, PyObject *const *args, size_t flagged, PyObject *names)
{
    Sample *self = (Sample *)callable;
    double numbers[MOST_INPUTS], results[MOST_OUTPUTS];
    const double *in[MOST_INPUTS];
    double *out[MOST_OUTPUTS];
    Range ranges[MOST_ARGUMENTS];

    if (PyVectorcall_NARGS(flagged) != 1 + self->argument_count || (names && PyTuple_GET_SIZE(names)))
        return PyErr_Format(PyExc_TypeError, "%s takes an array or None and %d arguments, by position",
                            self->kernel->name, self->argument_count);
    if (!read_arguments(self, args + 1, numbers, ranges))
        return run_rows(self, args[0], args + 1);
    for (int k = 0; k < self->kernel->inputs; ++k)
        in[k] = &numbers[k];
    for (int k = 0; k < self->kernel->outputs; ++k)
        out[k] = &results[k];
    self->run(1, self->constants, in, out);
    if (!(results[self->kernel->outputs - 1] > 0.0))
        Py_RETURN_NONE;
    PyObject *array = args[0] == Py_None ? PyObject_CallOneArg(self->empty, self->shape) : Py_NewRef(args[0]);
    if (!array)
        return NULL;
    if (write_entries(self, array, results, ranges))
        return array;
    Py_DECREF(array);
    Py_RETURN_NONE;
}

/* Making */

static int take_argument(Sample *self, PyObject *row, int *count)
{
    Argument *argument = &self->arguments[self->argument_count];
    PyObject *taken;

    if (!PyTuple_Check(row) || !PyArg_ParseTuple(row, "iO!", &argument->length, &PyTuple_Type, &taken))
        return -1;
    argument->first = *count;
    argument->count = (int)PyTuple_GET_SIZE(taken);
    if (argument->length < 1 || argument->length > MOST_NUMBERS ||
        argument->count > self->kernel->inputs - argument->first)
        return -1;
    for (int k = 0; k < argument->count; ++k) {
        const long place = PyLong_AsLong(PyTuple_GET_ITEM(taken, k));
        if (place < 0 || place >= argument->length)
            return -1;
        self->taken[(*count)++] = (int)place;
    }
    ++self->argument_count;
    return 0;
}

static int take_entry(Sample *self, PyObject *item)
{
    Entry *entry = &self->entries[self->entry_count++];
    if (PyFloat_Check(item)) {
        entry->output = -1;
        entry->value = PyFloat_AS_DOUBLE(item);
        return 0;
    }
    const long output = PyLong_AsLong(item);
    entry->output = (int)output;
    return output < 0 || output >= self->kernel->outputs ? -1 : 0;
}

static int take_shape(Sample *self, PyObject *shape)
{
    Py_ssize_t size = 1;
    self->dimensions = (int)PyTuple_GET_SIZE(shape);
    if (self->dimensions < 1 || self->dimensions > 2)
        return -1;
    for (int k = 0; k < self->dimensions; ++k) {
        self->sizes[k] = PyLong_AsSsize_t(PyTuple_GET_ITEM(shape, k));
        if (self->sizes[k] < 1 || self->sizes[k] > MOST_ENTRIES)
            return -1;
        size *= self->sizes[k];
    }
    return size == self->entry_count ? 0 : -1;
}

/* What the arguments and the result are made of; -1, perhaps without an exception, if it does not fit the kernel. */
static int take_layout(Sample *self, PyObject *arguments, PyObject *entries, PyObject *shape)
{
    int count = 0;
    if (PyTuple_GET_SIZE(arguments) > MOST_ARGUMENTS || PyTuple_GET_SIZE(entries) > MOST_ENTRIES)
        return -1;
    for (Py_ssize_t k = 0; k < PyTuple_GET_SIZE(arguments); ++k)
        if (take_argument(self, PyTuple_GET_ITEM(arguments, k), &count) < 0)
            return -1;
    for (Py_ssize_t k = 0; k < PyTuple_GET_SIZE(entries); ++k)
        if (take_entry(self, PyTuple_GET_ITEM(entries, k)) < 0)
            return -1;
    self->in_order = self->entry_count == 3;
    for (int k = 0; k < self->entry_count; ++k)
        self->in_order &= self->entries[k].output == k;
    return count == self->kernel->inputs ? take_shape(self, shape) : -1;
}

static PyObject *Sample_new(PyTypeObject *type, PyObject *args, PyObject *keywords)
{
    static char *names[] = {"kernel", "level", "constants", "arguments", "entries", "shape", "empty", NULL};
    PyObject *kernel_name, *level_name, *constants, *arguments, *entries, *shape, *empty;

    if (!PyArg_ParseTupleAndKeywords(args, keywords, "UUOO!O!O!O:Sample", names, &kernel_name, &level_name, &constants,
                                     &PyTuple_Type, &arguments, &PyTuple_Type, &entries, &PyTuple_Type, &shape,
                                     &empty))
        return NULL;
    const Kernel *kernel = kernel_named(kernel_name);
    const Level *level = kernel ? level_named(level_name) : NULL;
    if (!level)
        return NULL;
    Sample *self = (Sample *)PyType_GenericAlloc(type, 0);
    if (!self)
        return NULL;
    self->vectorcall = Sample_vectorcall;
    self->run = level->runs[kernel - KERNELS];
    self->level = level;
    self->kernel = kernel;
    self->kernel_name = kernel->name;
    self->level_name = level->name;
    self->empty = Py_NewRef(empty);
    self->shape = Py_NewRef(shape);
    if (take_layout(self, arguments, entries, shape) < 0) {
        if (!PyErr_Occurred())
            PyErr_Format(PyExc_ValueError, "%s: arguments, entries or shape do not fit", kernel->name);
        Py_DECREF(self);
        return NULL;
    }
    self->constants = copy_constants(kernel, constants);
    if (!self->constants)
        Py_CLEAR(self);
    return (PyObject *)self;
}

static void Sample_dealloc(PyObject *object)
{
    Sample *self = (Sample *)object;
    PyTypeObject *type = Py_TYPE(object);
    Py_XDECREF(self->empty);
    Py_XDECREF(self->shape);
    PyMem_Free(self->constants);
    PyObject_Free(object);
    Py_DECREF(type);
}

PyDoc_STRVAR(Sample_doc,
             "Sample(kernel, level, constants, arguments, entries, shape, empty)\n--\n\n"
             "A kernel of one sample, from rows of numbers into an array.\n\n"
             "``sample(out, *rows)`` returns `out` with the result in it, or a new array if `out` is None. It returns\n"
             "None, and has written nothing, if a row is no array of doubles, list or tuple of floats of the right\n"
             "length, if a number is not finite, if the margin is not > 0, or if `out` does not fit, is read-only or\n"
             "lies among the memory of a row: whoever calls then finds out which of these, and what to do.\n\n"
             "Arrays of doubles of up to 2000 rows, all of as many, are that many samples, and so has the result rows;\n"
             "a single row beside them is for all. After None, what `out` had is then lost.\n\n"
             "Parameters\n----------\n"
             "kernel : str\n    One of `kernels`.\n"
             "level : str\n    One of `levels`.\n"
             "constants : buffer of doubles\n    The numbers of the machine; copied.\n"
             "arguments : tuple of (int, tuple of int)\n"
             "    Of each row: how many numbers it has, and which of them the kernel reads, in order of its inputs.\n"
             "entries : tuple of int or float\n"
             "    Of each number of the result, row by row: which output it is, or, as a float, what it always is.\n"
             "shape : tuple of int\n    Of the result: one or two dimensions.\n"
             "empty : callable\n    Returns a new array of doubles of a shape.\n\n"
             "Raises\n------\n"
             "TypeError\n    If the constants are not a buffer of doubles.\n"
             "ValueError\n    If a name is unknown, or something does not fit.");

static PyMemberDef Sample_members[] = {
    {"__vectorcalloffset__", Py_T_PYSSIZET, offsetof(Sample, vectorcall), Py_READONLY, NULL},
    {"kernel", Py_T_STRING, offsetof(Sample, kernel_name), Py_READONLY, "Name of the kernel."},
    {"level", Py_T_STRING, offsetof(Sample, level_name), Py_READONLY, "Name of the level."},
    {NULL, 0, 0, 0, NULL},
};

static PyType_Slot Sample_slots[] = {
    {Py_tp_doc, (void *)Sample_doc},
    {Py_tp_new, (void *)Sample_new},
    {Py_tp_call, (void *)PyVectorcall_Call},
    {Py_tp_members, Sample_members},
    {Py_tp_dealloc, (void *)Sample_dealloc},
    {0, NULL},
};

static PyType_Spec Sample_spec = {
    .name = "p3dof._native._compiled.Sample",
    .basicsize = sizeof(Sample),
    .flags = Py_TPFLAGS_DEFAULT | Py_TPFLAGS_HAVE_VECTORCALL | Py_TPFLAGS_IMMUTABLETYPE,
    .slots = Sample_slots,
};

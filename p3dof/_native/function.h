/* `Function`: a kernel of one sample, numbers in and numbers out. */

typedef struct {
    PyObject_HEAD
    vectorcallfunc vectorcall;
    Run *run;
    const Kernel *kernel;
    double *constants;
    const char *kernel_name, *level_name;
} Function;

static PyObject *Function_vectorcall(PyObject *callable, PyObject *const *args, size_t flagged, PyObject *names)
{
    Function *self = (Function *)callable;
    const int inputs = self->kernel->inputs, outputs = self->kernel->outputs;
    double numbers[MOST_INPUTS], results[MOST_OUTPUTS];
    const double *in[MOST_INPUTS];
    double *out[MOST_OUTPUTS];

    if (PyVectorcall_NARGS(flagged) != inputs || (names && PyTuple_GET_SIZE(names)))
        return PyErr_Format(PyExc_TypeError, "%s takes %d numbers, by position", self->kernel->name, inputs);
    for (int k = 0; k < inputs; ++k) {
        numbers[k] = PyFloat_AsDouble(args[k]);
        if (numbers[k] == -1.0 && PyErr_Occurred())
            return NULL;
        in[k] = &numbers[k];
    }
    for (int k = 0; k < outputs; ++k)
        out[k] = &results[k];
    self->run(1, self->constants, in, out);
    PyObject *found = PyTuple_New(outputs);
    for (int k = 0; found && k < outputs; ++k) {
        PyObject *number = PyFloat_FromDouble(results[k]);
        if (!number)
            Py_CLEAR(found);
        else
            PyTuple_SET_ITEM(found, k, number);
    }
    return found;
}

static PyObject *Function_new(PyTypeObject *type, PyObject *args, PyObject *keywords)
{
    static char *names[] = {"kernel", "level", "constants", NULL};
    PyObject *kernel_name, *level_name, *constants;

    if (!PyArg_ParseTupleAndKeywords(args, keywords, "UUO:Function", names, &kernel_name, &level_name, &constants))
        return NULL;
    const Kernel *kernel = kernel_named(kernel_name);
    const Level *level = kernel ? level_named(level_name) : NULL;
    if (!level)
        return NULL;
    Function *self = (Function *)PyType_GenericAlloc(type, 0);
    if (!self)
        return NULL;
    self->vectorcall = Function_vectorcall;
    self->run = level->runs[kernel - KERNELS];
    self->kernel = kernel;
    self->kernel_name = kernel->name;
    self->level_name = level->name;
    self->constants = copy_constants(kernel, constants);
    if (!self->constants)
        Py_CLEAR(self);
    return (PyObject *)self;
}

static void Function_dealloc(PyObject *object)
{
    PyTypeObject *type = Py_TYPE(object);
    PyMem_Free(((Function *)object)->constants);
    PyObject_Free(object);
    Py_DECREF(type);
}

PyDoc_STRVAR(Function_doc,
             "Function(kernel, level, constants)\n--\n\n"
             "A kernel as a function of one sample: ``function(*numbers)`` returns its outputs, the margin last.\n\n"
             "Parameters\n----------\n"
             "kernel : str\n    One of `kernels`.\n"
             "level : str\n    One of `levels`.\n"
             "constants : buffer of doubles\n    The numbers of the machine; copied.\n\n"
             "Raises\n------\n"
             "TypeError\n    If the constants are not a buffer of doubles.\n"
             "ValueError\n    If a name is unknown, or the constants do not fit.");

static PyMemberDef Function_members[] = {
    {"__vectorcalloffset__", Py_T_PYSSIZET, offsetof(Function, vectorcall), Py_READONLY, NULL},
    {"kernel", Py_T_STRING, offsetof(Function, kernel_name), Py_READONLY, "Name of the kernel."},
    {"level", Py_T_STRING, offsetof(Function, level_name), Py_READONLY, "Name of the level."},
    {NULL, 0, 0, 0, NULL},
};

static PyType_Slot Function_slots[] = {
    {Py_tp_doc, (void *)Function_doc},
    {Py_tp_new, (void *)Function_new},
    {Py_tp_call, (void *)PyVectorcall_Call},
    {Py_tp_members, Function_members},
    {Py_tp_dealloc, (void *)Function_dealloc},
    {0, NULL},
};

static PyType_Spec Function_spec = {
    .name = "p3dof._native._compiled.Function",
    .basicsize = sizeof(Function),
    .flags = Py_TPFLAGS_DEFAULT | Py_TPFLAGS_HAVE_VECTORCALL | Py_TPFLAGS_IMMUTABLETYPE,
    .slots = Function_slots,
};

/* The generated batch kernels as a Python extension: `Call` runs a kernel on columns of doubles, `Function` on numbers,
 * `Sample` on small arrays; `MachineRun` runs a machine in time over them.
 *
 * Every kernel is compiled for several levels of the instruction set; the CPU decides at run time which of them
 * there are. Nothing here knows what a kernel computes. The module has no state but its constants.
 */
#include "../_base/stable_abi.h"

#include "levels.h"

#include "level_table.h"

#include "call.h"

#include "function.h"

#include "many_call.h"

#include "sample.h"

#include "designs.h"

#include "runs.h"

/* The module */

#ifndef P3DOF_SOURCES
#define P3DOF_SOURCES 0 /* not known: see sources.py */
#endif

static int add(PyObject *module, const char *name, PyObject *value)
{
    const int result = value ? PyModule_AddObjectRef(module, name, value) : -1;
    Py_XDECREF(value);
    return result;
}

static PyObject *names_of_levels(void)
{
    const int count = runnable_levels();
    PyObject *names = PyTuple_New(count);
    for (int k = 0; names && k < count; ++k) {
        PyObject *name = PyUnicode_FromString(LEVELS[k]->name);
        if (!name)
            Py_CLEAR(names);
        else
            PyTuple_SET_ITEM(names, k, name);
    }
    return names;
}

static PyObject *counts_of_kernels(void)
{
    PyObject *counts = PyDict_New(), *proxy;
    for (int k = 0; counts && k < KERNEL_COUNT; ++k) {
        PyObject *row = Py_BuildValue("(iii)", KERNELS[k].constants, KERNELS[k].inputs, KERNELS[k].outputs);
        if (!row || PyDict_SetItemString(counts, KERNELS[k].name, row) < 0)
            Py_CLEAR(counts);
        Py_XDECREF(row);
    }
    proxy = counts ? PyDictProxy_New(counts) : NULL;
    Py_XDECREF(counts);
    return proxy;
}

static PyMethodDef module_methods[] = {
    {"run_many", (PyCFunction)(void (*)(void))run_many, METH_FASTCALL, run_many_doc},
    {NULL, NULL, 0, NULL},
};

static int fill_module(PyObject *module)
{
    if (add(module, "Call", PyType_FromModuleAndSpec(module, &Call_spec, NULL)) < 0 ||
        add(module, "Function", PyType_FromModuleAndSpec(module, &Function_spec, NULL)) < 0 ||
        add(module, "Sample", PyType_FromModuleAndSpec(module, &Sample_spec, NULL)) < 0 ||
        add(module, "DesignLoop", PyType_FromModuleAndSpec(module, &DesignLoop_spec, NULL)) < 0 ||
        add(module, "MachineRun", PyType_FromModuleAndSpec(module, &Run_spec, NULL)) < 0 ||
        add(module, "levels", names_of_levels()) < 0 || add(module, "kernels", counts_of_kernels()) < 0 ||
        add(module, "sources", PyLong_FromLongLong(P3DOF_SOURCES)) < 0)
        return -1;
    return 0;
}

static PyModuleDef_Slot module_slots[] = {
    {Py_mod_exec, (void *)fill_module},
    IN_EVERY_INTERPRETER WITHOUT_GIL
    {0, NULL},
};

PyDoc_STRVAR(module_doc, "The batch kernels, compiled.\n\n"
                         "levels : names of the instruction sets that this CPU can run, lowest first.\n"
                         "kernels : name of a kernel to its number of constants, of inputs and of outputs, margin "
                         "included.\n"
                         "sources : fingerprint of what it was compiled from; 0 if not known.");

static struct PyModuleDef module_definition = {
    PyModuleDef_HEAD_INIT,
    .m_name = "_compiled",
    .m_doc = module_doc,
    .m_size = 0,
    .m_methods = module_methods,
    .m_slots = module_slots,
};

PyMODINIT_FUNC PyInit__compiled(void)
{
    return PyModuleDef_Init(&module_definition);
}

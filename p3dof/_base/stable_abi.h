/* Python's API for the extensions, once for all Pythons.
 *
 * From Python 3.12 on they keep to the stable ABI (setup.py defines Py_LIMITED_API), so that one wheel serves every later
 * Python. It has functions for what is macros elsewhere; these stand below under the names of the macros.
 */
#define PY_SSIZE_T_CLEAN
#include <Python.h>

#if PY_VERSION_HEX < 0x030C0000
#include <structmember.h>
#define Py_T_INT T_INT
#define Py_T_DOUBLE T_DOUBLE
#define Py_T_STRING T_STRING
#define Py_T_LONGLONG T_LONGLONG
#define Py_T_PYSSIZET T_PYSSIZET
#define Py_READONLY READONLY
#endif

#ifdef Py_LIMITED_API
#define PyTuple_GET_SIZE PyTuple_Size
#define PyTuple_GET_ITEM PyTuple_GetItem
#define PyTuple_SET_ITEM PyTuple_SetItem
#define PyList_GET_SIZE PyList_Size
#define PyList_GET_ITEM PyList_GetItem
#define PyFloat_AS_DOUBLE PyFloat_AsDouble
#define PyObject_CallOneArg(called, given) PyObject_CallFunctionObjArgs(called, given, NULL)
#endif

#if defined(Py_mod_gil) && !defined(Py_LIMITED_API) /* no GIL: never with the stable ABI of 3.12 */
#define WITHOUT_GIL {Py_mod_gil, Py_MOD_GIL_NOT_USED},
#else
#define WITHOUT_GIL
#endif
#if PY_VERSION_HEX >= 0x030C0000
#define IN_EVERY_INTERPRETER {Py_mod_multiple_interpreters, Py_MOD_PER_INTERPRETER_GIL_SUPPORTED},
#else
#define IN_EVERY_INTERPRETER
#endif

/* The name of an object's type, a new reference; NULL with an error. */
static inline PyObject *name_of_type(PyObject *object)
{
    return PyObject_GetAttrString((PyObject *)Py_TYPE(object), "__name__");
}

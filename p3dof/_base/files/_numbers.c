/* Numbers of tables as text and back, exactly: the shortest digits that tell a double from its neighbours, written as
 * Python's repr writes them, and the nearest double to any digits.
 *
 * Writing is Schubfach (R. Giulietti, "The Schubfach way to render doubles", 2020). Reading multiplies the digits by a
 * power of ten of 128 bits; where the product is too near the middle between two doubles to tell, and for what is rare,
 * Python's own reader decides. Both take the powers of ten from Python, which has integers of any length.
 */
#include "../stable_abi.h"

#include <stdint.h>
#include <string.h>

enum { LEAST_POWER = -342, MOST_POWER = 324, POWERS = MOST_POWER - LEAST_POWER + 1, LONGEST = 26 };

typedef struct {
    uint64_t high, low;
} Wide;

static inline Wide product(uint64_t a, uint64_t b)
{
#ifdef __SIZEOF_INT128__
    const unsigned __int128 found = (unsigned __int128)a * b;
    return (Wide){(uint64_t)(found >> 64), (uint64_t)found};
#else
    const uint64_t a0 = (uint32_t)a, a1 = a >> 32, b0 = (uint32_t)b, b1 = b >> 32;
    const uint64_t low = a0 * b0, one = a1 * b0 + (low >> 32), two = a0 * b1 + (uint32_t)one;
    return (Wide){a1 * b1 + (one >> 32) + (two >> 32), (two << 32) | (uint32_t)low};
#endif
}

static inline int floor_log2_of_power(int k) { return (int)(((int64_t)k * 1741647) >> 19); } /* of 10^k, |k| < 1233 */

/* Writing */

static inline uint64_t rounded_to_odd(Wide power, uint64_t number)
{
    const uint64_t below = product(power.low, number).high;
    const Wide found = product(power.high, number);
    const uint64_t middle = found.low + below;
    return (found.high + (middle < below)) | (middle > 1);
}

/* Return the digits of a positive finite number, and by which power of ten they are to be multiplied. */
static uint64_t shortest(uint64_t bits, const Wide *powers, int *power)
{
    const uint64_t fraction = bits & 0xFFFFFFFFFFFFFu, biased = bits >> 52;
    const uint64_t c = biased ? fraction | (1ull << 52) : fraction;
    const int q = biased ? (int)biased - 1075 : -1074;
    if (biased && q <= 0 && q > -53 && !(c & ((1ull << -q) - 1))) {
        *power = 0;
        return c >> -q;
    }
    const uint64_t odd = c & 1, closer = !fraction && biased > 1;
    const int k = (int)(((int64_t)q * 1262611 - (closer ? 524031 : 0)) >> 22);
    const int shift = q + floor_log2_of_power(-k) + 1;
    const Wide g = powers[-k - LEAST_POWER];
    const uint64_t lower = rounded_to_odd(g, (4 * c - 2 + closer) << shift) + odd;
    const uint64_t middle = rounded_to_odd(g, (4 * c) << shift);
    const uint64_t upper = rounded_to_odd(g, (4 * c + 2) << shift) - odd;
    const uint64_t s = middle / 4, tens = s / 10;
    const uint64_t ten_down = lower <= 40 * tens, ten_up = 40 * tens + 40 <= upper;
    const uint64_t down = lower <= 4 * s, up = 4 * s + 4 <= upper;
    uint64_t found;
    *power = k;
    if (s >= 10 && ten_down != ten_up) {
        found = tens + ten_up;
        ++*power;
    } else if (down != up)
        found = s + up;
    else
        found = s + (middle > 4 * s + 2 || (middle == 4 * s + 2 && (s & 1)));
    for (; found % 10 == 0; ++*power)
        found /= 10;
    return found;
}

static inline int written_digits(uint64_t number, char *end)
{
    static const char pairs[] = "00010203040506070809101112131415161718192021222324252627282930313233343536373839404142434445"
                                "46474849505152535455565758596061626364656667686970717273747576777879808182838485868788899091"
                                "9293949596979899";
    char *at = end;
    for (; number >= 100; number /= 100)
        memcpy(at -= 2, pairs + 2 * (number % 100), 2);
    if (number >= 10)
        memcpy(at -= 2, pairs + 2 * number, 2);
    else
        *--at = (char)('0' + number);
    return (int)(end - at);
}

/* Write a number as repr does, without ".0" if that is not wanted; return where it ends. */
static char *write_number(char *at, double number, const Wide *powers, int point)
{
    uint64_t bits;
    memcpy(&bits, &number, sizeof bits);
    if (number != number)
        return (char *)memcpy(at, "nan", 3) + 3;
    if (bits >> 63)
        *at++ = '-';
    bits &= ~(1ull << 63);
    if (bits == 0x7FF0000000000000u)
        return (char *)memcpy(at, "inf", 3) + 3;
    char room[24], *const end = room + sizeof room;
    int power = 0;
    const uint64_t digits = bits ? shortest(bits, powers, &power) : 0;
    const int count = written_digits(digits, end), before = count + power; /* digits before the point */
    const char *const first = end - count;
    if (before > 16 || before < -3) {
        *at++ = *first;
        if (count > 1) {
            *at++ = '.';
            memcpy(at, first + 1, (size_t)count - 1);
            at += count - 1;
        }
        const int exponent = before - 1, size = exponent < 0 ? -exponent : exponent;
        *at++ = 'e';
        *at++ = exponent < 0 ? '-' : '+';
        if (size < 10)
            *at++ = '0';
        const int length = written_digits((uint64_t)size, end);
        return (char *)memcpy(at, end - length, (size_t)length) + length;
    }
    if (before <= 0) {
        memcpy(at, "0.000", 5);
        at += 2 - before;
        return (char *)memcpy(at, first, (size_t)count) + count;
    }
    if (before < count) {
        memcpy(at, first, (size_t)before);
        at[before] = '.';
        memcpy(at + before + 1, first + before, (size_t)(count - before));
        return at + count + 1;
    }
    memcpy(at, first, (size_t)count);
    memset(at + count, '0', (size_t)(before - count));
    at += before;
    if (point) {
        *at++ = '.';
        *at++ = '0';
    }
    return at;
}

/* A column: doubles with a stride, or a list of texts. */
typedef struct {
    Py_buffer view;
    PyObject *texts;
} Column;

static int take_column(Column *column, PyObject *given, Py_ssize_t *rows, Py_ssize_t *room)
{
    Py_ssize_t count;
    if (PyList_Check(given)) {
        column->texts = given;
        count = PyList_GET_SIZE(given);
        for (Py_ssize_t k = 0; k < count; ++k) {
            Py_ssize_t length;
            if (!PyUnicode_AsUTF8AndSize(PyList_GET_ITEM(given, k), &length))
                return -1;
            *room += length + 1;
        }
    } else {
        if (PyObject_GetBuffer(given, &column->view, PyBUF_STRIDED_RO | PyBUF_FORMAT) < 0)
            return -1;
        if (column->view.ndim != 1 || strcmp(column->view.format, "d")) {
            PyErr_SetString(PyExc_ValueError, "expected columns of doubles, or lists of texts");
            return -1;
        }
        count = column->view.shape[0];
        *room += LONGEST * count;
    }
    if (*rows >= 0 && *rows != count) {
        PyErr_SetString(PyExc_ValueError, "expected columns of one length");
        return -1;
    }
    *rows = count;
    return 0;
}

static PyObject *written(const Column *columns, Py_ssize_t count, Py_ssize_t rows, Py_ssize_t room, const Wide *powers,
                         int point)
{
    char *const begin = PyMem_Malloc((size_t)room + 1), *at = begin;
    if (!begin)
        return PyErr_NoMemory();
    for (Py_ssize_t row = 0; row < rows; ++row) {
        for (Py_ssize_t k = 0; k < count; ++k) {
            if (columns[k].texts) {
                Py_ssize_t length;
                const char *text = PyUnicode_AsUTF8AndSize(PyList_GET_ITEM(columns[k].texts, row), &length);
                memcpy(at, text, (size_t)length); /* it was read before */
                at += length;
            } else {
                double number;
                memcpy(&number, (const char *)columns[k].view.buf + row * columns[k].view.strides[0], sizeof number);
                at = write_number(at, number, powers, point);
            }
            *at++ = k + 1 < count ? ',' : '\n';
        }
    }
    PyObject *found = PyBytes_FromStringAndSize(begin, at - begin);
    PyMem_Free(begin);
    return found;
}

static const Wide *powers_of(Py_buffer *view, PyObject *given)
{
    if (PyObject_GetBuffer(given, view, PyBUF_SIMPLE) < 0)
        return NULL;
    if (view->len != (Py_ssize_t)(POWERS * sizeof(Wide))) {
        PyErr_SetString(PyExc_ValueError, "expected the powers of ten");
        return NULL;
    }
    return (const Wide *)view->buf;
}

PyDoc_STRVAR(rows_doc, "rows(powers, columns, point)\n--\n\nReturn the lines of a table: columns of doubles, or lists of "
                       "texts; whole numbers with a point if wanted.");

static PyObject *rows(PyObject *Py_UNUSED(module), PyObject *arguments)
{
    PyObject *given, *powers, *result = NULL;
    int point;
    if (!PyArg_ParseTuple(arguments, "OO!p", &powers, &PyTuple_Type, &given, &point))
        return NULL;
    const Py_ssize_t count = PyTuple_GET_SIZE(given);
    Py_buffer view = {0};
    Column *columns = PyMem_Calloc((size_t)count + 1, sizeof *columns);
    if (!columns)
        return PyErr_NoMemory();
    const Wide *known = powers_of(&view, powers);
    Py_ssize_t lines = -1, room = 0, k = 0;
    while (known && k < count && take_column(&columns[k], PyTuple_GET_ITEM(given, k), &lines, &room) == 0)
        ++k;
    if (known && k == count)
        result = written(columns, count, count ? lines : 0, room, known, point);
    for (k = 0; k < count; ++k)
        PyBuffer_Release(&columns[k].view);
    PyBuffer_Release(&view);
    PyMem_Free(columns);
    return result;
}

/* Reading */

/* Return a number times a power of ten; -1 where this cannot tell which double is nearest. */
static double scaled(uint64_t digits, int power, const Wide *powers)
{
    if (!digits)
        return 0;
    if (power < LEAST_POWER || power > MOST_POWER)
        return -1;
    int zeros = 0; /* in front of the digits */
    for (int step = 32; step; step >>= 1)
        if (!(digits << zeros >> (64 - step)))
            zeros += step;
    const Wide g = powers[power - LEAST_POWER]; /* at most one more than the power itself, in its last place */
    const uint64_t w = digits << zeros;
    const Wide upper = product(w, g.high);
    uint64_t middle = upper.low + product(w, g.low).high, high = upper.high + (middle < upper.low);
    int exponent = floor_log2_of_power(power) + 64 - zeros; /* of the number: high / 2^63 * 2^exponent */
    if (!(high >> 63)) {
        high = high << 1 | middle >> 63;
        middle <<= 1;
        --exponent;
    }
    const uint64_t rest = high & 0x7FF; /* half of it is 0x400, then nothing in the middle */
    if ((rest == 0x400 && middle < 8) || (rest == 0x3FF && middle > UINT64_MAX - 8))
        return -1;
    uint64_t found = (high >> 11) + (rest >= 0x400);
    if (found >> 53) {
        found >>= 1;
        ++exponent;
    }
    const int biased = exponent + 1023;
    if (biased < 1 || biased > 2046)
        return -1;
    const uint64_t bits = (found & 0xFFFFFFFFFFFFFu) | (uint64_t)biased << 52;
    double number;
    memcpy(&number, &bits, sizeof number);
    return number;
}

static inline int is_digit(char c) { return (unsigned char)(c - '0') < 10; }

/* Read a number; return where it ends, or NULL if there is none. The text ends in a null character. */
static const char *read_number(const char *at, const Wide *powers, double *number)
{
    const char *const first = at;
    const int negative = *at == '-';
    at += *at == '-' || *at == '+';
    const char *const begin = at;
    uint64_t digits = 0;
    int power = 0;
    for (; is_digit(*at); ++at)
        digits = 10 * digits + (uint64_t)(*at - '0');
    Py_ssize_t count = at - begin;
    if (*at == '.') {
        const char *const point = ++at;
        for (; is_digit(*at); ++at)
            digits = 10 * digits + (uint64_t)(*at - '0');
        count += at - point;
        if (count > 400)
            return NULL;
        power = -(int)(at - point);
    }
    if (!count || count > 400)
        return NULL;
    if (*at == 'e' || *at == 'E') {
        const int minus = at[1] == '-';
        at += 1 + (at[1] == '-' || at[1] == '+');
        const char *const exponent = at;
        int size = 0;
        for (; is_digit(*at) && at - exponent < 5; ++at)
            size = 10 * size + (*at - '0');
        if (at == exponent || is_digit(*at))
            return NULL;
        power += minus ? -size : size;
    }
    if (count > 19)
        for (const char *zero = begin; *zero == '0' || *zero == '.'; ++zero)
            count -= *zero == '0';
    *number = count > 19 ? -1 : scaled(digits, power, powers);
    if (*number < 0) {
        char *end;
        *number = PyOS_string_to_double(first, &end, NULL);
        if (PyErr_Occurred() || end != at) {
            PyErr_Clear();
            return NULL;
        }
    } else if (negative)
        *number = -*number;
    return at;
}

static inline const char *past_blanks(const char *at)
{
    while (*at == ' ' || *at == '\t')
        ++at;
    return at;
}

/* Read lines of numbers; return how many, or -1 if there is anything that is none of them. */
static Py_ssize_t read_lines(const char *at, const char *end, Py_ssize_t longest, Py_ssize_t count, double *into,
                             Py_ssize_t room, const Wide *powers)
{
    Py_ssize_t found = 0;
    while (at < end) {
        const char *const start = at;
        at = past_blanks(at);
        if (*at == '#') {
            const char *next = memchr(at, '\n', (size_t)(end - at));
            at = next ? next : end;
        } else if (*at != '\n' && at != end) {
            if (found == room)
                return -1;
            for (Py_ssize_t k = 0; k < count; ++k) {
                at = read_number(past_blanks(at), powers, into++);
                if (!at)
                    return -1;
                at = past_blanks(at);
                if (k + 1 < count && *at++ != ',')
                    return -1;
            }
            ++found;
        }
        if ((at != end && *at != '\n') || at - start > longest)
            return -1;
        ++at;
    }
    return found;
}

PyDoc_STRVAR(numbers_doc, "numbers(powers, text, start, longest, columns, into)\n--\n\nRead the numbers of a table's "
                          "lines into doubles; return how many lines they are of, or -1 for any other text.");

static PyObject *numbers(PyObject *Py_UNUSED(module), PyObject *arguments)
{
    PyObject *powers, *text, *into;
    Py_ssize_t start, longest, count, length, found = -1;
    if (!PyArg_ParseTuple(arguments, "OUnnnO", &powers, &text, &start, &longest, &count, &into))
        return NULL;
    const char *begin = PyUnicode_AsUTF8AndSize(text, &length);
    if (!begin)
        return NULL;
    Py_buffer table = {0}, room = {0};
    const Wide *known = powers_of(&table, powers);
    if (known && PyObject_GetBuffer(into, &room, PyBUF_CONTIG) == 0) {
        if (count < 1 || start < 0 || start > length || room.itemsize != sizeof(double))
            PyErr_SetString(PyExc_ValueError, "expected columns, a start within the text, and doubles");
        else
            found = read_lines(begin + start, begin + length, longest, count, room.buf,
                               room.len / (Py_ssize_t)sizeof(double) / count, known);
    }
    PyBuffer_Release(&room);
    PyBuffer_Release(&table);
    return PyErr_Occurred() ? NULL : PyLong_FromSsize_t(found);
}

/* The module */

static PyMethodDef methods[] = {
    {"rows", rows, METH_VARARGS, rows_doc},
    {"numbers", numbers, METH_VARARGS, numbers_doc},
    {NULL, NULL, 0, NULL},
};

static PyModuleDef_Slot slots[] = {
    IN_EVERY_INTERPRETER WITHOUT_GIL
    {0, NULL},
};

static struct PyModuleDef definition = {
    PyModuleDef_HEAD_INIT,
    .m_name = "_numbers",
    .m_doc = "Numbers of tables as text and back, exactly.",
    .m_methods = methods,
    .m_slots = slots,
};

PyMODINIT_FUNC PyInit__numbers(void) { return PyModuleDef_Init(&definition); }

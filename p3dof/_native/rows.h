/* How kernels take any number of samples: in whole rows of P3DOF_ROW, as many as a register holds, so that the compiler
 * makes no code for a rest.
 *
 * Included once per level before generated/batch_kernels.h, with P3DOF_ROW, P3DOF_NAME and P3DOF_TARGET defined.
 */

#include "generated/kernel_table.h"

#define P3DOF_WHOLE(n) ((n) & ~(ptrdiff_t)(P3DOF_ROW - 1))

/* Run a kernel on any number of samples by its function for whole rows. What is left over is the end of one more row, of
 * samples that are done already; fewer than a row fill one with the last of them; a single one goes alone. How a sample
 * is rounded depends on the rest of the number of samples alone: not on how many rows there are. */
static P3DOF_TARGET void P3DOF_NAME(in_rows)(ptrdiff_t n, const double *restrict c, const double *const *in,
                                             double *const *out, int inputs, int outputs,
                                             void (*rows)(ptrdiff_t, const double *, const double *const *,
                                                          double *const *),
                                             void (*alone)(ptrdiff_t, const double *, const double *const *,
                                                           double *const *))
{
    const ptrdiff_t left = n % P3DOF_ROW;
    const int single = left == 1 && alone != rows, filled = n < P3DOF_ROW && !single;
    const ptrdiff_t start = filled ? 0 : n - (single ? 1 : P3DOF_ROW);
    P3DOF_ALIGNED double room[MOST_COLUMNS][P3DOF_ROW];
    const double *from[MOST_INPUTS];
    double *to[MOST_OUTPUTS];

    if (n >= P3DOF_ROW)
        rows(n, c, in, out);
    if (!left)
        return;
    for (int k = 0; k < inputs; ++k) {
        for (int l = 0; filled && l < P3DOF_ROW; ++l)
            room[k][l] = in[k][l < n ? l : n - 1];
        from[k] = filled ? room[k] : in[k] + start;
    }
    for (int k = 0; k < outputs; ++k)
        to[k] = filled ? room[inputs + k] : out[k] + start;
    (single ? alone : rows)(single ? 1 : P3DOF_ROW, c, from, to);
    for (int k = 0; k < outputs && filled; ++k)
        for (int l = 0; l < n; ++l)
            out[k][l] = to[k][l];
}

/* The levels of the instruction set: what the file of each level, `level_*.c`, gives to `_compiled.c`. No Python here. */

#include <float.h>
#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#if defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__)
#error "sine, cosine and the margins need the rounding and the NaN of IEEE 754: no -ffast-math"
#endif
#if FLT_EVAL_METHOD < 0 || FLT_EVAL_METHOD == 2
#error "sine and cosine need arithmetic that rounds to double (on 32-bit x86: -msse2 -mfpmath=sse)"
#endif

#if defined(__GNUC__)
#define P3DOF_INLINE inline __attribute__((always_inline))
#define P3DOF_SIMD _Pragma("omp simd")
#define P3DOF_SIMD_ANY(flags) P3DOF_DO(omp simd reduction(| : flags))
#define P3DOF_DO(words) _Pragma(#words)
#else
#define P3DOF_INLINE inline
#define P3DOF_SIMD
#define P3DOF_SIMD_ANY(flags)
#endif
#if defined(_MSC_VER) && !defined(__clang__)
#define restrict __restrict
#define P3DOF_ALIGNED __declspec(align(64))
#elif defined(__GNUC__)
#define P3DOF_ALIGNED __attribute__((aligned(64)))
#else
#define P3DOF_ALIGNED
#endif

#include "design_motion.h"
#include "generated/kernel_table.h"

enum {
    CACHE_LINE = 8, /* doubles */
    /* Samples through scratch at a time, and between the two loops of a kernel: all their columns fit into the first
     * level of the cache, and the bursts that go to and from memory are short enough to overlap with the arithmetic. */
    BLOCK = 80,
    /* Doubles from a column of scratch to the next: an odd number of cache lines, so that the columns do not compete
     * for the same places in the cache. */
    LINE = BLOCK + CACHE_LINE,
};

#include "machine.h"

#define P3DOF_LANE(f) f##_of_one
#define P3DOF_LANES 1
#include "control_state.h"
#undef P3DOF_LANE
#undef P3DOF_LANES
typedef Control_of_one OneControl;

#include "many_batch.h"

/* Levels above the baseline. P3DOF_NO_AVX2 and P3DOF_NO_AVX512 leave one out: see setup.py. On 64-bit Windows gcc keeps
 * vectors of 32 bytes at addresses that are multiples of 16 (its bug 54412). */
#if defined(__GNUC__) && defined(__x86_64__) && !(defined(_WIN32) && !defined(__clang__))
#if !defined(P3DOF_NO_AVX2)
#define P3DOF_HAS_AVX2
#endif
#if !defined(P3DOF_NO_AVX512)
#define P3DOF_HAS_AVX512
#endif
#endif

/* The kernels of a run in one lane, and what lets a controller act. */
enum { MOTIONS = 4 };
typedef struct {
    Motion *motions[MOTIONS];
    Lane *place, *watch;
    void (*act)(MachineRun *, const double *);
    void (*follow)(MachineRun *, double, const double *, double *);
} RunKernels;

/* Many runs, in one lane and in many. */
enum { MANY_WIDE = 32 };
typedef void Many(const Batch *, void *, ptrdiff_t, ptrdiff_t);
typedef struct {
    Many *single, *wide;
    size_t single_size, wide_size;
    ptrdiff_t row; /* numbers of a row of inputs */
} ManyKernels;

typedef struct {
    const char *name;
    Run *const *runs; /* in the order of `KERNELS` */
    int (*all_positive)(ptrdiff_t, const double *);
    void (*gather)(ptrdiff_t, const double *, ptrdiff_t, double *restrict);
    void (*scatter)(ptrdiff_t, const double *restrict, double *, ptrdiff_t);
    void (*gather_three)(ptrdiff_t, const double *restrict, double *restrict, ptrdiff_t);
    void (*scatter_three)(ptrdiff_t, const double *restrict, ptrdiff_t, double *restrict);
    void (*scatter_rows)(ptrdiff_t, const double *restrict, ptrdiff_t, int, double *restrict, ptrdiff_t);
    const DesignReductions *reductions;
    int (*advance)(MachineRun *);
    void (*place_sliders)(const MachineRun *, const double *, double *);
    RunKernels run;
    ManyKernels many;
} Level;

#if defined(__GNUC__) && !defined(_WIN32)
#define P3DOF_HIDDEN __attribute__((visibility("hidden")))
#else
#define P3DOF_HIDDEN
#endif
extern P3DOF_HIDDEN const Level p3dof_baseline;
#if defined(P3DOF_HAS_AVX2)
extern P3DOF_HIDDEN const Level p3dof_avx2;
#endif
#if defined(P3DOF_HAS_AVX512)
extern P3DOF_HIDDEN const Level p3dof_avx512;
#endif

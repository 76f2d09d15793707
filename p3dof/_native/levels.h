/* The levels of the instruction set: the same kernels compiled for each, and what this CPU has of them. */

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

/* The levels: the same code compiled again for each. */

#define P3DOF_NAME(f) f##_baseline
#define P3DOF_TARGET
#include "vector_math.h"
#include "generated/batch_kernels.h"
#include "design_figures.h"
#include "machine_run.h"
#undef P3DOF_NAME
#undef P3DOF_TARGET

/* On 64-bit Windows gcc keeps vectors of 32 bytes at addresses that are multiples of 16 (its bug 54412). */
#if defined(__GNUC__) && defined(__x86_64__) && !(defined(_WIN32) && !defined(__clang__))
#define P3DOF_X86_LEVELS

#define P3DOF_NAME(f) f##_avx2
#define P3DOF_TARGET __attribute__((target("avx2,fma")))
#include "vector_math.h"
#include "generated/batch_kernels.h"
#include "design_figures.h"
#include "machine_run.h"
#undef P3DOF_NAME
#undef P3DOF_TARGET

#define P3DOF_NEWTON
#define P3DOF_NAME(f) f##_avx512
#if defined(__clang__) /* takes the full width as it is */
#define P3DOF_TARGET __attribute__((target("avx512f,avx512dq,avx512vl,avx2,fma")))
#else
#define P3DOF_TARGET __attribute__((target("avx512f,avx512dq,avx512vl,avx2,fma,prefer-vector-width=512")))
#endif
#include "vector_math.h"
#include "generated/batch_kernels.h"
#include "design_figures.h"
#include "machine_run.h"
#undef P3DOF_NAME
#undef P3DOF_NEWTON
#undef P3DOF_TARGET
#endif

typedef struct {
    const char *name;
    int constants, inputs, outputs;
} Kernel;

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
} Level;

#define ROW(name, constants, inputs, outputs) {#name, constants, inputs, outputs},
static const Kernel KERNELS[] = {P3DOF_KERNELS(ROW)};
#define KERNEL_COUNT ((int)(sizeof KERNELS / sizeof KERNELS[0]))

#define LEVEL(level)                                                                                          \
    {                                                                                                         \
        #level, RUNS_##level, all_positive_##level, gather_##level, scatter_##level, gather_three_##level, \
            scatter_three_##level, scatter_rows_##level, &REDUCTIONS_##level, advance_##level,                \
            place_sliders_##level                                                                             \
    }
#define OF_BASELINE(name, constants, inputs, outputs) name##_baseline,
static Run *const RUNS_baseline[] = {P3DOF_KERNELS(OF_BASELINE)};
#if defined(P3DOF_X86_LEVELS)
#define OF_AVX2(name, constants, inputs, outputs) name##_avx2,
#define OF_AVX512(name, constants, inputs, outputs) name##_avx512,
static Run *const RUNS_avx2[] = {P3DOF_KERNELS(OF_AVX2)};
static Run *const RUNS_avx512[] = {P3DOF_KERNELS(OF_AVX512)};
static const Level LEVELS[] = {LEVEL(baseline), LEVEL(avx2), LEVEL(avx512)};
#else
static const Level LEVELS[] = {LEVEL(baseline)};
#endif

/* How many of `LEVELS` this CPU and its operating system can run; each includes those below it. */
static int runnable_levels(void)
{
#if defined(P3DOF_X86_LEVELS)
    __builtin_cpu_init();
    if (!__builtin_cpu_supports("avx2") || !__builtin_cpu_supports("fma"))
        return 1;
    if (!__builtin_cpu_supports("avx512f") || !__builtin_cpu_supports("avx512dq") ||
        !__builtin_cpu_supports("avx512vl"))
        return 2;
    return 3;
#else
    return 1;
#endif
}

/* The size of a union is that of its largest member. */
#define INPUTS(name, constants, inputs, outputs) char name[inputs];
#define OUTPUTS(name, constants, inputs, outputs) char name[outputs];
union InputsOfAny {
    P3DOF_KERNELS(INPUTS)
};
union OutputsOfAny {
    P3DOF_KERNELS(OUTPUTS)
};
enum {
    MOST_INPUTS = sizeof(union InputsOfAny),
    MOST_OUTPUTS = sizeof(union OutputsOfAny),
    MOST_COLUMNS = MOST_INPUTS + MOST_OUTPUTS,
    IN_PLACE_BLOCK = 1024, /* samples without scratch at a time: their margins are still in the cache */
    RELEASE_GIL = 2000,    /* samples */
};

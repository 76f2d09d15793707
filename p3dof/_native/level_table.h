/* The kernels by name, the levels that are there, and which of them this CPU can run. */

typedef struct {
    const char *name;
    int constants, inputs, outputs;
} Kernel;

#define ROW(name, constants, inputs, outputs) {#name, constants, inputs, outputs},
static const Kernel KERNELS[] = {P3DOF_KERNELS(ROW)};
#define KERNEL_COUNT ((int)(sizeof KERNELS / sizeof KERNELS[0]))

static const Level *const LEVELS[] = {
    &p3dof_baseline,
#if defined(P3DOF_HAS_AVX2)
    &p3dof_avx2,
#endif
#if defined(P3DOF_HAS_AVX512)
    &p3dof_avx512,
#endif
};

/* How many of `LEVELS` this CPU and its operating system can run; each needs less than those above it. */
static int runnable_levels(void)
{
    int count = 1;
#if defined(P3DOF_HAS_AVX2) || defined(P3DOF_HAS_AVX512)
    __builtin_cpu_init();
    const int avx2 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
#endif
#if defined(P3DOF_HAS_AVX2)
    count += avx2;
#endif
#if defined(P3DOF_HAS_AVX512)
    count += avx2 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
             __builtin_cpu_supports("avx512vl");
#endif
    return count;
}

enum {
    IN_PLACE_BLOCK = 1024, /* samples without scratch at a time: their margins are still in the cache */
    RELEASE_GIL = 2000,    /* samples */
};

/* Everything with AVX2 and fused multiply-add. */
#include "levels.h"

#if defined(P3DOF_HAS_AVX2)
#define P3DOF_LEVEL "avx2"
#define P3DOF_NAME(f) f##_avx2
#define P3DOF_TARGET __attribute__((target("avx2,fma")))
#define P3DOF_ROW 4
#include "level.h"
#endif

/* Everything with AVX-512. */
#include "levels.h"

#if defined(P3DOF_HAS_AVX512)
#define P3DOF_LEVEL "avx512"
#define P3DOF_NAME(f) f##_avx512
#define P3DOF_NEWTON
#if defined(__clang__) /* takes the full width as it is */
#define P3DOF_TARGET __attribute__((target("avx512f,avx512dq,avx512vl,avx2,fma")))
#else
#define P3DOF_TARGET __attribute__((target("avx512f,avx512dq,avx512vl,avx2,fma,prefer-vector-width=512")))
#endif
#define P3DOF_ROW 8
#include "level.h"
#endif

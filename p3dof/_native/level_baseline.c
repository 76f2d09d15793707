/* Everything at the level that every processor of the architecture has. */
#include "levels.h"

#define P3DOF_LEVEL "baseline"
#define P3DOF_NAME(f) f##_baseline
#define P3DOF_TARGET
#define P3DOF_ROW 2
#include "level.h"

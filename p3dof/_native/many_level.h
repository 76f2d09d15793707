/* The engine of many.h at one level: in one lane, and in many. */

#define P3DOF_LANE(f) P3DOF_NAME(f##_single)
#define P3DOF_LANES 1
#include "generated/lane_kernels.h"
#include "control.h"
#include "many.h"
#undef P3DOF_LANE
#undef P3DOF_LANES

#define P3DOF_LANE(f) P3DOF_NAME(f##_wide)
#define P3DOF_LANES MANY_WIDE
#include "generated/lane_kernels.h"
#include "control.h"
#include "many.h"
#undef P3DOF_LANE
#undef P3DOF_LANES

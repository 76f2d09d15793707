/* All that is compiled again for each level: kernels, figures of designs, runs of one machine and of many.
 *
 * Included by the file of each level, with P3DOF_LEVEL, P3DOF_ROW, P3DOF_NAME and P3DOF_TARGET defined.
 */

#include "vector_math.h"
#include "rows.h"
#include "generated/batch_kernels.h"
#include "design_figures.h"
#include "machine_run.h"
#include "many_level.h"
#include "run_level.h"

#define P3DOF_OF_LEVEL(name, constants, inputs, outputs) P3DOF_NAME(name),
static Run *const P3DOF_NAME(RUNS)[] = {P3DOF_KERNELS(P3DOF_OF_LEVEL)};

const Level P3DOF_NAME(p3dof) = {
    .name = P3DOF_LEVEL,
    .runs = P3DOF_NAME(RUNS),
    .all_positive = P3DOF_NAME(all_positive),
    .gather = P3DOF_NAME(gather),
    .scatter = P3DOF_NAME(scatter),
    .gather_three = P3DOF_NAME(gather_three),
    .scatter_three = P3DOF_NAME(scatter_three),
    .scatter_rows = P3DOF_NAME(scatter_rows),
    .reductions = &P3DOF_NAME(REDUCTIONS),
    .advance = P3DOF_NAME(advance),
    .place_sliders = P3DOF_NAME(place_sliders),
    .run =
        {
            .motions = {P3DOF_NAME(lane_motion_apart_single), P3DOF_NAME(lane_motion_symmetric_apart_single),
                        P3DOF_NAME(lane_motion_with_friction_apart_single),
                        P3DOF_NAME(lane_motion_with_friction_symmetric_apart_single)},
            .place = P3DOF_NAME(lane_place_single),
            .watch = P3DOF_NAME(lane_limits_single),
            .act = P3DOF_NAME(control_tick),
            .follow = P3DOF_NAME(control_follow),
        },
    .many =
        {
            .single = P3DOF_NAME(many_single),
            .wide = P3DOF_NAME(many_wide),
            .single_size = sizeof(P3DOF_NAME(Work_single)),
            .wide_size = sizeof(P3DOF_NAME(Work_wide)),
            .row = P3DOF_NAME(input_rows_single),
        },
};

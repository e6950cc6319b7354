/* SPDX-License-Identifier: Apache-2.0 */
#include "example.h"
#include "umbrage/cascades.h"

static float depth[SIDE * SIDE];

static int example(void)
{
    const double to_light[3] = {0, 1, 0};
    const struct umb_box scene = example_bounds();
    const struct umb_points points = example_points();
    const struct umb_camera camera = {.eye = {scene.min[0], scene.max[1], scene.min[2]},
                                      .forward = {1, -0.5, 1},
                                      .up = {0, 1, 0},
                                      .fov_y = 1,
                                      .aspect = 1,
                                      .near_m = 1,
                                      .far_m = 1000};
    const struct umb_cascade_settings settings = {
        .count = 2, .weight = 0.5, .resolution = {SIDE, SIDE}};
    const struct umb_map_settings map_settings = {.technique = UMB_MAP_PCF};
    const struct umb_map_filter filter = {.width = 3};
    const struct umb_map_layer layers[2] = {{.depth = depth}, {.depth = depth}};
    struct umb_map *maps[2] = {NULL, NULL};
    struct umb_map_query queries[2];
#include "cascades.1"
    EXPECT(plan.count == 2 && example_lit() > 0 && example_lit() < POINTS);
    umb_map_destroy(maps[0]);
    umb_map_destroy(maps[1]);
    return UMB_OK;
}

int main(void)
{
    for (int i = 0; i < SIDE * SIDE; i++) {
        depth[i] = i % 2 ? 0.25F : 1.0F;
    }
    return example_end((enum umb_status)example());
}

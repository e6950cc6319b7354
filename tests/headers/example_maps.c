/* SPDX-License-Identifier: Apache-2.0 */
#include "example.h"
#include "umbrage/maps.h"

static float depth[SIDE * SIDE];

/* A wall over the left half of the map, half way down. */
static void fill(void)
{
    for (int i = 0; i < SIDE * SIDE; i++) {
        depth[i] = i % SIDE < SIDE / 2 ? 0.5F : 1.0F;
    }
}

static int example(void)
{
    const double to_light[3] = {0, 1, 0};
    const struct umb_box box = example_bounds();
    const struct umb_points points = example_points();
    const struct umb_map_settings settings = {.technique = UMB_MAP_PCF};
    const struct umb_map_filter filter = {.width = 3};
    const struct umb_map_layer layer = {.depth = depth};
#include "maps.1"
    EXPECT(example_lit() > 0 && example_lit() < POINTS);
    return UMB_OK;
}

int main(void)
{
    fill();
    return example_end((enum umb_status)example());
}

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A forest: one closed tree, a trunk and a crown of 92 triangles, at N x N places of a grid of 7 m
 * that are moved by up to 2.5 m. GLB files have instances (EXT_mesh_gpu_instancing); other formats
 * repeat the tree's triangles.
 */
#include "gen.h"

enum {
    SPACING_MM = 7000,
    MOVED_MM = 2500,
    TRUNK_MM = 4000,
    CROWN_MM = 2400,
};

static void add_tree(struct gen_mesh *mesh, struct gen_rng *rng)
{
    struct gen_point2 bottom[6], top[6];
    for (uint32_t i = 0; i < 6; i++) {
        bottom[i] = gen_circle(0, 0, 260, i, 4);
        top[i] = gen_circle(0, 0, 170, i, 4);
    }
    const struct gen_frustum trunk = {bottom, top, 6, -300, TRUNK_MM};
    gen_prism(mesh, &trunk);
    const int32_t centre[3] = {0, 0, TRUNK_MM + CROWN_MM / 2};
    gen_ball(mesh, centre, CROWN_MM, 3, rng, 90);
}

void gen_forest(struct gen_mesh *mesh, int32_t size, uint64_t seed)
{
    struct gen_rng rng = {seed};
    add_tree(mesh, &rng);
    for (int32_t y = 0; y < size; y++) {
        for (int32_t x = 0; x < size; x++) {
            const int32_t east = gen_range(&rng, -MOVED_MM, MOVED_MM);
            const int32_t north = gen_range(&rng, -MOVED_MM, MOVED_MM);
            gen_place(mesh, (2 * x - size) * (SPACING_MM / 2) + east,
                      (2 * y - size) * (SPACING_MM / 2) + north, gen_range(&rng, -200, 200));
        }
    }
}

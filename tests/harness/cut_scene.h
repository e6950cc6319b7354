/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_HARNESS_CUT_SCENE_H
#define UMBRAGE_TESTS_HARNESS_CUT_SCENE_H
/*
 * A scene view of loose triangles with texture coordinates, and a texture of blobs, for tests of
 * cut-out materials. Material 0 is opaque, 1 is MASK with the texture, 2 MASK without one and below
 * its cut-off, 3 MASK without one and above it. Include after cmocka.h.
 */
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "scene/scene_alpha.h"

enum {
    CUT_SIDE = 40, /* texels */
    CUT_TRIANGLES_MAX = 400,
};

struct cut_scene {
    double positions[3 * CUT_TRIANGLES_MAX][3];
    float uvs[3 * CUT_TRIANGLES_MAX][2];
    uint32_t triangles[CUT_TRIANGLES_MAX][3];
    struct umbs_mesh meshes[CUT_TRIANGLES_MAX]; /* one a triangle */
    struct umbs_instance instances[CUT_TRIANGLES_MAX];
    struct umbs_material materials[4];
    struct umbs_texture texture;
    uint8_t alpha[CUT_SIDE * CUT_SIDE];
    struct umbs_scene_view view;
    uint64_t random_state;
};

/* splitmix64 */
static inline uint64_t cut_bits(struct cut_scene *s)
{
    uint64_t z = (s->random_state += 0x9e3779b97f4a7c15ULL);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
    return z ^ (z >> 31);
}

static inline double cut_unit(struct cut_scene *s)
{
    return (double)(cut_bits(s) >> 11) * 0x1p-53;
}

static inline void cut_scene_init(struct cut_scene *s, uint64_t seed)
{
    memset(s, 0, sizeof *s);
    s->random_state = seed;
    print_message("seed %llu\n", (unsigned long long)seed);
    /* Left quarter whole, right quarter empty, blobs between. */
    for (int y = 0; y < CUT_SIDE; y++) {
        for (int x = 0; x < CUT_SIDE; x++) {
            const int blob = (x / 5 + y / 5) % 2 == 0 ? 220 : 30;
            s->alpha[y * CUT_SIDE + x] = (uint8_t)(x < CUT_SIDE / 4        ? 255
                                                   : x >= CUT_SIDE * 3 / 4 ? 0
                                                                           : blob + (x * y) % 7);
        }
    }
    s->texture = (struct umbs_texture){.width = CUT_SIDE, .height = CUT_SIDE};
    for (int i = 0; i < 4; i++) {
        s->materials[i].texture = i == 1 ? 0 : UMBS_NO_INDEX;
        s->materials[i].alpha_mode = i == 0 ? UMBS_ALPHA_OPAQUE : UMBS_ALPHA_MASK;
        s->materials[i].alpha_cutoff = 0.5F;
        s->materials[i].base_alpha = i == 2 ? 0.25F : 1.0F;
    }
    s->view = (struct umbs_scene_view){
        .material_count = 4,
        .texture_count = 1,
        .meshes = s->meshes,
        .instances = s->instances,
        .materials = s->materials,
        .textures = &s->texture,
        .positions = (const double(*)[3])s->positions,
        .uvs = (const float(*)[2])s->uvs,
        .triangles = (const uint32_t(*)[3])s->triangles,
        .alpha = s->alpha,
        .alpha_bytes = sizeof s->alpha,
        .warnings = "",
    };
}

static inline void cut_scene_add(struct cut_scene *s, const double corners[3][3],
                                 const float uv[3][2], uint32_t material)
{
    const uint32_t n = s->view.mesh_count;
    assert_true(n < CUT_TRIANGLES_MAX);
    memcpy(s->positions[3 * n], corners, 9 * sizeof(double));
    memcpy(s->uvs[3 * n], uv, 6 * sizeof(float));
    for (uint32_t k = 0; k < 3; k++) {
        s->triangles[n][k] = k;
    }
    s->meshes[n] = (struct umbs_mesh){.first_vertex = 3 * n,
                                      .vertex_count = 3,
                                      .first_triangle = n,
                                      .triangle_count = 1,
                                      .material = material};
    s->instances[n].mesh = n;
    for (int k = 0; k < 3; k++) {
        s->instances[n].mesh_to_world[k][k] = 1.0;
    }
    s->view.mesh_count = s->view.instance_count = s->view.triangle_count = n + 1;
    s->view.vertex_count = 3 * (n + 1);
    s->view.world_triangle_count = n + 1;
}

/* Makes a random triangle in a cube of `size`, with texture coordinates around the image, and now
 * and then far outside it. */
static inline void cut_scene_add_random(struct cut_scene *s, double size, uint32_t material)
{
    double corners[3][3];
    float uv[3][2];
    const double at = cut_unit(s) * 1.5 - 0.25, wide = cut_bits(s) % 3 == 0 ? 3.0 : 0.4;
    for (int k = 0; k < 3; k++) {
        for (int axis = 0; axis < 3; axis++) {
            corners[k][axis] = 0.5 + cut_unit(s) * (size - 1.0);
        }
        uv[k][0] = (float)(at + wide * (cut_unit(s) - 0.5));
        uv[k][1] = (float)(cut_unit(s) * 2.0 - 0.5);
    }
    cut_scene_add(s, (const double(*)[3])corners, (const float(*)[2])uv, material);
}

/* Computes alpha by an independent definition: whole texels by stepping, weights in long double. */
static inline long double cut_slow_alpha(const struct cut_scene *s, double u, double v)
{
    const struct umbs_texture *t = &s->texture;
    const long double at[2] = {(long double)u * t->width, (long double)v * t->height};
    const uint32_t wraps[2] = {t->wrap_s, t->wrap_t}, sides[2] = {t->width, t->height};
    long first[2], texel[2][2];
    long double part[2], sum = 0.0L;
    for (int axis = 0; axis < 2; axis++) {
        const long double moved = t->nearest ? at[axis] : at[axis] - 0.5L;
        first[axis] = (long)moved;
        first[axis] -= (long double)first[axis] > moved;
        part[axis] = t->nearest ? 0.0L : moved - (long double)first[axis];
        for (int i = 0; i < 2; i++) {
            const long n = (long)sides[axis];
            long k = first[axis] + i;
            if (wraps[axis] == UMBS_WRAP_CLAMP) {
                k = k < 0 ? 0 : k >= n ? n - 1 : k;
            }
            long period = 0;
            while (k < 0 || k >= n) {
                k += k < 0 ? n : -n;
                period++;
            }
            texel[axis][i] = wraps[axis] == UMBS_WRAP_MIRROR && period % 2 != 0 ? n - 1 - k : k;
        }
    }
    for (int i = 0; i < 4; i++) {
        const long double wx = i % 2 != 0 ? part[0] : 1.0L - part[0];
        const long double wy = i / 2 != 0 ? part[1] : 1.0L - part[1];
        sum += wx * wy * s->alpha[texel[1][i / 2] * (long)t->width + texel[0][i % 2]];
    }
    return sum;
}

#endif

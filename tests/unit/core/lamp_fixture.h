/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_LAMP_FIXTURE_H
#define UMBRAGE_TESTS_LAMP_FIXTURE_H
/* An asset of one point light: six faces whose voxels are the exact shadow of a plane. */
#include <math.h>
#include <string.h>

#include "make_asset.h"
#include "umbrage/query.h"

enum {
    LOG2 = 7,
    SIZE = 1 << LOG2,
    FACES = 6
};

/* Ten texels of guard band, as bakes have them; W from 0.5 to 16 metres. */
static const double tangent = (double)SIZE / (SIZE - 20.0);
static const double near_w = 0.5, far_w = 16.0;
static const double origin[3] = {500000.25, -3, 8};
static const double eye[3] = {500001.5, -1.25, 9.5};

struct plane {
    double normal[3]; /* unit, away from the light */
    double distance;  /* Metres from the light */
};

/* Column i of face f: u, v or w. */
static inline void face_axes(uint32_t face, double axes[3][3])
{
    const uint32_t k = face / 2;
    memset(axes, 0, 9 * sizeof(double));
    axes[2][k] = face % 2 == 0 ? 1 : -1;
    axes[0][(k + 1) % 3] = 1;
    axes[1][(k + 2) % 3] = face % 2 == 0 ? 1 : -1;
}

/* Before the plane, by the voxel's centre. */
static inline int before_plane(const void *user, uint32_t face, uint32_t x, uint32_t y, uint32_t z)
{
    const struct plane *plane = user;
    double axes[3][3], along = 0;
    const double w = near_w + (z + 0.5) / SIZE * (far_w - near_w);
    const double u = ((x + 0.5) / SIZE * 2 - 1) * tangent * w;
    const double v = ((y + 0.5) / SIZE * 2 - 1) * tangent * w;
    face_axes(face, axes);
    for (int k = 0; k < 3; k++) {
        along += plane->normal[k] * (u * axes[0][k] + v * axes[1][k] + w * axes[2][k]);
    }
    return along < plane->distance;
}

/* One point light with all six faces. */
static inline void set_content(struct umb__content *content)
{
    struct umb_light_info *light = &content->lights[0];
    light->kind = UMB_LIGHT_POINT;
    light->frustum_count = FACES;
    memset(light->direction, 0, sizeof light->direction);
    memcpy(light->position, eye, sizeof eye);
    content->light_count = 1;
    for (uint32_t face = 0; face < FACES; face++) {
        double(*m)[4] = content->frusta[face].world_to_voxel, axes[3][3];
        const double scale[3] = {0.5 * SIZE / tangent, 0.5 * SIZE / tangent,
                                 SIZE / (far_w - near_w)};
        content->frusta[face].light = 0;
        face_axes(face, axes);
        for (int i = 0; i < 3; i++) {
            const double shift = i < 2 ? 0.5 * SIZE : 0; /* Share of W */
            m[i][3] = i < 2 ? 0 : -near_w * scale[2];
            for (int k = 0; k < 3; k++) {
                m[i][k] = axes[i][k] * scale[i] + axes[2][k] * shift;
                m[i][3] -= m[i][k] * (eye[k] - origin[k]);
            }
        }
        m[3][3] = 0;
        for (int k = 0; k < 3; k++) {
            m[3][k] = axes[2][k];
            m[3][3] -= m[3][k] * (eye[k] - origin[k]);
        }
    }
}

/* Voxels of a light's faces. The light's kind, direction, extent and side; zeros stand for a point
 * light without extent. */
struct lamp_model {
    int (*voxel)(const void *user, uint32_t face, uint32_t x, uint32_t y, uint32_t z);
    const void *user;
    const struct umb_light_info *light;
};

/* Writes an asset of one lamp. If its content is refused, returns NULL and the reason. */
static inline struct umb_asset *try_lamp(const struct lamp_model *model, struct umb_error *error)
{
    const struct voxels voxels = {model->voxel, model->user, LOG2, FACES};
    struct bytes bytes = {0};
    struct umb__octree octree;
    struct umb__content content;
    struct umb_asset *asset = NULL;
    uint8_t id[UMB_ID_BYTES];
    make_octree(&voxels, &octree);
    make_content(&voxels, 1, origin, &content);
    set_content(&content);
    if (model->light != NULL) {
        struct umb_light_info *light = &content.lights[0];
        light->kind = model->light->kind;
        light->extent = model->light->extent;
        memcpy(light->direction, model->light->direction, sizeof light->direction);
        memcpy(light->side, model->light->side, sizeof light->side);
    }
    struct umb_sink sink = bytes_sink(&bytes);
    if (umb__pack_write(&content, &octree, &test_digest, &sink, id, error) == UMB_OK) {
        (void)!umb_asset_open_bytes(bytes.data, bytes.size, NULL, &asset, error);
    }
    umb__octree_finish(&octree);
    bytes_finish(&bytes);
    return asset;
}

static inline struct umb_asset *make_asset(const struct plane *plane)
{
    const struct lamp_model model = {before_plane, plane, NULL};
    struct umb_error error = {0};
    struct umb_asset *asset = try_lamp(&model, &error);
    if (asset == NULL) {
        fail_msg("%s", error.message);
    }
    return asset;
}

#endif

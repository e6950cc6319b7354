/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_SPOT_ASSET_H
#define UMBRAGE_TESTS_SPOT_ASSET_H
/* A packed asset of one spot light, in memory. */
#include "partial_fixture.h"

enum {
    SPOT_LOG2 = 9,
    SPOT_SIZE = 1 << SPOT_LOG2,
};

static const double spot_eye[3] = {84620, 447400, 12};
static const double spot_near_w = 1, spot_far_w = 33, spot_tangent = 0.7;

static inline int spot_voxel(const void *user, uint32_t frustum, uint32_t x, uint32_t y, uint32_t z)
{
    (void)user;
    (void)frustum;
    return z < 30 || (fixture_hash(x / 4, y / 4, z / 4) & 3) != 0;
}

/* A spot at `spot_eye` that shines along +z. */
static inline struct bytes spot_file(void)
{
    const struct voxels voxels = {spot_voxel, NULL, SPOT_LOG2, 1};
    const double across = 0.5 * SPOT_SIZE / spot_tangent,
                 along = SPOT_SIZE / (spot_far_w - spot_near_w);
    struct bytes file = {0};
    struct umb_sink sink = bytes_sink(&file);
    struct umb__octree octree;
    struct umb__content content;
    struct umb_error error = {0};
    uint8_t id[UMB_ID_BYTES];
    make_octree(&voxels, &octree);
    make_content(&voxels, 1, fixture_origin, &content);
    content.lights[0].kind = UMB_LIGHT_SPOT;
    memcpy(content.lights[0].position, spot_eye, sizeof spot_eye);
    double(*m)[4] = content.frusta[0].world_to_voxel;
    memset(m, 0, sizeof content.frusta[0].world_to_voxel);
    for (unsigned i = 0; i < 2; i++) {
        m[i][i] = across;
        m[i][2] = 0.5 * SPOT_SIZE;
    }
    m[2][2] = along;
    m[3][2] = 1;
    for (unsigned i = 0; i < 4; i++) {
        m[i][3] = i == 2 ? -spot_near_w * along : 0;
        for (unsigned k = 0; k < 3; k++) {
            m[i][3] -= m[i][k] * (spot_eye[k] - fixture_origin[k]);
        }
    }
    if (umb__pack_write(&content, &octree, &test_digest, &sink, id, &error) != UMB_OK) {
        fail_msg("%s", error.message);
    }
    umb__octree_finish(&octree);
    return file;
}

#endif

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * One ray along z for each texel. A ray collects all candidates and commits none, because the
 * nearest front face, back face and other face are all needed.
 */
#include <embree3/rtcore.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/try.h"
#include "bake/depth/cut_out.h"
#include "bake/depth/depth.h"
#include "bake/depth/depth_perspective.h"
#include "bake/depth/proven_squares.h"

/* Padding of boxes in voxels: far above the error of rounding to float and of Embree's box test for
 * coordinates up to 2^18 (half a unit in the last place is 2^-7 there). */
#define BOX_PADDING 0.0625

struct caster {
    struct umbb_casters casters; /* the caller's, with `marks` */
    uint8_t *marks;
    RTCDevice device;
    RTCScene scene;
};

/* Embree's context, extended by the results of one texel. */
struct texel {
    struct RTCIntersectContext context; /* first field: Embree sees only this */
    int32_t x, y;
    int32_t nearest[UMBB_LAYER_COUNT]; /* nearest fragment of each layer, as `lit` */
};

/* The next float above (or below) a padded double. */
static float padded(double value, int up)
{
    return nextafterf((float)(up ? value + BOX_PADDING : value - BOX_PADDING),
                      up ? INFINITY : -INFINITY);
}

static void triangle_bounds(const struct RTCBoundsFunctionArguments *args)
{
    const struct umbb_casters *casters = args->geometryUserPtr;
    const double(*v)[3] = casters->corners[args->primID];
    double low[3], high[3];
    for (int axis = 0; axis < 3; axis++) {
        low[axis] = fmin(fmin(v[0][axis], v[1][axis]), v[2][axis]);
        high[axis] = fmax(fmax(v[0][axis], v[1][axis]), v[2][axis]);
    }
    struct RTCBounds *box = args->bounds_o;
    box->lower_x = padded(low[0], 0);
    box->lower_y = padded(low[1], 0);
    box->lower_z = padded(low[2], 0);
    box->upper_x = padded(high[0], 1);
    box->upper_y = padded(high[1], 1);
    box->upper_z = padded(high[2], 1);
}

/* Takes a triangle whose box the ray meets as a candidate. Embree calls it for each such triangle,
 * with one ray at a time: N is 1. */
static void triangle_candidate(const struct RTCIntersectFunctionNArguments *args)
{
    if (args->valid[0] == 0) {
        return;
    }
    struct texel *texel = (struct texel *)(void *)args->context;
    const struct umbb_casters *casters = args->geometryUserPtr;
    struct umbb_coverage coverage;
    if (!umbb_perspective_prepare(casters, args->primID, &coverage) ||
        texel->y < coverage.row_first || texel->y > coverage.row_last) {
        return;
    }
    int32_t x_first, x_last;
    const int front = umbb_coverage_row(&coverage, texel->y, &x_first, &x_last);
    const uint32_t cut = umbb_cut_of(casters->cuts, args->primID);
    if (texel->x < x_first || texel->x > x_last ||
        (cut != UMBS_CUT_NONE && !umbb_cut_casts(casters->cuts, cut, texel->x, texel->y))) {
        return;
    }
    const double row_z = umbb_coverage_row_z(&coverage, texel->y);
    const struct umbb_rays rays = umbb_rays_of(casters);
    const int32_t lit = umbb_rays_lit(&rays, &coverage, row_z, texel->x);
    int32_t *nearest =
        &texel->nearest[umbb_layer_of(umbb_caster_kind(casters, args->primID), front)];
    *nearest = lit < *nearest ? lit : *nearest;
}

static enum umb_status embree_begin(void *state, int slot, struct umbb_tile *tile,
                                    struct umb_error *error)
{
    const struct caster *caster = state;
    (void)slot;
    (void)error;
    tile->background = caster->casters.size;
    umbb_prove_squares(&caster->casters, NULL, caster->casters.count, NULL, tile);
    return UMB_OK;
}

static void cast_texel(const struct caster *caster, struct texel *texel)
{
    struct RTCRayHit ray;
    memset(&ray, 0, sizeof ray);
    ray.ray.org_x = (float)texel->x + 0.5F; /* exact: 18 + 1 bits */
    ray.ray.org_y = (float)texel->y + 0.5F;
    ray.ray.org_z = -1.0F;
    ray.ray.dir_z = 1.0F;
    ray.ray.tfar = INFINITY;
    ray.ray.mask = UINT32_MAX;
    ray.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    ray.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
    for (int layer = 0; layer < UMBB_LAYER_COUNT; layer++) {
        texel->nearest[layer] = caster->casters.size;
    }
    rtcIntersect1(caster->scene, &texel->context, &ray);
}

static void embree_block(void *state, int slot, unsigned thread, struct umbb_tile *tile, int32_t bx,
                         int32_t by)
{
    (void)slot;
    (void)thread;
    const struct caster *caster = state;
    const int32_t n = umbb_tile_block(tile);
    struct texel texel;
    rtcInitIntersectContext(&texel.context);
    for (int32_t y = by * n; y < (by + 1) * n; y++) {
        for (int32_t x = bx * n; x < (bx + 1) * n; x++) {
            texel.x = tile->x0 + x;
            texel.y = tile->y0 + y;
            cast_texel(caster, &texel);
            umbb_tile_put(tile, umbb_tile_index(tile, x, y), texel.nearest);
        }
    }
    umbb_tile_reduce(tile, bx * (n >> 3), by * (n >> 3), n >> 3);
}

static void embree_destroy(void *state)
{
    struct caster *caster = state;
    if (caster != NULL) {
        if (caster->scene != NULL) {
            rtcReleaseScene(caster->scene);
        }
        if (caster->device != NULL) {
            rtcReleaseDevice(caster->device);
        }
        free(caster->marks);
        free(caster);
    }
}

/* Builds Embree's scene; 0 if Embree reports an error. */
static int build_scene(struct caster *caster)
{
    caster->scene = rtcNewScene(caster->device);
    RTCGeometry geometry = rtcNewGeometry(caster->device, RTC_GEOMETRY_TYPE_USER);
    if (caster->scene == NULL || geometry == NULL) {
        rtcReleaseGeometry(geometry);
        return 0;
    }
    rtcSetSceneFlags(caster->scene, RTC_SCENE_FLAG_ROBUST);
    rtcSetGeometryUserPrimitiveCount(geometry, (unsigned)caster->casters.count);
    rtcSetGeometryUserData(geometry, &caster->casters);
    rtcSetGeometryBoundsFunction(geometry, triangle_bounds, NULL);
    rtcSetGeometryIntersectFunction(geometry, triangle_candidate);
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(caster->scene, geometry);
    rtcReleaseGeometry(geometry);
    rtcCommitScene(caster->scene);
    return rtcGetDeviceError(caster->device) == RTC_ERROR_NONE;
}

/* Marks the casters, and builds Embree's device and scene. */
static enum umb_status caster_init(struct caster *caster, const struct umbb_depth_options *options,
                                   struct umb_error *error)
{
    char config[64];
    snprintf(config, sizeof config, "threads=%u", options->threads);
    UMB__TRY(umbb_front_marks_make(&caster->casters, options->prove, NULL, &caster->marks, error));
    caster->casters.marks = caster->marks;
    caster->device = rtcNewDevice(config);
    if (caster->device == NULL) {
        return umb_fail(error, UMB_E_INTERNAL, "ray caster: Embree gave no device (error %d)",
                        (int)rtcGetDeviceError(NULL));
    }
    return build_scene(caster) ? UMB_OK
                               : umb_fail(error, UMB_E_NO_MEMORY,
                                          "ray caster: Embree could not build %zu triangles",
                                          caster->casters.count);
}

enum umb_status umbb_depth_embree_create(const struct umbb_casters *casters,
                                         const struct umbb_depth_options *options,
                                         struct umbb_depth *depth, struct umb_error *error)
{
    *depth = (struct umbb_depth){0};
    struct caster *caster = calloc(1, sizeof *caster);
    if (caster == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "ray caster: memory refused");
    }
    caster->casters = *casters;
    const enum umb_status status = caster_init(caster, options, error);
    if (status != UMB_OK) {
        embree_destroy(caster);
        return status;
    }
    *depth = (struct umbb_depth){
        .state = caster,
        .begin = embree_begin,
        .block = embree_block,
        .destroy = embree_destroy,
    };
    return UMB_OK;
}

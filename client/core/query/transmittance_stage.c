/* SPDX-License-Identifier: Apache-2.0 */
/* See transmittance_stage.h. */
#include "query/transmittance_stage.h"

#include "format/asset_parts.h"
#include "query/perspective.h"
#include "query/slice_count.h"

#define CHUNK 256 /* points at a time: a multiple of 8, for bits */

void umb__transmittance_set(struct umb__query *q, const struct umb_asset *asset,
                            const struct umb_light_info *light)
{
    const struct umb__trans *trans = &asset->canonical.trans;
    int32_t texel = 0; /* widest, in voxels; 0: no map */
    for (uint32_t i = 0; trans->maps != NULL && i < light->frustum_count; i++) {
        const uint32_t frustum = light->first_frustum + i, level = trans->maps[frustum].level;
        const uint32_t n = asset->canonical.content.frusta[frustum].log2_size;
        const int32_t voxels = level > 0 ? (int32_t)1 << (n - level) : 0;
        texel = voxels > texel ? voxels : texel;
    }
    if (texel == 0) {
        return;
    }
    const int32_t least = texel > 1 ? texel + 1 : 1; /* odd, as texels are powers of two */
    q->trans = trans;
    q->transmittance_taps = q->taps > least ? q->taps : least;
    q->transmittance_bias_taps = q->transmittance_taps + texel - 1;
}

/* Where point i is looked up. Returns its frustum; its normal faces away if that is UINT32_MAX. */
static uint32_t place(const struct umb__query *wide, const struct umb_points *points, size_t i,
                      double voxel[3])
{
    if (wide->face_count > 0) {
        struct umb__sighting s;
        umb__perspective_map(wide, points, i, &s);
        memcpy(voxel, s.voxel, sizeof s.voxel);
        return s.facing_away ? UINT32_MAX : wide->first_face + s.face;
    }
    double p[3];
    for (unsigned axis = 0; axis < 3; axis++) {
        p[axis] = points->origin[axis] - wide->origin[axis] + umb__coordinate(points, i, axis);
    }
    const bool facing = umb__move(wide, points, i, p);
    umb__to_voxel(wide, p, voxel);
    return facing ? wide->frustum : UINT32_MAX;
}

/* The part of a box of `taps` voxels around v that lies on an axis of `size`; false: none. */
static bool clip_axis(double v, int32_t taps, double size, uint32_t *low, uint32_t *high)
{
    const double first = floor(v) - taps / 2, last = floor(v) + taps / 2;
    if (!(last >= 0 && first < size)) { /* also for NaN */
        return false;
    }
    *low = first > 0 ? (uint32_t)first : 0;
    *high = last < size ? (uint32_t)last : (uint32_t)size - 1;
    return true;
}

/* What point i loses, of `*all`. In: wide: with the bias of this stage. */
static uint64_t lost_at(const struct umb__query *wide, const struct umb_points *points, size_t i,
                        uint64_t *all)
{
    double v[3];
    struct umb__transmittance_window window;
    const int32_t taps = wide->transmittance_taps;
    const uint32_t frustum = place(wide, points, i, v);
    *all = (uint64_t)(uint32_t)taps * (uint32_t)taps * UMB__TRANSMITTANCE_ONE;
    if (frustum == UINT32_MAX || wide->trans->maps[frustum].level == 0 || !(v[2] >= 0)) {
        return 0;
    }
    const uint32_t n =
        wide->face_count > 0 ? wide->faces[frustum - wide->first_face].log2_size : wide->log2_size;
    const double size = (double)((uint32_t)1 << n);
    if (!clip_axis(v[0], taps, size, &window.x0, &window.x1) ||
        !clip_axis(v[1], taps, size, &window.y0, &window.y1)) {
        return 0;
    }
    window.z = (uint32_t)(v[2] < size ? v[2] : size - 1);
    return umb__transmittance_lost(wide->trans, &wide->trans->maps[frustum], n, &window);
}

/* The query whose points are moved for the boxes of this stage: of voxels, whatever the level. */
static struct umb__query widen(const struct umb__query *q)
{
    struct umb__query wide = *q;
    wide.taps = q->transmittance_bias_taps;
    wide.no_normal_m = q->transmittance_no_normal_m;
    for (unsigned axis = 0; axis < 3 && q->level > 0 && q->bias_mode == UMB_BIAS_AUTO; axis++) {
        for (unsigned k = 0; k < 3; k++) {
            wide.voxel_step[axis][k] /= umb__coarse_steps(q);
        }
    }
    return wide;
}

static double share_left(uint64_t lost, uint64_t all)
{
    return (double)(all - lost) / (double)all; /* both below 2^53 */
}

double umb__transmittance_at(const struct umb__query *q, const struct umb_points *points, size_t i)
{
    const struct umb__query wide = widen(q);
    uint64_t all;
    const uint64_t lost = lost_at(&wide, points, i, &all);
    return share_left(lost, all);
}

static void run_chunk(const struct umb__query *q, const struct umb__query *wide,
                      const struct umb_points *points, size_t first, size_t count,
                      struct umb_answers *answers)
{
    uint64_t lost[CHUNK], all = 1, any = 0;
    for (size_t i = 0; i < count; i++) {
        lost[i] = lost_at(wide, points, first + i, &all);
        any |= lost[i];
    }
    struct umb__query opaque = *q;
    opaque.trans = NULL;
    if (any == 0) {
        q->opaque_run(&opaque, points, first, count, answers);
        return;
    }
    float values[CHUNK];
    const struct umb_points part = umb__some_points(points, first, count);
    struct umb_answers shares = {.values = values, .stats = answers->stats};
    opaque.format = UMB_ANSWER_F32;
    q->opaque_run(&opaque, &part, 0, count, &shares);
    answers->stats = shares.stats;
    for (size_t i = 0; i < count; i++) {
        umb__store_share(answers->values, q->format, first + i,
                         (double)values[i] * share_left(lost[i], all));
    }
}

void umb__transmittance_run(const struct umb__query *q, const struct umb_points *points,
                            size_t first, size_t count, struct umb_answers *answers)
{
    const struct umb__query wide = widen(q);
    for (size_t end = first + count; first < end;) {
        const size_t n = end - first < CHUNK ? end - first : CHUNK;
        run_chunk(q, &wide, points, first, n, answers);
        first += n;
    }
}

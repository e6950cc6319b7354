/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The stage of translucent casters: multiplies the answers for opaque casters by the transmittance
 * of deep maps (format/transmittance.h).
 *
 * Transmittance is the mean over a box of voxels around the point's voxel, at one depth; each voxel
 * has the value of its texel. The box is as wide as the window of opaque casters, and at least one
 * texel and a voxel, so that it changes from texel to texel without a step. A texel's list was made
 * along its middle, so the automatic bias adds half a texel to the box. All sums are of integers:
 * the same bits on all machines.
 */
#include "query/perspective.h"
#include "query/slice_count.h"
#include "query/stages.h"

#define CHUNK 256 /* points at a time: a multiple of 8, for bits */

/* Clips a box of `taps` voxels around v to an axis of `size` voxels. False: nothing is left. */
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

/* Returns the light that point i loses in translucent casters. Out: all: the whole light in the
 * same unit. In: wide: the query with the bias of this stage. */
static uint64_t lost_at(const struct umb__query *wide, const struct umb_points *points, size_t i,
                        uint64_t *all)
{
    double v[3];
    struct umb__transmittance_window window;
    const int32_t taps = wide->transmittance_taps;
    uint32_t frustum;
    const bool facing = umb__look_up_at(wide, points, i, v, &frustum);
    *all = (uint64_t)(uint32_t)taps * (uint32_t)taps * UMB__TRANSMITTANCE_ONE;
    if (!facing || wide->trans->maps[frustum].level == 0 || !(v[2] >= 0)) {
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

/* Boxes consist of voxels, even if look-ups stop at a coarser level. */
void umb__transmittance_widen(const struct umb__query *q, struct umb__query *wide)
{
    *wide = *q;
    wide->level = 0;
    wide->taps = q->transmittance_bias_taps;
    wide->no_normal_m = q->transmittance_no_normal_m;
    for (unsigned axis = 0; axis < 3 && q->level > 0 && q->bias_mode == UMB_BIAS_AUTO; axis++) {
        for (unsigned k = 0; k < 3; k++) {
            wide->voxel_step[axis][k] /= umb__coarse_steps(q);
        }
    }
}

static double share_left(uint64_t lost, uint64_t all)
{
    return (double)(all - lost) / (double)all; /* both below 2^53 */
}

double umb__transmittance_left(const struct umb__query *wide, const struct umb_points *points,
                               size_t i)
{
    uint64_t all;
    const uint64_t lost = lost_at(wide, points, i, &all);
    return share_left(lost, all);
}

bool umb__transmittance_is_clear_at(const struct umb__query *wide, const struct umb_points *points,
                                    size_t i, const double reach[2])
{
    const struct umb__transmittance_map *map = &wide->trans->maps[wide->frustum];
    const double size = (double)((uint32_t)1 << wide->log2_size);
    struct umb__transmittance_window window = {0};
    double v[3];
    if (!umb__voxel_at(wide, points, i, v) || map->level == 0) {
        return true;
    }
    const double more[2] = {reach[0] + wide->transmittance_taps / 2 + 1,
                            reach[1] + wide->transmittance_taps / 2 + 1};
    for (unsigned axis = 0; axis < 2; axis++) {
        if (!(v[axis] + more[axis] >= 0 && v[axis] - more[axis] < size)) {
            return v[axis] == v[axis]; /* NaN proves nothing */
        }
    }
    window.x0 = v[0] > more[0] ? (uint32_t)(v[0] - more[0]) : 0;
    window.y0 = v[1] > more[1] ? (uint32_t)(v[1] - more[1]) : 0;
    window.x1 = (uint32_t)fmin(v[0] + more[0], size - 1);
    window.y1 = (uint32_t)fmin(v[1] + more[1], size - 1);
    return umb__transmittance_is_clear(wide->trans, map, wide->log2_size, &window);
}

double umb__transmittance_at(const struct umb__query *q, const struct umb_points *points, size_t i)
{
    struct umb__query wide;
    umb__transmittance_widen(q, &wide);
    return umb__transmittance_left(&wide, points, i);
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
        q->transmittance_inner(&opaque, points, first, count, answers);
        return;
    }
    float values[CHUNK];
    const struct umb_points part = umb__some_points(points, first, count);
    struct umb_answers shares = {.values = values, .stats = answers->stats};
    opaque.format = UMB_ANSWER_F32;
    q->transmittance_inner(&opaque, &part, 0, count, &shares);
    answers->stats = shares.stats;
    for (size_t i = 0; i < count; i++) {
        umb__store_share(answers->values, q->format, first + i,
                         (double)values[i] * share_left(lost[i], all));
    }
}

static void transmittance_run(const struct umb__query *q, const struct umb_points *points,
                              size_t first, size_t count, struct umb_answers *answers)
{
    struct umb__query wide;
    umb__transmittance_widen(q, &wide);
    for (size_t end = first + count; first < end;) {
        const size_t n = end - first < CHUNK ? end - first : CHUNK;
        run_chunk(q, &wide, points, first, n, answers);
        first += n;
    }
}

int32_t umb__transmittance_texel(const struct umb_asset *asset, const struct umb_light_info *light)
{
    const struct umb__trans *trans = &asset->canonical.trans;
    int32_t texel = 0;
    for (uint32_t i = 0; trans->maps != NULL && i < light->frustum_count; i++) {
        const uint32_t frustum = light->first_frustum + i, level = trans->maps[frustum].level;
        const uint32_t n = asset->canonical.content.frusta[frustum].log2_size;
        const int32_t voxels = level > 0 ? (int32_t)1 << (n - level) : 0;
        texel = voxels > texel ? voxels : texel;
    }
    return texel;
}

static bool applies(const struct umb__plan *plan)
{
    return !plan->settings->opaque_only && umb__transmittance_texel(plan->asset, plan->light) > 0;
}

static void set(const struct umb__plan *plan, struct umb__query *q)
{
    const int32_t texel = umb__transmittance_texel(plan->asset, plan->light);
    const int32_t least = texel > 1 ? texel + 1 : 1; /* odd, as texels are powers of two */
    q->trans = &plan->asset->canonical.trans;
    q->transmittance_taps = q->taps > least ? q->taps : least;
    q->transmittance_bias_taps = q->transmittance_taps + texel - 1;
    q->transmittance_no_normal_m = umb__no_normal_m(plan, q, q->transmittance_bias_taps);
    q->transmittance_inner = q->run;
    q->run = transmittance_run;
}

const struct umb__stage umb__transmittance_stage = {applies, set};

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Counts the lit voxels of a box. The descent counts cubes inside the box whole, and skips cubes
 * outside.
 *
 * A box in world space is three slabs min <= w < max, where w is linear in the voxel's index. In
 * doubles w is computed as ((o + ex x) + ey y) + ez z. Rounding keeps each of these operations
 * monotone, so over a cube of voxels the computed w has its exact extremes at two corners. The test
 * of a cube therefore needs no margin, and agrees with tests of all its voxels.
 */
#include "query/volume_parts.h"

/* The voxels low <= v < high, none outside the frustum. */
struct range {
    int32_t low[3], high[3];
};

struct count {
    const struct umb__tree *tree;
    struct range range;          /* Range of voxels that may lie inside */
    const struct umb_box *world; /* Box in world space; NULL: the whole range lies inside */
    double start[3];   /* World coordinates of voxel (0, 0, 0), minus the asset's origin */
    double step[3][3]; /* World vectors of a voxel; row i: along voxel axis i */
    double origin[3];  /* Origin of the asset */
    struct umb_box_answer *answer;
    struct umb_volume_stats *stats;
    const struct umb_box_watch *watch; /* Watch that may end a box; NULL: none */
    uint64_t steps;                    /* Number of steps taken in the current box */
    uint64_t next_question;            /* Number of steps at which the watch is asked again */
    uint64_t most;                     /* Most steps in a box without a watch */
    bool given_up;                     /* True: the current box is left */
};

#define CUT_STEPS 64 /* Number of steps of a brick whose voxels are tested one by one */

/* Adds steps to the box, and asks the watch when due. Returns false if the box is given up. */
static bool step(struct count *count, uint64_t steps)
{
    count->steps += steps;
    if (!count->given_up && count->steps >= count->next_question) {
        count->given_up = !count->watch || !count->watch->go_on(count->watch->user, count->steps);
        count->next_question = count->steps + UMB_BOX_STEPS;
    }
    return !count->given_up;
}

/* An aligned cube of voxels. */
struct cube {
    uint32_t level;
    int32_t low[3];
};

enum cover {
    COVER_NONE,
    COVER_SOME,
    COVER_ALL
};

/* Returns the world coordinate of a voxel's centre, as volume.h defines it. */
static inline double centre(const struct count *count, unsigned axis, const int32_t voxel[3])
{
    double w = count->start[axis];
    for (unsigned k = 0; k < 3; k++) {
        w += ((double)voxel[k] + 0.5) * count->step[k][axis];
    }
    return w + count->origin[axis];
}

/* Returns whether all, some or none of the voxels low..high (inclusive) lie inside a slab of the
 * world box. */
static enum cover slab_cover(const struct count *count, unsigned axis, const int32_t low[3],
                             const int32_t high[3])
{
    const double min = count->world->min[axis], max = count->world->max[axis];
    int32_t least[3], most[3];
    for (unsigned k = 0; k < 3; k++) {
        bool rising = count->step[k][axis] >= 0;
        least[k] = rising ? low[k] : high[k];
        most[k] = rising ? high[k] : low[k];
    }
    double least_w = centre(count, axis, least), most_w = centre(count, axis, most);
    if (!(most_w >= min && least_w < max)) {
        return COVER_NONE;
    }
    return least_w >= min && most_w < max ? COVER_ALL : COVER_SOME;
}

static enum cover cube_cover(const struct count *count, const struct cube *cube)
{
    int32_t side = (int32_t)1 << cube->level, high[3];
    enum cover cover = COVER_ALL;
    for (unsigned k = 0; k < 3; k++) {
        high[k] = cube->low[k] + side - 1;
        if (high[k] < count->range.low[k] || cube->low[k] >= count->range.high[k]) {
            return COVER_NONE;
        }
        if (cube->low[k] < count->range.low[k] || high[k] >= count->range.high[k]) {
            cover = COVER_SOME;
        }
    }
    for (unsigned axis = 0; count->world && axis < 3; axis++) {
        enum cover slab = slab_cover(count, axis, cube->low, high);
        cover = slab < cover ? slab : cover;
    }
    return cover;
}

/* Returns the voxels of a brick inside the range, a mask a slice. */
static void range_masks(const struct range *range, const struct cube *brick, uint64_t inside[8])
{
    const struct umb__rectangle across = {range->low[0], range->high[0] - 1, range->low[1],
                                          range->high[1] - 1};
    const uint64_t slice = umb__slice_mask(brick->low[0], brick->low[1], &across);
    for (int32_t i = 0; i < 8; i++) {
        const int32_t z = brick->low[2] + i;
        inside[i] = z >= range->low[2] && z < range->high[2] ? slice : 0;
    }
}

/* Removes the voxels whose centre is outside a slab of the world box. The centres are computed
 * eight at a time, by the operations of centre() in the same order. */
static void slab_masks(const struct count *count, unsigned axis, const struct cube *brick,
                       uint64_t inside[8])
{
    const double min = count->world->min[axis], max = count->world->max[axis];
    for (int32_t y = 0; y < 8; y++) {
        double row[8];
        for (int32_t x = 0; x < 8; x++) {
            row[x] =
                count->start[axis] + ((double)(brick->low[0] + x) + 0.5) * count->step[0][axis];
            row[x] += ((double)(brick->low[1] + y) + 0.5) * count->step[1][axis];
        }
        for (int32_t z = 0; z < 8; z++) {
            if (!(inside[z] >> (8 * y) & 0xffU)) {
                continue; /* The range or another slab has removed the row */
            }
            double depth = ((double)(brick->low[2] + z) + 0.5) * count->step[2][axis];
            uint64_t bits = 0;
            for (int32_t x = 0; x < 8; x++) {
                double w = row[x] + depth + count->origin[axis];
                bits |= (uint64_t)(w >= min && w < max) << x;
            }
            inside[z] &= ~((~bits & 0xffU) << (8 * y));
        }
    }
}

/* Counts a brick that the box's faces cut. In: masks: NULL for a uniform cube of a brick's size. */
static void count_cut_brick(struct count *count, const struct cube *brick, const uint64_t *masks,
                            bool lit)
{
    uint64_t inside[8];
    if (!step(count, CUT_STEPS)) {
        return;
    }
    range_masks(&count->range, brick, inside);
    const int32_t last[3] = {brick->low[0] + 7, brick->low[1] + 7, brick->low[2] + 7};
    for (unsigned axis = 0; count->world && axis < 3; axis++) {
        if (slab_cover(count, axis, brick->low, last) == COVER_SOME) {
            slab_masks(count, axis, brick, inside);
        }
    }
    for (int32_t z = 0; z < 8; z++) {
        uint64_t lit_mask = masks ? masks[z] : lit ? UINT64_MAX : 0;
        count->answer->voxels += (uint64_t)__builtin_popcountll(inside[z]);
        count->answer->lit += (uint64_t)__builtin_popcountll(inside[z] & lit_mask);
    }
}

static void count_whole_brick(struct count *count, const uint64_t masks[8])
{
    for (int32_t z = 0; z < 8; z++) {
        count->answer->lit += (uint64_t)__builtin_popcountll(masks[z]);
    }
    count->answer->voxels += 512;
}

/* Counts a uniform cube. A cube that the box's faces cut is halved, down to bricks. */
static void count_uniform(struct count *count, const struct cube *cube, bool lit, enum cover cover)
{
    if (cover == COVER_ALL) {
        uint64_t voxels = (uint64_t)1 << (3 * cube->level);
        count->answer->voxels += voxels;
        count->answer->lit += lit ? voxels : 0;
        return;
    }
    if (cube->level == UMB_LEVEL_BRICK) {
        count_cut_brick(count, cube, NULL, lit);
        return;
    }
    int32_t half = (int32_t)1 << (cube->level - 1);
    for (int32_t c = 0; c < 8 && step(count, 1); c++) {
        struct cube child = {cube->level - 1,
                             {cube->low[0] + (c & 1) * half, cube->low[1] + (c >> 1 & 1) * half,
                              cube->low[2] + (c >> 2) * half}};
        enum cover child_cover = cube_cover(count, &child);
        if (child_cover != COVER_NONE) {
            count_uniform(count, &child, lit, child_cover);
        }
    }
}

/* Counts the voxels of a cube that `link` describes. In: cover: how much of the cube the box
 * covers, not none. */
static void count_link(struct count *count, const struct cube *cube, struct umb__link link,
                       enum cover cover)
{
    if (!link.mixed) {
        count_uniform(count, cube, link.lit, cover);
        return;
    }
    if (cube->level == UMB_LEVEL_BRICK) {
        const uint64_t *masks = count->tree->bricks[link.number];
        count->stats->bricks++;
        if (cover == COVER_ALL) {
            count_whole_brick(count, masks);
        } else {
            count_cut_brick(count, cube, masks, false);
        }
        return;
    }
    uint32_t level = cube->level - 2;
    count->stats->nodes++;
    for (int32_t c = 0; c < 64 && step(count, 1); c++) {
        struct cube child = {level,
                             {cube->low[0] + (int32_t)((uint32_t)(c & 3) << level),
                              cube->low[1] + (int32_t)((uint32_t)(c >> 2 & 3) << level),
                              cube->low[2] + (int32_t)((uint32_t)(c >> 4) << level)}};
        enum cover child_cover = cover == COVER_ALL ? COVER_ALL : cube_cover(count, &child);
        if (child_cover != COVER_NONE) {
            count_link(count, &child, umb__tree_child(count->tree, link.number, (unsigned)c),
                       child_cover);
        }
    }
}

/* Visits the grid cells that the range touches. */
static void count_range(struct count *count)
{
    uint32_t level = umb__tree_cell_level(count->tree);
    const struct range *range = &count->range;
    int32_t first[3], last[3];
    for (unsigned k = 0; k < 3; k++) {
        if (range->low[k] >= range->high[k]) {
            return;
        }
        first[k] = range->low[k] >> level;
        last[k] = (range->high[k] - 1) >> level;
    }
    for (int32_t z = first[2]; z <= last[2]; z++) {
        for (int32_t y = first[1]; y <= last[1]; y++) {
            for (int32_t x = first[0]; x <= last[0] && step(count, 1); x++) {
                struct cube cube = {level,
                                    {(int32_t)((uint32_t)x << level),
                                     (int32_t)((uint32_t)y << level),
                                     (int32_t)((uint32_t)z << level)}};
                enum cover cover = cube_cover(count, &cube);
                count->stats->nodes++;
                if (cover != COVER_NONE) {
                    count_link(count, &cube,
                               umb__tree_cell(count->tree, (uint32_t)x, (uint32_t)y, (uint32_t)z),
                               cover);
                }
            }
        }
    }
}

static struct count begin_count(const struct umb__tree *tree, const struct umb_box_watch *watch,
                                struct umb_box_answers *answers)
{
    const uint32_t bricks_log2 = tree->log2_size - UMB_LEVEL_BRICK; /* a side */
    return (struct count){.tree = tree,
                          .most = (uint64_t)UMB_BOX_COLUMN_STEPS << 2 * bricks_log2,
                          .stats = &answers->stats,
                          .watch = watch};
}

/* Counts the voxels of the range; if there is a world box, only those inside that box. */
static enum umb_status count_box(struct count *count, struct umb_box_answer *answer, size_t box,
                                 struct umb_error *error)
{
    count->answer = answer;
    count->steps = 0;
    count->given_up = false;
    count->next_question = count->watch ? UMB_BOX_STEPS : count->most;
    *answer = (struct umb_box_answer){0};
    count_range(count);
    if (!count->given_up) {
        return UMB_OK;
    }
    *answer = (struct umb_box_answer){0, UINT64_MAX};
    return count->watch
               ? UMB_OK
               : umb_fail(error, UMB_E_LIMIT,
                          "boxes[%zu]: takes more than %llu steps, the limit at %u voxels "
                          "a side; ask for smaller ones, side by side, or give a watch",
                          box, (unsigned long long)count->most, 1U << count->tree->log2_size);
}

static int32_t clamp(double value, int32_t size)
{
    return value >= size ? size : value > 0 ? (int32_t)value : 0;
}

/* Returns a range of voxels that contains all with a centre in a world box: the voxels between the
 * box's corners, and one more on each side for the rounding of both transforms. */
static struct range range_around(const struct umb__volume *v, const struct umb_box *box)
{
    struct range range;
    int32_t size = (int32_t)1 << v->tree.log2_size;
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    for (unsigned c = 0; c < 8; c++) {
        double p[3], at[3];
        for (unsigned k = 0; k < 3; k++) {
            p[k] = (c >> k & 1 ? box->max[k] : box->min[k]) - v->origin[k];
        }
        umb__volume_to_voxel(v, p, at);
        for (unsigned k = 0; k < 3; k++) {
            /* A coordinate that overflowed limits nothing. */
            low[k] = isfinite(at[k]) ? fmin(low[k], at[k]) : -INFINITY;
            high[k] = isfinite(at[k]) ? fmax(high[k], at[k]) : INFINITY;
        }
    }
    for (unsigned k = 0; k < 3; k++) {
        range.low[k] = clamp(floor(low[k]) - 1, size);
        range.high[k] = clamp(floor(high[k]) + 2, size);
    }
    return range;
}

enum umb_status umb_volume_boxes(const struct umb_volume *volume, const struct umb_box *boxes,
                                 size_t first, size_t count, const struct umb_box_watch *watch,
                                 struct umb_box_answers *answers, struct umb_error *error)
{
    enum umb_status status = UMB_OK;
    const struct umb__volume v = umb__volume_of(volume);
    struct count job = begin_count(&v.tree, watch, answers);
    memcpy(job.step, v.voxel_step, sizeof job.step);
    memcpy(job.origin, v.origin, sizeof job.origin);
    for (unsigned axis = 0; axis < 3; axis++) {
        for (unsigned k = 0; k < 3; k++) {
            job.start[axis] -= v.world_to_voxel[k][3] * v.voxel_step[k][axis];
        }
    }
    for (size_t i = first; status == UMB_OK && i < first + count; i++) {
        job.range = v.face_count > 0 ? (struct range){0} : range_around(&v, &boxes[i]);
        job.world = &boxes[i];
        status = count_box(&job, &answers->boxes[i], i, error);
    }
    return status;
}

enum umb_status umb_volume_voxel_boxes(const struct umb_volume *volume,
                                       const struct umb_voxel_box *boxes, size_t first,
                                       size_t count, const struct umb_box_watch *watch,
                                       struct umb_box_answers *answers, struct umb_error *error)
{
    enum umb_status status = UMB_OK;
    const struct umb__volume v = umb__volume_of(volume);
    struct count job = begin_count(&v.tree, watch, answers);
    const int64_t size = (int64_t)1 << v.tree.log2_size;
    for (size_t i = first; status == UMB_OK && i < first + count; i++) {
        for (unsigned k = 0; k < 3; k++) {
            int64_t low = boxes[i].min[k], high = boxes[i].max[k];
            job.range.low[k] = (int32_t)(low < 0 ? 0 : low > size ? size : low);
            job.range.high[k] = (int32_t)(high < 0 ? 0 : high > size ? size : high);
        }
        status = count_box(&job, &answers->boxes[i], i, error);
    }
    return status;
}

void umb_boxes_from_corners(const struct umb_segments *corners, size_t first, size_t count,
                            struct umb_box *boxes)
{
    for (size_t i = 0; i < 3 * count; i++) {
        const size_t k = i % 3, at = 6 * (first + i / 3) + k;
        const double a = corners->origin[k] + umb__scalar_at(corners->ends, corners->format, at);
        const double b =
            corners->origin[k] + umb__scalar_at(corners->ends, corners->format, at + 3);
        boxes[i / 3].min[k] = a < b ? a : b;
        boxes[i / 3].max[k] = a < b ? b : a;
    }
}

enum umb_status umb_boxes_check(const struct umb_box *boxes, size_t count, struct umb_error *error)
{
    static const char axes[] = "xyz";
    for (size_t i = 0; i < count; i++) {
        for (unsigned k = 0; k < 3; k++) {
            double low = boxes[i].min[k], high = boxes[i].max[k];
            if (!isfinite(low) || !isfinite(high)) {
                return umb_fail(error, UMB_E_ARGUMENT, "boxes[%zu].%s.%c: %g, must be finite", i,
                                isfinite(low) ? "max" : "min", axes[k], isfinite(low) ? high : low);
            }
            if (low > high) {
                return umb_fail(error, UMB_E_ARGUMENT,
                                "boxes[%zu].min.%c: %g, must not be above its max, %g", i, axes[k],
                                low, high);
            }
        }
    }
    return UMB_OK;
}

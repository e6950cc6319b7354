/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Counts the lit voxels of a box. The descent counts cubes inside the box whole, and skips cubes
 * outside.
 *
 * A box in world space is three slabs min <= w < max, where w is linear in the voxel's index. In
 * doubles w is computed as ((o + ex x) + ey y) + ez z. Rounding keeps each of these operations
 * monotone, so over a cube of voxels the computed w has its exact extremes at two corners. The test
 * of a cube therefore needs no margin, and agrees with tests of all its voxels.
 *
 * In a face of a lamp a coordinate is W (d + ex x + ey y), where W is linear in z. Both factors are
 * monotone, and so is their product over a range of one factor. So the extremes are at corners
 * again, four of which must be tried. A voxel is left out if another face answers there, which is
 * the face with the larger W. The ratio of the two W is linear in x and y, so this test is also one
 * of a linear function.
 */
#include "query/volume_parts.h"

/* A face of a lamp, for boxes. */
struct face {
    double direction[3];  /* From the light to texel coordinate (0, 0), where W = 1 */
    double scale, offset; /* W = scale z + offset */
    double position[3];   /* Position of the light, minus the asset's origin */
    uint32_t other_count;
    double others[UMB__FACES_MAX][3]; /* W of another face per unit of this face's W: constant part,
                                         and increase per texel of x and of y */
    double limits[UMB__FACES_MAX];    /* Limits: below them the own face answers */
};

/* The voxels low <= v < high, none outside the frustum. */
struct range {
    int32_t low[3], high[3];
};

struct count {
    const struct umb__tree *tree;
    struct range range;          /* Range of voxels that may lie inside */
    const struct umb_box *world; /* Box in world space; NULL: the whole range lies inside */
    const struct face *face;     /* Face of a lamp; NULL: a directional light */
    double start[3];   /* World coordinates of voxel (0, 0, 0), minus the asset's origin */
    double step[3][3]; /* World vectors of a voxel; row i: along voxel axis i */
    double origin[3];  /* Origin of the asset */
    struct umb_box_answer *answer;
    struct umb_volume_stats *stats;
    const struct umb_box_watch *watch; /* Watch that may end a box; NULL: none */
    uint64_t steps;                    /* Number of steps taken in the current box */
    uint64_t next_question;            /* Number of steps at which the watch is called again */
    uint64_t most;                     /* Most steps in a box without a watch */
    bool given_up;                     /* True: the current box is left */
};

#define CUT_STEPS 64 /* Number of steps charged for a brick whose voxels are tested one by one */

/* Adds steps to the box, and calls the watch when it is due. Returns false if the box is given
 * up. */
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

/* Returns the world coordinate of a voxel's centre under parallel light, as volume.h defines it. */
static inline double centre(const struct count *count, unsigned axis, const int32_t voxel[3])
{
    double w = count->start[axis];
    for (unsigned k = 0; k < 3; k++) {
        w += ((double)voxel[k] + 0.5) * count->step[k][axis];
    }
    return w + count->origin[axis];
}

/* Returns the value of a linear function constant + a x + b y at the centre of texel (x, y). */
static inline double linear(double constant, double a, double b, int32_t x, int32_t y)
{
    return (constant + ((double)x + 0.5) * a) + ((double)y + 0.5) * b;
}

/* Returns the world coordinate of a voxel's centre in a face, as volume.h defines it. In: across:
 * the coordinate from the light where W = 1. */
static inline double face_centre(const struct count *count, unsigned axis, double across, int32_t z)
{
    const struct face *face = count->face;
    const double w = face->scale * ((double)z + 0.5) + face->offset;
    return (w * across + face->position[axis]) + count->origin[axis];
}

/* Least and greatest value over some voxels. */
struct bounds {
    double least, most;
};

/* Returns the bounds of a linear function over the texels low..high (inclusive). */
static struct bounds linear_bounds(double constant, double a, double b, const int32_t low[3],
                                   const int32_t high[3])
{
    return (struct bounds){
        linear(constant, a, b, a >= 0 ? low[0] : high[0], b >= 0 ? low[1] : high[1]),
        linear(constant, a, b, a >= 0 ? high[0] : low[0], b >= 0 ? high[1] : low[1])};
}

/* Returns the bounds of a world coordinate over the voxels low..high (inclusive). */
static struct bounds coordinate_bounds(const struct count *count, unsigned axis,
                                       const int32_t low[3], const int32_t high[3])
{
    int32_t least[3], most[3];
    if (count->face != NULL) {
        const struct bounds across = linear_bounds(
            count->face->direction[axis], count->step[0][axis], count->step[1][axis], low, high);
        const double a = face_centre(count, axis, across.least, low[2]);
        const double b = face_centre(count, axis, across.least, high[2]);
        const double c = face_centre(count, axis, across.most, low[2]);
        const double d = face_centre(count, axis, across.most, high[2]);
        /* W is below 0 in cubes that reach behind the light. */
        return (struct bounds){fmin(fmin(a, b), fmin(c, d)), fmax(fmax(a, b), fmax(c, d))};
    }
    for (unsigned k = 0; k < 3; k++) {
        bool rising = count->step[k][axis] >= 0;
        least[k] = rising ? low[k] : high[k];
        most[k] = rising ? high[k] : low[k];
    }
    return (struct bounds){centre(count, axis, least), centre(count, axis, most)};
}

/* Returns whether all, some or none of the voxels low..high (inclusive) lie inside a slab of the
 * world box. */
static enum cover slab_cover(const struct count *count, unsigned axis, const int32_t low[3],
                             const int32_t high[3])
{
    const double min = count->world->min[axis], max = count->world->max[axis];
    const struct bounds w = coordinate_bounds(count, axis, low, high);
    if (!(w.most >= min && w.least < max)) {
        return COVER_NONE;
    }
    return w.least >= min && w.most < max ? COVER_ALL : COVER_SOME;
}

/* Compares the own face with one other face: returns whether the own face answers for all, some or
 * none of the voxels low..high (inclusive). */
static enum cover other_cover(const struct count *count, uint32_t other, const int32_t low[3],
                              const int32_t high[3])
{
    const double *w = count->face->others[other], limit = count->face->limits[other];
    const struct bounds ratio = linear_bounds(w[0], w[1], w[2], low, high);
    return !(ratio.least < limit) ? COVER_NONE : ratio.most < limit ? COVER_ALL : COVER_SOME;
}

static uint32_t count_others(const struct count *count)
{
    return count->face != NULL && count->world != NULL ? count->face->other_count : 0;
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
    for (uint32_t i = 0; cover != COVER_NONE && i < count_others(count); i++) {
        const enum cover other = other_cover(count, i, cube->low, high);
        cover = other < cover ? other : cover;
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

/* Removes the texels of a brick for which another face answers. */
static void other_masks(const struct count *count, uint32_t other, const struct cube *brick,
                        uint64_t inside[8])
{
    const double *w = count->face->others[other], limit = count->face->limits[other];
    uint64_t own = 0;
    for (int32_t i = 0; i < 64; i++) {
        const double ratio = linear(w[0], w[1], w[2], brick->low[0] + i % 8, brick->low[1] + i / 8);
        own |= (uint64_t)(ratio < limit) << i;
    }
    for (int32_t z = 0; z < 8; z++) {
        inside[z] &= own;
    }
}

/* Removes the voxels of a face whose centre is outside a slab of the world box. */
static void face_slab_masks(const struct count *count, unsigned axis, const struct cube *brick,
                            uint64_t inside[8])
{
    const double min = count->world->min[axis], max = count->world->max[axis];
    double across[64];
    for (int32_t i = 0; i < 64; i++) {
        across[i] = linear(count->face->direction[axis], count->step[0][axis], count->step[1][axis],
                           brick->low[0] + i % 8, brick->low[1] + i / 8);
    }
    for (int32_t z = 0; z < 8; z++) {
        uint64_t bits = 0;
        for (int32_t i = 0; inside[z] != 0 && i < 64; i++) {
            const double w = face_centre(count, axis, across[i], brick->low[2] + z);
            bits |= (uint64_t)(w >= min && w < max) << i;
        }
        inside[z] &= bits;
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

/* Counts a brick that the surface of the box cuts. In: masks: NULL for a uniform cube of a brick's
 * size. */
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
            (count->face != NULL ? face_slab_masks : slab_masks)(count, axis, brick, inside);
        }
    }
    for (uint32_t i = 0; i < count_others(count); i++) {
        if (other_cover(count, i, brick->low, last) == COVER_SOME) {
            other_masks(count, i, brick, inside);
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

/* Counts a uniform cube. A cube that the surface of the box cuts is halved, down to bricks. */
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

/* Starts a box. */
static void begin_box(struct count *count, struct umb_box_answer *answer)
{
    count->answer = answer;
    count->steps = 0;
    count->given_up = false;
    count->next_question = count->watch ? UMB_BOX_STEPS : count->most;
    *answer = (struct umb_box_answer){0};
}

/* Ends a box. Fails: E_LIMIT (it took too many steps, and there is no watch). */
static enum umb_status end_box(const struct count *count, size_t box, struct umb_error *error)
{
    if (!count->given_up) {
        return UMB_OK;
    }
    *count->answer = (struct umb_box_answer){0, UINT64_MAX};
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

/* Returns a range of voxels that contains every voxel whose centre is in a world box: the voxels
 * between the box's corners, and one more on each side because both transforms round. */
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

/* Sets up the voxels of a face: job->step has the vectors of a texel where W = 1. */
static void set_face(const struct umb__volume *v, uint32_t number, struct face *face,
                     struct count *job)
{
    const struct umb_frustum_info *info = &v->faces[number];
    const double(*m)[4] = info->world_to_voxel;
    double axis[3] = {m[3][0], m[3][1], m[3][2]};
    memcpy(job->step, info->voxel_step, sizeof job->step);
    *face = (struct face){.scale = 0};
    memcpy(face->position, v->position, sizeof face->position);
    umb__face_depth(info, &face->scale, &face->offset);
    umb__scale(1 / umb__dot(axis, axis), axis); /* now W = 1 on it */
    const double x = umb__dot(m[0], axis), y = umb__dot(m[1], axis);
    for (unsigned k = 0; k < 3; k++) {
        face->direction[k] = axis[k] - x * job->step[0][k] - y * job->step[1][k];
    }
    for (uint32_t i = 0; i < v->face_count; i++) {
        const double *w = v->faces[i].world_to_voxel[3];
        if (i != number) { /* Of equal ones the first answers */
            face->limits[face->other_count] = i < number ? 1 : nextafter(1, 2);
            double *other = face->others[face->other_count++];
            other[0] = umb__dot(w, face->direction);
            other[1] = umb__dot(w, job->step[0]);
            other[2] = umb__dot(w, job->step[1]);
        }
    }
    job->face = face;
}

/* Returns a range of a face's voxels that contains every voxel whose centre is in a world box, with
 * room for rounding. The box's corners give the range, unless some are behind the light. */
static struct range face_range(const struct umb__volume *v, uint32_t number,
                               const struct umb_box *box)
{
    const struct umb_frustum_info *info = &v->faces[number];
    const double(*m)[4] = info->world_to_voxel, size = (double)((uint32_t)1 << info->log2_size);
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    const double first_w = umb__face_first_w(info);
    double scale, offset;
    umb__face_depth(info, &scale, &offset);
    for (unsigned c = 0; c < 8; c++) {
        double p[3];
        for (unsigned k = 0; k < 3; k++) {
            p[k] = (c >> k & 1 ? box->max[k] : box->min[k]) - v->origin[k];
        }
        const double w = umb__affine(m[3], p);
        for (unsigned k = 0; k < 3; k++) {
            const double at = umb__affine(m[k], p) / (k < 2 ? w : 1);
            const bool known = (k == 2 || w >= first_w) && isfinite(at);
            low[k] = known ? fmin(low[k], at) : -INFINITY;
            high[k] = known ? fmax(high[k], at) : INFINITY;
        }
    }
    struct range range;
    /* Voxels with a centre at the light or behind it do not count. */
    low[2] = fmax(low[2], -offset / scale + 0.5);
    for (unsigned k = 0; k < 3; k++) {
        range.low[k] = clamp(floor(low[k]) - 1, (int32_t)size);
        range.high[k] = clamp(floor(high[k]) + 2, (int32_t)size);
    }
    while (range.low[2] < range.high[2] && !(scale * (range.low[2] + 0.5) + offset > 0)) {
        range.low[2]++; /* At most the two voxels of room */
    }
    return range;
}

/* Counts the voxels of a box in all faces of a lamp. */
static void count_faces(const struct umb__volume *v, struct count *job)
{
    for (uint32_t i = 0; i < v->face_count && !job->given_up; i++) {
        const struct umb__tree tree = umb__volume_tree(v, i);
        struct face face;
        job->tree = &tree;
        set_face(v, i, &face, job);
        job->range = face_range(v, i, job->world);
        count_range(job);
    }
    job->tree = &v->tree;
    job->face = NULL;
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
        begin_box(&job, &answers->boxes[i]);
        job.world = &boxes[i];
        if (v.face_count > 0) {
            count_faces(&v, &job);
        } else {
            job.range = range_around(&v, &boxes[i]);
            count_range(&job);
        }
        status = end_box(&job, i, error);
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
        begin_box(&job, &answers->boxes[i]);
        count_range(&job);
        status = end_box(&job, i, error);
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

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Segments, columns and boxes against rays: each answer about points or voxels is compared with
 * rays there (verify.h). Undefined voxels inside closed solids are left out, as for points.
 */
#include "rays/verify_block.h"

#include <math.h>
#include <string.h>

#include "base/vec.h"

enum {
    KEPT = 64,           /* most intervals of a segment that are read */
    SAMPLES = 4,         /* samples of each segment */
    NEAR_VOXELS = 2,     /* greatest distance from an interval's end */
    TRIES_A_RECORD = 64, /* draws for each record before giving up */
    BOX_VOXELS = 5,      /* longest side */
    BOX_ROOM = (BOX_VOXELS + 2) * (BOX_VOXELS + 2) * (BOX_VOXELS + 2),
    LAMP_BOX_SHARE = 2, /* factor on a lamp's boxes, whose voxels are slanted */
    OFFSETS = 5,        /* rays along each axis of the grid around a column, half a texel apart */
};

/* Draws a point in voxel space: at a boundary if one of `tries` finds one, else anywhere. */
static void draw_voxel(struct umbr_verify_block *block, uint64_t tries, uint64_t *walks,
                       double voxel[3])
{
    for (; tries > 0 && *walks > 0; tries--) {
        if (umbr_verify_boundary(block, walks, voxel)) {
            return;
        }
    }
    umbr_draw_anywhere(block, voxel);
}

/* Draws the ends of a segment around a voxel, in any direction. The logarithm of the length is
 * uniform, so short and long segments are equally likely. */
static int draw_segment(struct umbr_verify_block *block, const double voxel[3], double ends[2][3])
{
    double direction[3], square = 0, along;
    do {
        square = 0;
        for (int k = 0; k < 3; k++) {
            direction[k] = 2 * umbr_next_unit(block) - 1;
            square += direction[k] * direction[k];
        }
    } while (square > 1 || square < 0.01);
    along = umbr_next_unit(block);
    const double length =
        exp2(log2(block->light_frame->size) * umbr_next_unit(block)) / sqrt(square);
    for (int e = 0; e < 2; e++) {
        double end[3];
        for (int k = 0; k < 3; k++) {
            end[k] = voxel[k] + (e - along) * length * direction[k];
            /* Clips to the frustum, axis by axis: the direction may change. */
            end[k] = fmin(fmax(end[k], 0), block->light_frame->size);
        }
        if (!umbr_light_frame_local(block->light_frame, end, ends[e])) {
            return 0;
        }
    }
    return 1;
}

static uint8_t is_lit_at(const struct umb_interval *intervals, size_t count, double t)
{
    for (size_t i = 0; i < count; i++) {
        if (t >= intervals[i].begin && t < intervals[i].end) {
            return 1;
        }
    }
    return 0;
}

/* Draws a parameter of a segment. Every second parameter lies next to the end of an interval, if
 * there is an interval. In: which: number of the draw. voxels: length of the segment. */
static double draw_parameter(struct umbr_verify_block *block, const struct umb_interval *intervals,
                             size_t count, int which, double voxels)
{
    if (which % 2 == 0 || count == 0 || !(voxels > 0)) {
        return umbr_next_unit(block);
    }
    const uint64_t pick = umbr_next_random(block) % (2 * count);
    const double end = pick % 2 ? intervals[pick / 2].end : intervals[pick / 2].begin;
    return end + (2 * umbr_next_unit(block) - 1) * NEAR_VOXELS / voxels;
}

static void judge_segment(struct umbr_verify_block *block, const double ends[2][3])
{
    struct umb_interval intervals[KEPT];
    struct umb_segment_answer answer;
    struct umb_segment_answers answers = {
        .segments = &answer, .intervals = intervals, .interval_max = KEPT};
    const double *o = block->job->origin;
    const struct umb_segments segment = {
        .ends = ends, .format = UMB_POINT_F64, .origin = {o[0], o[1], o[2]}, .count = 1};
    struct umbr_sample samples[SAMPLES];
    uint8_t lit[SAMPLES];
    double from[3], to[3], voxels = 0;
    size_t count = 0;
    umb_volume_segments(&block->job->volume, &segment, 0, 1, &answers);
    block->result.records++;
    const size_t kept = answer.interval_count < KEPT ? (size_t)answer.interval_count : KEPT;
    const double known = answer.interval_count > KEPT ? intervals[KEPT - 1].end : 1;
    if (umbr_light_frame_voxel(block->light_frame, ends[0], from) &&
        umbr_light_frame_voxel(block->light_frame, ends[1], to)) {
        voxels = hypot(hypot(to[0] - from[0], to[1] - from[1]), to[2] - from[2]);
    }
    for (int i = 0; i < SAMPLES; i++) {
        struct umbr_sample *sample = &samples[count];
        const double t = draw_parameter(block, intervals, kept, i, voxels);
        double local[3];
        for (int k = 0; k < 3; k++) {
            local[k] = ends[0][k] + t * (ends[1][k] - ends[0][k]);
        }
        if (t >= 0 && t < known &&
            umbr_light_frame_voxel(block->light_frame, local, sample->voxel) &&
            umbr_verify_place(block, sample)) {
            lit[count++] = is_lit_at(intervals, kept, t);
        }
    }
    (void)umbr_verify_judge_answers(block, samples, lit, count);
}

void umbr_verify_segments(struct umbr_verify_block *block, uint64_t count)
{
    uint64_t walks = count * TRIES_A_RECORD;
    for (uint64_t i = 0; i < count; i++) {
        double voxel[3], ends[2][3];
        draw_voxel(block, i % 2 == 0 ? UINT64_MAX : 0, &walks, voxel);
        if (draw_segment(block, voxel, ends)) {
            judge_segment(block, (const double(*)[3])ends);
        }
    }
}

/* Computes the depth in voxels of the first hit of the light ray through (x, y). Without a hit the
 * depth is beyond the frustum's last voxel. Returns the metres of a voxel along the ray; 0 if the
 * ray leaves the frustum. */
static double traced_depth(const struct umbr_verify_block *block, double x, double y, double *depth)
{
    const double size = block->light_frame->size;
    struct umbr_exact_ray ray;
    struct umbr_exact_hit hit;
    double z_first;
    if (!umbr_verify_column(block, x, y, &ray, &z_first)) {
        return 0;
    }
    umbr_verify_nearest(block, &ray, &hit);
    const double step_m = ray.far_m / (size - z_first); /* linear along a column */
    *depth = hit.distance < 0 ? 2 * size : z_first + hit.distance / step_m;
    return step_m;
}

/* Number of voxels whose centre lies before a depth. */
static double lit_before(const struct umbr_verify_block *block, double depth)
{
    return fmin(fmax(ceil(depth - 0.5), 0), block->light_frame->size);
}

/*
 * Returns 1 if `lit`, a number of lit voxels, lies within one voxel of those that rays find within
 * one texel. The rays lie on a grid and on rings around the centre, since a rod may be thinner than
 * the grid and its edge may run through the centre.
 */
static int is_near_column(const struct umbr_verify_block *block, const double texel[2], double lit)
{
    double least = INFINITY, most = -INFINITY;
    for (int i = 0; i < OFFSETS * OFFSETS + UMBR_RING_PLACES; i++) {
        const int on_ring = i - OFFSETS * OFFSETS;
        double offset[2] = {0.5 * (i % OFFSETS) - 1, 0.5 * (i / OFFSETS) - 1};
        double depth;
        if (on_ring >= 0) {
            umbr_ring_offset(on_ring, offset);
        }
        if (traced_depth(block, texel[0] + offset[0], texel[1] + offset[1], &depth) > 0) {
            least = fmin(least, lit_before(block, depth));
            most = fmax(most, lit_before(block, depth));
        }
    }
    return lit >= least - 1 && lit <= most + 1;
}

static enum umbr_verdict column_verdict(const struct umbr_verify_block *block,
                                        const double voxel[3],
                                        const struct umb_column_answer *answer)
{
    double depth;
    const double step_m = traced_depth(block, voxel[0], voxel[1], &depth);
    const double lit = (double)answer->lit;
    const int none = lit >= block->light_frame->size;
    if (answer->outside || none != isinf(answer->distance_m)) {
        return UMBR_WRONG; /* the texel is the frustum's own */
    }
    if (lit != lit_before(block, depth)) {
        return is_near_column(block, voxel, lit) ? UMBR_IN_BAND : UMBR_WRONG;
    }
    /* The occluder is half a voxel off at most; rays have float errors. */
    return none || fabs(answer->distance_m - (depth - voxel[2]) * step_m) <= 0.51 * step_m
               ? UMBR_AGREES
               : UMBR_WRONG;
}

static void judge_column(struct umbr_verify_block *block, const double texel[2], double z)
{
    struct umbr_sample sample = {.voxel = {texel[0], texel[1], z}};
    struct umb_column_answer answer;
    struct umb_column_answers answers = {.columns = &answer};
    const double *o = block->job->origin;
    const struct umb_points point = {.positions = sample.local,
                                     .format = UMB_POINT_F64,
                                     .origin = {o[0], o[1], o[2]},
                                     .count = 1};
    if (!umbr_verify_place(block, &sample)) { /* a column belongs to one face from end to end */
        return;
    }
    umb_volume_columns(&block->job->volume, &point, 0, 1, &answers);
    block->result.records++;
    enum umbr_verdict verdict = column_verdict(block, sample.voxel, &answer);
    if (verdict == UMBR_WRONG && umbr_verify_look_again(block)) {
        verdict = column_verdict(block, sample.voxel, &answer);
        block->exact = NULL;
    }
    (void)umbr_verify_count(block, verdict, sample.local);
}

void umbr_verify_columns(struct umbr_verify_block *block, uint64_t count)
{
    const double size = block->light_frame->size;
    for (uint64_t i = 0; i < count; i++) {
        double texel[2];
        for (int k = 0; k < 2; k++) {
            texel[k] = floor(umbr_next_unit(block) * size) + 0.5;
        }
        judge_column(block, texel, umbr_next_unit(block) * size);
    }
}

/* Lists the voxels of the block's frustum whose centres a box may hold. Returns their number. */
static size_t list_voxels(const struct umbr_verify_block *block, const struct umb_box *box,
                          const double middle[3], struct umbr_sample samples[BOX_ROOM])
{
    size_t count = 0;
    for (int i = 0; i < BOX_ROOM; i++) {
        const int side = BOX_VOXELS + 2, half = side / 2;
        const int step[3] = {i % side - half, i / side % side - half, i / (side * side) - half};
        struct umbr_sample *sample = &samples[count];
        for (int k = 0; k < 3; k++) {
            sample->voxel[k] = floor(middle[k]) + step[k] + 0.5;
        }
        int inside = umbr_verify_place(block, sample);
        for (int k = 0; inside && k < 3; k++) {
            const double centre = sample->centre[k] + block->job->origin[k];
            inside = centre >= box->min[k] && centre < box->max[k];
        }
        count += (size_t)inside;
    }
    return count;
}

static enum umbr_verdict box_verdict(const struct umbr_verify_block *block,
                                     const struct umb_box_answer *answer,
                                     const struct umbr_sample *samples, size_t count)
{
    uint8_t truths[BOX_ROOM], burieds[BOX_ROOM];
    uint64_t lit = 0, buried = 0, unsure = 0, sure = 0;
    for (size_t i = 0; i < count; i++) {
        int is_buried;
        truths[i] = (uint8_t)umbr_verify_trace(block, samples[i].local, &is_buried);
        burieds[i] = (uint8_t)is_buried;
        lit += truths[i];
        buried += burieds[i];
    }
    if (count > 0 && buried == count) {
        return UMBR_SAYS_NOTHING;
    }
    if (answer->voxels == count && answer->lit >= lit && answer->lit <= lit + buried) {
        return UMBR_AGREES;
    }
    for (size_t i = 0; i < count; i++) {
        const int either = burieds[i] || umbr_verify_is_unsure(block, &samples[i], truths[i]);
        unsure += (uint64_t)either;
        sure += (uint64_t)(truths[i] && !either);
    }
    return answer->voxels == count && answer->lit >= sure && answer->lit <= sure + unsure
               ? UMBR_IN_BAND
               : UMBR_WRONG;
}

static void judge_box(struct umbr_verify_block *block, const struct umb_box *box,
                      const struct umbr_sample *samples, size_t count)
{
    struct umb_box_answer answer;
    struct umb_box_answers answers = {.boxes = &answer};
    double corner[3];
    const enum umb_status status =
        umb_volume_boxes(&block->job->volume, box, 0, 1, NULL, &answers, NULL);
    block->result.records++;
    enum umbr_verdict verdict =
        status == UMB_OK ? box_verdict(block, &answer, samples, count) : UMBR_WRONG;
    if (verdict == UMBR_WRONG && umbr_verify_look_again(block)) {
        verdict = box_verdict(block, &answer, samples, count);
        block->exact = NULL;
    }
    umb__subtract(box->min, block->job->origin, corner);
    (void)umbr_verify_count(block, verdict, corner);
}

/* Returns the edge in metres of a box around `middle` that reaches over one voxel at most. A lamp's
 * voxels are seen at an angle, up to 55 degrees, and grow within the box. */
static double least_edge(const struct umbr_verify_block *block, const double middle[3],
                         const double world[3])
{
    const struct umbr_light_frame *frame = block->light_frame;
    double edge = INFINITY, next[3];
    for (int axis = 0; axis < 3; axis++) {
        double at[3] = {middle[0], middle[1], middle[2]};
        at[axis] += 1;
        if (frame->parallel) {
            edge = fmin(edge, umb__length(frame->step[axis]));
        } else if (umbr_light_frame_world(frame, at, next)) {
            umb__subtract(next, world, next);
            edge = fmin(edge, umb__length(next) / LAMP_BOX_SHARE);
        }
    }
    return edge;
}

/* Returns whether the block's face answers for a whole box, so that no other face has voxels in it.
 * Distances along the axes are linear, so the corners tell. */
static int is_own(const struct umbr_verify_block *block, const struct umb_box *box)
{
    const struct umbr_verify_job *job = block->job;
    int own = 1;
    for (int c = 0; c < 8 && !block->light_frame->parallel; c++) {
        double local[3];
        for (int k = 0; k < 3; k++) {
            local[k] = (c >> k & 1 ? box->max[k] : box->min[k]) - job->origin[k];
        }
        const double w = umbr_light_frame_w(block->light_frame, local);
        for (uint32_t i = 0; i < job->light.frustum_count; i++) {
            own &= &job->frames[i] == block->light_frame ||
                   umbr_light_frame_w(&job->frames[i], local) < w;
        }
    }
    return own;
}

void umbr_verify_boxes(struct umbr_verify_block *block, uint64_t count)
{
    uint64_t walks = count * TRIES_A_RECORD;
    for (uint64_t i = 0; i < count; i++) {
        struct umbr_sample samples[BOX_ROOM];
        struct umb_box box;
        double middle[3], world[3];
        draw_voxel(block, i % 2 == 0, &walks, middle);
        if (!umbr_light_frame_world(block->light_frame, middle, world)) {
            continue;
        }
        const double edge = least_edge(block, middle, world);
        /* No extent of the box in voxels is longer than the diagonal. */
        for (int k = 0; k < 3; k++) {
            const double side = umbr_next_unit(block) * BOX_VOXELS * edge / sqrt(3);
            box.min[k] = world[k] - 0.5 * side;
            box.max[k] = world[k] + 0.5 * side;
        }
        if (is_own(block, &box)) {
            judge_box(block, &box, samples, list_voxels(block, &box, middle, samples));
        }
    }
}

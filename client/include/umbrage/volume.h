/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_VOLUME_H
#define UMBRAGE_VOLUME_H
/*
 * Volume queries, about the space between surfaces: which intervals of a segment a light reaches
 * (light shafts, fog integrals, lines of sight to a sun), how deep the first occluder of a column
 * lies, and which share of a box is lit.
 *
 *     struct umb_volume volume;
 *     if (umb_volume_prepare(asset, light, &volume, &error) ||  // once
 *         umb_segments_check(&segments, &error)) {              // checks the batch
 *         return error.status;
 *     }
 *     umb_volume_segments(&volume, &segments, 0, segments.count, &answers);  // cannot fail
 *
 * All answers are exact for the voxels that the asset stores: they equal a march through every
 * single voxel. There is no filter and no bias; the caller must move a segment that starts at a
 * surface off that surface. Translucent casters (effect `transmittance`) are not voxels and are
 * ignored; see umb_volume_ignores_translucent.
 *
 * Closed assets (the frustum's `closed`): voxels inside closed solids are undefined and stored as
 * lit or shadowed, whichever made the file smaller. Segments and boxes outside solids are exact;
 * inside, answers are those of the stored voxels. A column's first occluder needs the depth of
 * front faces, which such an asset holds only with the effect `front`; without it
 * umb_volume_check_columns fails.
 *
 * Outside, as for points: beyond the frustum in x or y and before z = 0 space is lit; behind the
 * last voxel it continues the last voxel.
 *
 * Lamps (spot, point and area lights): as for points, the frustum (face) that covers a place
 * answers for that part of a segment, for that column, or for the voxel with its centre there. To
 * which side an area light shines is left to the caller.
 *
 * Precision: ends become voxel coordinates in doubles. The parameter at which a line crosses the
 * boundary of a voxel is right to some 4 units in the last place (2^-50). Answers are bit-equal for
 * every batch size, split, thread count and machine.
 * Threads: a prepared volume is immutable; any number of threads may run it on disjoint ranges.
 * Cost: no allocation, no I/O, no failure while running. Uniform space is crossed in one step.
 * Stability: stable; umbrage/version.h says what that means.
 */
#include <stddef.h>
#include <stdint.h>
#include "umbrage/asset.h"
#include "umbrage/query.h"
#include "umbrage/status.h"

#ifdef __cplusplus
extern "C" {
#endif

/* A light prepared for volume queries, filled by umb_volume_prepare. The caller's storage; it may
 * be copied. */
struct umb_volume {
    uint64_t opaque[48];
};

/* Counts of runs; zero them before the first. */
struct umb_volume_stats {
    uint64_t nodes;       /* Grid cells and nodes read */
    uint64_t bricks;      /* Bricks read */
    uint64_t reserved[2]; /* Zero: room for later versions (umbrage/version.h) */
};

/*
 * Prepares a light of an asset for volume queries.
 *
 * In:    asset: borrowed as long as the volume is used. light: index in the asset.
 * Out:   volume: zeroed on failure, and then must not be run.
 * Fails: E_NOT_FOUND (light), E_UNSUPPORTED (an asset baked under the static rule; a spot or point
 *        light whose depth does not grow with the distance, which no bake makes).
 * Threads: any.
 * Cost:  O(1), no allocation.
 */
UMB_API UMB_CHECKED enum umb_status umb_volume_prepare(const struct umb_asset *asset,
                                                       uint32_t light, struct umb_volume *volume,
                                                       struct umb_error *error);

/* Checks that all voxels have the same size, so that shares of voxels are shares of space. Fails:
 * E_UNSUPPORTED (a lamp). */
UMB_API UMB_CHECKED enum umb_status umb_volume_check_parallel(const struct umb_volume *volume,
                                                              struct umb_error *error);

/* Returns 1 if the light has translucent casters, which volume queries ignore; else 0. */
UMB_API int umb_volume_ignores_translucent(const struct umb_volume *volume);

/* A batch of segments; borrowed while it runs. */
struct umb_segments {
    const void *ends; /* scalar[6*count], x0 y0 z0 x1 y1 z1 a segment, metres, world space minus
                         origin, little-endian, any alignment, finite */
    enum umb_point_format format;
    double origin[3]; /* Origin added to every end, metres, world space; finite */
    size_t count;
    uint64_t reserved[4]; /* Zero: room for later versions (umbrage/version.h) */
};

/* A lit interval: parameters of the segment, 0 at its start and 1 at its end; begin < end. */
struct umb_interval {
    double begin, end;
};

struct umb_segment_answer {
    double lit;              /* Share of the segment that is lit, 0..1: the sum of its intervals */
    double lit_m;            /* Length of the lit intervals, metres */
    uint64_t interval_count; /* Number of lit intervals, with those beyond interval_max */
};

struct umb_segment_answers {
    struct umb_segment_answer *segments; /* [count], indexed like the segments */
    struct umb_interval *intervals;      /* [count * interval_max] Intervals; those of segment i
                                            begin at i * interval_max. NULL if interval_max is 0 */
    size_t interval_max;                 /* Most intervals to store of each segment; further ones
                                            only count and add to `lit` */
    struct umb_volume_stats stats;       /* Counts, added to */
    uint64_t reserved[2];                /* Zero: room for later versions (umbrage/version.h) */
};

/* Checks that segments may be run: every number must be finite. Fails: E_ARGUMENT, naming the first
 * bad one. Cost: one pass, no allocation. */
UMB_API UMB_CHECKED enum umb_status umb_segments_check(const struct umb_segments *segments,
                                                       struct umb_error *error);

/*
 * Finds the lit intervals of segments first .. first + count - 1.
 *
 * An interval is half open and as long as possible. It begins and ends where the segment enters a
 * voxel of the other state, or at 0 and 1. A segment without length has the state of its point: its
 * `lit` is 1 or 0. On an axis along which the segment runs from `start` over d voxels, it crosses
 * plane k at the parameter (k - start) * (1 / d), evaluated in doubles; at that parameter it is in
 * the voxel behind the plane. If d is 0, or so small that 1 / d is infinite, it stays in
 * floor(start).
 *
 * Under a spot or point light a segment is cut where it passes from one face to another. Let Wf be
 * the distance from the light along the axis of face f, which is linear in the parameter, from W0f
 * to W1f. Face g, whose Wg grows faster, takes over from face f at the parameter (W0f - W0g) /
 * ((W1g - W0g) - (W1f - W0f)). Before the near plane of a face the segment is lit. Consider the
 * piece of one face from t = a to t = b, along which W goes from Wa to Wb. In voxel space it
 * crosses plane k of x or y at the share s = (k - start) * (1 / d) of its length, as above, and
 * plane k of z at s = (1 / Wa - 1 / Wk) * (1 / (1 / Wa - 1 / Wb)). The parameter there is t = a +
 * (b - a) s Wa / (Wb - s (Wb - Wa)), or a + (b - a) s if Wa = Wb, and at most b. Wk is W at plane
 * k: Wk = c k + (w3 - c z3) with c = w.w / w.z, where (z, z3) and (w, w3) are the third and fourth
 * row of the frustum's transform. An interval that rounding makes empty is left out.
 *
 * Not guaranteed: a batch that umb_segments_check refuses is answered safely, but its answers are
 * meaningless. A segment whose voxel coordinates overflow a double is lit.
 * Threads: disjoint ranges at once, each with its own struct umb_segment_answers and stats.
 * Cost:  a few node reads for each uniform cube and brick that the segment passes; at most
 *        3 << log2_size steps a segment.
 * Source: Amanatides and Woo 1987 (voxel traversal), with the octree's empty-space skipping.
 */
UMB_API void umb_volume_segments(const struct umb_volume *volume,
                                 const struct umb_segments *segments, size_t first, size_t count,
                                 struct umb_segment_answers *answers);

struct umb_column_answer {
    uint32_t lit;     /* Number of voxels before the first shadowed one; 1 << log2_size if all are
                         lit. The first occluder lies within half a voxel of this depth */
    uint32_t outside; /* 1: the column is beyond the frustum in x or y, and lit to its end */
    /* Distance in metres from the point along the light's direction to depth `lit`. It is negative
     * if the occluder lies between light and point, and infinite without an occluder. */
    double distance_m;
};

struct umb_column_answers {
    struct umb_column_answer *columns; /* [count], indexed like the points */
    struct umb_volume_stats stats;     /* Counts, added to */
    uint64_t reserved[2];              /* Zero: room for later versions (umbrage/version.h) */
};

/* Checks that the first shadowed voxel of a column is its first occluder. Fails: E_UNSUPPORTED (a
 * frustum baked under the closed rule without the effect `front`). */
UMB_API UMB_CHECKED enum umb_status umb_volume_check_columns(const struct umb_volume *volume,
                                                             struct umb_error *error);

/*
 * Finds the first occluder in the columns of voxels that points first .. first + count - 1 lie in.
 *
 * In:    points: checked by umb_points_check; their normals are ignored.
 * Out:   distance_m is right to half a voxel's depth for the light ray through the texel's centre.
 *        Spot and point lights: columns are those of the face that covers the point, and distances
 *        are along the ray from the light through the point.
 * Not guaranteed: in a volume that umb_volume_check_columns refuses, `lit` is the first voxel
 *        stored as shadowed: never before the first occluder, possibly behind it.
 * Threads: as umb_volume_segments.
 */
UMB_API void umb_volume_columns(const struct umb_volume *volume, const struct umb_points *points,
                                size_t first, size_t count, struct umb_column_answers *answers);

/* Voxels min <= v < max on each axis. */
struct umb_voxel_box {
    int64_t min[3], max[3];
};

struct umb_box_answer {
    uint64_t lit;    /* Number of lit voxels among `voxels` */
    uint64_t voxels; /* Number of voxels inside the box and the frustum */
};

struct umb_box_answers {
    struct umb_box_answer *boxes;  /* [count], indexed like the boxes */
    struct umb_volume_stats stats; /* Counts, added to */
    uint64_t reserved[2];          /* Zero: room for later versions (umbrage/version.h) */
};

#define UMB_BOX_STEPS 65536 /* Steps between two calls of go_on: a few milliseconds at most */

/*
 * Number of steps that a box without a watch may take for each column of bricks of the frustum.
 *
 * A frustum has (size / 8)^2 such columns, so a box may take 2^32 steps at 16384 voxels a side. The
 * faces of a box take at most 6 * 64 of a column's 1024 steps; 640 remain for bricks and nodes
 * inside. No box in an asset of up to 4096 voxels a side takes more. At 16384 a box of the whole
 * frustum takes more if 30 % of the bricks hold both lit and shadowed voxels.
 */
#define UMB_BOX_COLUMN_STEPS 1024

/*
 * Callback during long boxes, for callers that bound the time of one. A step is a node, a cell or a
 * brick inside the box; a brick that the box's faces cut counts as 64. Steps are the same on all
 * machines.
 */
struct umb_box_watch {
    /* Called after every UMB_BOX_STEPS steps of a box, with the box's steps so far; the box's
     * answer then holds the counts so far. Returns 0 to give up the box: `voxels` of its answer
     * becomes UINT64_MAX. */
    int (*go_on)(void *user, uint64_t steps);
    void *user; /* First argument of go_on */
};

/* Makes boxes from pairs first .. first + count - 1 of opposite corners, in either order on each
 * axis. Out: boxes: [count]. */
UMB_API void umb_boxes_from_corners(const struct umb_segments *corners, size_t first, size_t count,
                                    struct umb_box *boxes);

/* Checks boxes: finite, min <= max. Fails: E_ARGUMENT, naming the first bad number. */
UMB_API UMB_CHECKED enum umb_status umb_boxes_check(const struct umb_box *boxes, size_t count,
                                                    struct umb_error *error);

/*
 * Counts the lit voxels of boxes in world space.
 *
 * Lamps: voxels grow with the distance W along the axis, so a share of voxels is no share of space
 * where a box is deep: a voxel has W^2 times the space of one at W = 1. A voxel counts in the face
 * that answers for its centre, the first of equals; those at the light or behind it do not count. A
 * coordinate of its centre is (W ((d + (x + 1/2) ex) + (y + 1/2) ey) + p) + origin, in doubles and
 * in this order. W is c (z + 1/2) + o, with c and o of umb_volume_segments. d is a - (m0.a) ex -
 * (m1.a) ey, where a is the last row of the transform divided by its square, and p is the light's
 * position minus the asset's origin. The following is about directional lights; the rest holds for
 * all.
 *
 * In:    watch: NULL: each box has the limit of UMB_BOX_COLUMN_STEPS. boxes: [first + count],
 *        metres, world space. A voxel is in the box if its centre is, min <= centre < max, so that
 *        boxes side by side share no voxel and leave none out. Voxels outside the frustum do not
 *        count. The centre of voxel (x, y, z) is (((o + (x + 1/2) ex) + (y + 1/2) ey) + (z + 1/2)
 *        ez) + origin, in doubles and in this order: ex, ey, ez are the frustum's voxel_step, o =
 *        -(m0 ex) - m1 ey - m2 ez with the last column m of world_to_voxel, origin is the asset's.
 * Fails: E_LIMIT (only without a watch: a box takes too many steps; it and those behind it have no
 *        answers).
 * Not guaranteed: as umb_volume_segments, for boxes that umb_boxes_check refuses.
 * Threads: as umb_volume_segments.
 * Cost:  linear in the nodes and bricks inside the box, each as often as the tree shares it, and in
 *        the voxels its faces cut. A small file of untrusted bytes may share one node so often that
 *        a large box takes hours: a service must limit a box's steps by a watch.
 */
UMB_API UMB_CHECKED enum umb_status
umb_volume_boxes(const struct umb_volume *volume, const struct umb_box *boxes, size_t first,
                 size_t count, const struct umb_box_watch *watch, struct umb_box_answers *answers,
                 struct umb_error *error);

/* Counts the lit voxels of boxes given in voxels of the light's first frustum, as umb_volume_boxes
 * does for world space. A box with min >= max on an axis is empty. */
UMB_API UMB_CHECKED enum umb_status
umb_volume_voxel_boxes(const struct umb_volume *volume, const struct umb_voxel_box *boxes,
                       size_t first, size_t count, const struct umb_box_watch *watch,
                       struct umb_box_answers *answers, struct umb_error *error);

#ifdef __cplusplus
}
#endif
#endif

/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_QUERY_H
#define UMBRAGE_QUERY_H
/*
 * Queries: how much of a light reaches each of a batch of points.
 *
 *     const struct umb_query_settings settings = {.light = 0, .taps = 9};
 *     struct umb_query query;
 *     if (umb_query_prepare(asset, &settings, &query, &error) ||  // checks the settings, once
 *         umb_points_check(&points, &error)) {                    // checks the batch
 *         return error.status;
 *     }
 *     umb_query_run(&query, &points, 0, points.count, &answers);  // cannot fail
 *
 * Answers are the fraction of an n x n window of texels, at the depth of the point's voxel, from
 * which the light is visible: 0 shadowed, 1 lit (percentage closer filtering; Sintorn et al. 2014,
 * section 5). n = 1 is a single voxel look-up. Inside closed solids of assets baked under the
 * closed rule an answer is unspecified ("defined space", docs/explained/accuracy.md).
 *
 * Lamps (spot, point and area lights): an answer says whether an occluder stands between the point
 * and the light. The caller computes how the light fades with distance and towards its cone. Points
 * that no frustum of a spot light covers are lit and counted as outside. An area light shines to
 * one side: points behind its plane are shadowed and counted as facing away.
 *
 * Outside: a texel beyond the frustum in x or y is lit. A point before z = 0 is lit, and a point
 * behind the last voxel takes the last voxel's answer. struct umb_query_stats counts such points.
 *
 * Static rule: assets baked under it answer for points on surfaces only. Elsewhere an answer is
 * meaningless. A point farther from every surface than the plan's distance is counted as undefined.
 * Beyond the frustum in x or y and before z = 0 nothing casts shadows, so points there are answered
 * and counted as under "Outside". A window that reaches into the frustum counts the texels there.
 *
 * Precision: a point becomes a voxel index in doubles (53 bits; a coordinate of 1e7 m resolves
 * 2e-9 m). The window is counted in integers. Answers are bit-equal for every batch size, split,
 * thread count and instruction set.
 * Threads: a prepared query is immutable; any number of threads may run it on disjoint ranges.
 * Cost: no allocation, no I/O, no failure while running.
 * Stability: stable; umbrage/version.h says what that means.
 */
#include <stddef.h>
#include <stdint.h>
#include "umbrage/asset.h"
#include "umbrage/workers.h"
#include "umbrage/status.h"

#ifdef __cplusplus
extern "C" {
#endif

#define UMB_TAPS_MAX 17  /* widest window, in texels */
#define UMB_BIAS_MAX 1e6 /* longest bias, in voxels or metres */

/* Offset of a point before the look-up, so that a surface does not shadow itself. */
enum umb_bias_mode {
    /* Automatic: the least move that puts the window wholly on the light's side of the surface's
     * plane. That takes s = (taps (|n.ex| + |n.ey|) + |n.ez|) / 2 metres along the normal n, where
     * ex, ey, ez are the world vectors of one voxel. Suns: the point is lifted by s / c metres
     * towards the light, c being the cosine between n and the light, and at most by 2 taps - 1/2
     * texels; where that is too short, the rest is along n. A lift displaces no edge of a shadow.
     * With more than one tap, the lift begins at the plane's depth under the centre of the window,
     * and s has taps - 1 in place of taps. Spot and point lights: s along n, with the voxel size at
     * the point, which grows with the distance from the light. Coarse look-ups: s along n. Without
     * normals: s of the normal (1,1,1)/sqrt(3) in voxels, towards the light. */
    UMB_BIAS_AUTO = 0,
    UMB_BIAS_VOXELS = 1, /* `bias` voxels (mean edge) along the normal, else towards the light */
    UMB_BIAS_METRES = 2, /* `bias` metres along the normal, else towards the light */
    UMB_BIAS_NONE = 3,   /* No offset */
};

/* Weights of the texels of a window. */
enum umb_filter {
    UMB_FILTER_BOX = 0, /* Equal weights */
    /* Weights that fall off linearly on both axes: texel (i, j) from the centre weighs
     * (m - |i|) (m - |j|) with m = (taps + 1) / 2. The answer has no step when the window moves by
     * a texel, and the filter acts half as wide. In `umb_answer_format`, count is then the sum of
     * the lit texels' weights, and m^4 replaces taps * taps. */
    UMB_FILTER_TENT = 1,
    /* Penumbras of a light that has an extent (percentage closer soft shadows). A search in the
     * cone of the light's rays to the point finds the blockers. Their distance gives the width of
     * the penumbra, and a box of that width gives the answer, which is continuous in the width.
     * The least width is `taps` texels, the widest UMB_PENUMBRA_TAPS_MAX. Lamps: the same search
     * with rays that meet in the point, and in place of the box the mean of 233 look-ups at the
     * places where rays to points of the light pass the blockers' mean distance, without a limit of
     * the width; points of the light behind the receiver's horizon are dark. Exact where one layer
     * of blockers is equally far; docs/results/accuracy.md has differences from rays. For lights
     * that have an extent; of assets baked under the closed rule only those with the effect
     * `front`. */
    UMB_FILTER_PENUMBRA = 2,
    /* Mean over a footprint: the square of the receiver's surface around the point that a pixel
     * sees, or that the point gives. A footprint up to `taps` texels wide is the box filter. A
     * wider footprint is interpolated between two levels of detail, with 32 taps in each; each
     * level is twice as wide as the level below. Far points neither sparkle nor switch: the answers
     * of footprints f1 < f2 differ by at most 2 (f2 - f1) / f1. Automatic bias lifts the square
     * towards the light by half its side, so that relief smaller than a pixel casts no shadow. */
    UMB_FILTER_FOOTPRINT = 3,
    /* Weights of a Gaussian with a standard deviation of taps / 6 texels. The weights w(0), w(1),
     * ... are rounded to whole numbers whose sum over a row of the window is 2048. Texel (i, j)
     * from the centre weighs w(|i|) w(|j|). In `umb_answer_format` read 2048^2 for taps * taps.
     * Edges are smoother than a tent's. The answer is within 0.006 of that of the unbounded
     * Gaussian, sampled at the texels. */
    UMB_FILTER_GAUSSIAN = 4,
};

#define UMB_FILTERS 5 /* Number of values of enum umb_filter in this version */

/* Names of the filters, in their order. */
#define UMB_FILTER_NAMES "box|tent|penumbra|footprint|gaussian"

/* What a filter is and takes. Later versions may add fields at the end. */
struct umb_filter_info {
    const char *name;   /* Name in options and reports; "unknown" if there is no such filter */
    int is_window;      /* 1: the filter weighs only the texels of a window of `taps` texels; 0: it
                         reads texels beyond that window */
    int has_curve;      /* 1: accuracy curves are measured with it (umbrage/curve.h) */
    int has_extent;     /* 1: it takes light_extent */
    int has_footprints; /* 1: it takes footprints, and footprint_m beside taps */
};

/* Returns what is known of a filter, for any number: static storage. */
UMB_API const struct umb_filter_info *umb_filter_get_info(enum umb_filter filter);

/* Return the name as a static string: one of UMB_FILTER_NAMES; "auto", "voxels", "metres", "none";
 * "unknown" for any other number. */
UMB_API const char *umb_filter_name(enum umb_filter filter);
UMB_API const char *umb_bias_mode_name(enum umb_bias_mode mode);

#define UMB_FOOTPRINT_MAX       1e6 /* Widest footprint, metres; wider ones count as this wide */
#define UMB_FOOTPRINT_LEVEL_MAX 40  /* Levels of detail above the window */

#define UMB_PENUMBRA_TAPS_MAX 2047 /* Widest penumbra of a sun, texels; wider ones are cut to it */
#define UMB_EXTENT_MAX        1.0  /* Largest extent of a sun, radians: 57.3 degrees */

/* Format of an answer; count is the number of lit texels in the window. */
enum umb_answer_format {
    UMB_ANSWER_F32 = 0, /* float, count / (taps * taps) */
    UMB_ANSWER_U8 = 1,  /* 0..255, round(255 * count / (taps * taps)), ties up */
    UMB_ANSWER_BIT = 2, /* A bit a point, 1 if count * 2 >= taps * taps. Point i is bit i % 8 of
                           byte i / 8; unused bits are 0 */
};

enum umb_point_format {
    UMB_POINT_F32 = 0,
    UMB_POINT_F64 = 1,
};

struct umb_query_settings {
    uint32_t light; /* Index of the light in the asset */
    uint32_t taps;  /* Width of the window in texels: odd, 1..17; 0 means 1 */
    enum umb_bias_mode bias_mode;
    double bias; /* Length of the bias for VOXELS and METRES: finite, 0..1e6 */
    enum umb_answer_format format;
    enum umb_filter filter;
    /* Box and tent: width of the window in metres across the light, instead of taps; it is rounded
     * to an odd number of texels. 0: taps decides. Lamps: box only, up to UMB_FOOTPRINT_MAX, by the
     * size of texels at each point; windows wider than 17 texels have 17. UMB_FILTER_FOOTPRINT:
     * side in metres of the square of surface around each point without a footprint of its own, 0
     * to UMB_FOOTPRINT_MAX; taps is given too. */
    double footprint_m;
    /* Octree level at which look-ups stop. 0: at voxels. Else at cells of 1 << level voxels a side,
     * which answer 0, 1 or, if a boundary runs through the cell, one half. Coarse look-ups read
     * fewer nodes, and may be wrong by the size of a cell (umb_query_bound_m). The level is odd, 3
     * to umb_level_max of the light's frusta; with one tap, without a footprint. The automatic bias
     * is that of two cells. */
    uint32_t level;
    /* Angular diameter of a directional light in radians for UMB_FILTER_PENUMBRA, up to
     * UMB_EXTENT_MAX; 0: the asset's. Lamps have the asset's size. */
    double light_extent;
    /* 1: ignores the translucent casters of assets with the effect `transmittance`. 0: each answer
     * is multiplied by the casters' transmittance, a mean over a box as wide as the window and at
     * least as wide as a texel of the transmittance map (docs/explained/effects.md). */
    int opaque_only;
    /* Eye in world space, metres, and angle of a pixel at the eye, radians, up to 1; for
     * UMB_FILTER_FOOTPRINT instead of footprint_m; 0: none. A point's square then has the area of
     * the surface that a pixel covers: side = pixel_rad * distance / sqrt(c), where c is the cosine
     * between the normal and the direction to the eye, at least 1/16 (1 without a normal). */
    double eye[3], pixel_rad;
    uint64_t reserved[8]; /* Zero: room for later versions (umbrage/version.h) */
};

/*
 * A batch of points; borrowed while a query runs.
 * Receivers whose normal faces away from the light (n.l <= 0) are shadowed without a look-up.
 */
struct umb_points {
    const void *positions; /* scalar[3*count], x y z interleaved, metres, world space minus origin,
                              little-endian, any alignment, finite */
    enum umb_point_format format;
    double origin[3];    /* Origin added to every position, metres, world space; finite */
    const void *normals; /* float[3*count], world space, any length above 0; or NULL. A normal that
                            is zero or not finite counts as no normal for that point. */
    size_t count;
    const void *footprints; /* float[count], metres, 0 and up, any alignment; or NULL. Only
                               UMB_FILTER_FOOTPRINT reads them, and they override footprint_m. */
    uint64_t reserved[4];   /* Zero: room for later versions (umbrage/version.h) */
};

/* Counts of a run; zero them before the first. */
struct umb_query_stats {
    uint64_t points;
    uint64_t outside;     /* Points whose centre is beyond the frustum in x or y: lit there */
    uint64_t before;      /* Points before the first voxel in z: lit */
    uint64_t behind;      /* Points behind the last voxel in z: clamped to it */
    uint64_t facing_away; /* Points shadowed by their normal, or behind an area light's plane */
    uint64_t undefined; /* Points too far from any surface of an asset baked under the static rule:
                         * their answers are meaningless */
    /* Neighbouring points of a run share reads, so the counts of nodes and bricks depend on how a
     * batch is split. The other counts and the answers do not. */
    uint64_t nodes;  /* Cells, columns and nodes read; 1 for a window that the grid alone answers */
    uint64_t bricks; /* Bricks read */
    uint64_t reserved[4]; /* Zero: room for later versions (umbrage/version.h) */
};

/* Adds the counts of one run to a total, for programs that split a batch themselves. */
UMB_API void umb_query_stats_add(struct umb_query_stats *to, const struct umb_query_stats *from);

struct umb_answers {
    void *values; /* float[count], uint8[count] or uint8[(count + 7) / 8], by format. A run on
                     [first, first + count) writes the answers with these indices */
    struct umb_query_stats stats; /* Counts, added to */
    uint64_t reserved[2];         /* Zero: room for later versions (umbrage/version.h) */
};

/* A prepared query, filled by umb_query_prepare. The caller's storage; it may be copied. */
struct umb_query {
    uint64_t opaque[72];
};

/*
 * Checks settings against an asset and prepares them for runs.
 *
 * In:    asset: borrowed as long as the query is used. settings: copied.
 * Out:   query: zeroed on failure, and then must not be run.
 * Fails: E_NOT_FOUND (light), E_ARGUMENT (taps even or above 17, bias not finite or out of range in
 *        any mode, unknown mode or format), E_UNSUPPORTED (settings that the light or the asset
 *        does not support).
 * Threads: any.
 * Cost:  O(1), no allocation.
 */
UMB_API UMB_CHECKED enum umb_status umb_query_prepare(const struct umb_asset *asset,
                                                      const struct umb_query_settings *settings,
                                                      struct umb_query *query,
                                                      struct umb_error *error);

/* Returns the width of a prepared query's window in texels, as set by taps or footprint_m. Under a
 * lamp footprint_m sets a width at each point, and this is the widest: UMB_TAPS_MAX. */
UMB_API uint32_t umb_query_taps(const struct umb_query *query);

/*
 * Checks that a batch may be run: every position and the origin finite, footprints finite and not
 * below 0.
 *
 * In:    points: with count * 12 or count * 24 readable bytes of positions. Normals are not
 *        checked: any bits are safe.
 * Fails: E_ARGUMENT, naming the index and the value of the first bad coordinate or footprint.
 * Threads: any.
 * Cost:  one pass over the positions, no allocation.
 */
UMB_API UMB_CHECKED enum umb_status umb_points_check(const struct umb_points *points,
                                                     struct umb_error *error);

/*
 * Answers points first .. first + count - 1 of a batch.
 *
 * In:    first: any; for UMB_ANSWER_BIT a multiple of 8, so that two runs never share a byte. On
 *        one thread, runs in order may begin at any bit: a run keeps the bits before its first and
 *        clears those behind its last.
 * Out:   answers->values at the same indices, answers->stats added to.
 * Not guaranteed: a batch that umb_points_check refuses is answered safely, but its answers are
 *        meaningless.
 * Threads: disjoint ranges may run at once, each with its own struct umb_answers whose values
 *        point to the same array.
 * Source: Sintorn et al. 2014, section 6.2; masked popcounts over 8x8x1 leaf masks.
 */
UMB_API void umb_query_run(const struct umb_query *query, const struct umb_points *points,
                           size_t first, size_t count, struct umb_answers *answers);

/* Returns the number of points in a slice of a batch, for threads that share it: a multiple of 512.
 * If the answers begin at a multiple of 64 bytes, no two slices of them share a cache line. */
UMB_API size_t umb_query_slice(const struct umb_query *query);

/*
 * Answers a whole batch on the caller's threads, slice by slice.
 *
 * In:    workers: threads to run on; the calling thread alone answers a batch of one slice.
 * Out:   as umb_query_run for all points, bit for bit, whatever the threads and their order.
 * Threads: those of the workers, which read query and points and write disjoint slices of
 *        answers->values; answers->stats is added to once a slice.
 */
UMB_API void umb_query_run_split(const struct umb_query *query, const struct umb_points *points,
                                 const struct umb_workers *workers, struct umb_answers *answers);

/* Returns the bytes of `count` answers in a format; 0 for an unknown format. In: count: at most
 * SIZE_MAX / 4. */
UMB_API size_t umb_answer_bytes(enum umb_answer_format format, size_t count);

/* Answers of several queries; see umb_query_run_lights. */
struct umb_light_answers {
    void *const *values; /* [query_count], an array for each light as umb_answers.values */
    struct umb_query_stats *stats; /* [query_count], counts, added to */
    uint64_t reserved[2];          /* Zero: room for later versions (umbrage/version.h) */
};

/*
 * Answers points first .. first + count - 1 of a batch for several lights or settings, such as many
 * suns, or the lamps of a room.
 *
 * In:    queries: [query_count], each prepared; of one asset or of several. The rules of
 *        umb_query_run hold for each.
 * Out:   what umb_query_run gives for each query, bit for bit.
 * Cost:  the sum of the single runs, but points are read from memory once: a block of them stays in
 *        the L1 cache for all lights.
 */
UMB_API void umb_query_run_lights(const struct umb_query *queries, size_t query_count,
                                  const struct umb_points *points, size_t first, size_t count,
                                  struct umb_light_answers *answers);

/* How one point was answered, for people. */
struct umb_explanation {
    int facing_away, outside, before, behind; /* 0 or 1 each */
    int undefined;        /* 1: too far from any surface of an asset baked under the static rule */
    double bias_m;        /* Length of the bias, metres */
    double moved[3];      /* Position of the look-up, metres, world space */
    double voxel[3];      /* Position of the look-up in voxel space, before flooring */
    int64_t cell[3];      /* Voxel index after flooring and clamping of z */
    double voxel_size_m;  /* Mean edge of the voxel (cell) that answered, metres */
    double answer;        /* 0..1 */
    double transmittance; /* Factor of the answer for translucent casters, 0..1; 1: none */
    uint32_t level;       /* Level at which the look-up stopped; 0: at the voxel */
    uint32_t lit_taps, taps; /* Lit texels of taps * taps; of coarse look-ups 1 if all lit */
    enum umb_bias_mode bias_mode;
    int has_normal;    /* 1: the point moved along its normal; 0: towards the light */
    double cosine;     /* Cosine of the angle between normal and light; 0 without a normal */
    int64_t window[2]; /* Voxel x, y of the window's first texel */
    enum umb_filter filter;
    /* UMB_FILTER_FOOTPRINT: side of the point's square, metres. With this filter the other fields
     * describe a window of `taps` texels. */
    double footprint_m;
    uint32_t rows[UMB_TAPS_MAX]; /* bit i of rows[j]: texel (window[0] + i, window[1] + j) is lit */
    uint32_t frustum;
    uint32_t nodes, bricks; /* Nodes and bricks read */
    uint32_t step_count;
    struct {
        uint32_t level;   /* Octree level of the node; its side is 1 << level voxels */
        uint32_t state;   /* 0 shadowed, 1 lit, 2 mixed: the path goes on */
        uint64_t index;   /* Offset or brick number */
    } steps[16];          /* Path of the centre tap through the octree */
    uint64_t reserved[8]; /* Zero: room for later versions (umbrage/version.h) */
};

/* Explains the answer of point `index`, step by step, under the rules of umb_query_run. Cost: a few
 * look-ups of that point, too slow for batches. */
UMB_API void umb_query_explain(const struct umb_query *query, const struct umb_points *points,
                               size_t index, struct umb_explanation *explanation);

#ifdef __cplusplus
}
#endif
#endif

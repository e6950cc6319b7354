/* SPDX-License-Identifier: Apache-2.0 */
/* MRAA, VOAA and wide windows; see far_modes.h. */
#include "far_modes.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "bench_report.h"
#include "format/asset_parts.h"
#include "query/query_parts.h"
#include "query/slice_count.h"

#define UNKNOWN (-1.0)

/* Lit shares of wide nodes, by their first word, and of bricks, by their number. */
struct far_shares {
    struct umb__query query; /* One tap of the asset */
    double *nodes, *bricks;
};

static struct umb__query one_tap(const struct umb_asset *asset, uint32_t taps)
{
    const struct umb_query_settings settings = {.taps = taps};
    struct umb_query query;
    struct umb__query q;
    struct umb_error error;
    bench_must(umb_query_prepare(asset, &settings, &query, &error), &error, "far view");
    memcpy(&q, query.opaque, sizeof q);
    return q;
}

static double *unknown_make(uint64_t count)
{
    double *shares = malloc((size_t)(count + 1) * sizeof *shares);
    if (shares == NULL) {
        bench_fail("shares of %llu nodes: out of memory", (unsigned long long)count);
    }
    for (uint64_t i = 0; i < count; i++) {
        shares[i] = UNKNOWN;
    }
    return shares;
}

struct far_shares *far_shares_make(const struct umb_asset *asset)
{
    struct far_shares *shares = malloc(sizeof *shares);
    if (shares == NULL) {
        bench_fail("shares: out of memory");
    }
    shares->query = one_tap(asset, 1);
    shares->nodes = unknown_make(asset->view.node_words);
    shares->bricks = unknown_make(asset->view.brick_count);
    return shares;
}

void far_shares_free(struct far_shares *shares)
{
    free(shares->nodes);
    free(shares->bricks);
    free(shares);
}

static double brick_share(struct far_shares *shares, uint32_t number)
{
    double *share = &shares->bricks[number];
    if (*share < 0) {
        int lit = 0;
        for (unsigned z = 0; z < 8; z++) {
            lit += __builtin_popcountll(shares->query.bricks[number][z]);
        }
        *share = lit / 512.0;
    }
    return *share;
}

/* Returns the lit share of the voxels below a link of level `level`. */
static double link_share(struct far_shares *shares, struct umb__link link, uint32_t level)
{
    if (!link.mixed) {
        return link.lit;
    }
    if (level == UMB_LEVEL_BRICK) {
        return brick_share(shares, link.number);
    }
    double *share = &shares->nodes[link.number];
    if (*share < 0) {
        const struct umb__tree tree = umb__tree_of(&shares->query);
        double sum = 0;
        for (unsigned child = 0; child < 64; child++) {
            sum += link_share(shares, umb__tree_child(&tree, link.number, child), level - 2);
        }
        *share = sum / 64;
    }
    return *share;
}

/* Returns the lit share of the aligned cube of 2^k voxels a side around a voxel in a brick. */
static double share_in_brick(const uint64_t brick[8], const uint32_t v[3], uint32_t k)
{
    const uint32_t side = 1U << k, corner = ~(side - 1) & 7;
    const int32_t x = (int32_t)(v[0] & corner), y = (int32_t)(v[1] & corner);
    const struct umb__rectangle square = {x, x + (int32_t)side - 1, y, y + (int32_t)side - 1};
    int lit = 0;
    for (uint32_t z = v[2] & corner, end = z + side; z < end; z++) {
        lit += __builtin_popcountll(brick[z] & umb__slice_mask(0, 0, &square));
    }
    return lit / (double)(side * side * side);
}

/* Returns the lit share of the aligned cube of 2^k voxels a side around a voxel. Wide nodes have
 * odd levels, so a cube of an even level is eight children of a node. */
static double cube_share(struct far_shares *shares, const uint32_t v[3], uint32_t k)
{
    const struct umb__tree tree = umb__tree_of(&shares->query);
    uint32_t level = umb__tree_cell_level(&tree);
    struct umb__link link = umb__tree_cell(&tree, v[0] >> level, v[1] >> level, v[2] >> level);
    while (link.mixed && level > UMB_LEVEL_BRICK && level >= k + 2) {
        level -= 2;
        link = umb__tree_child(&tree, link.number, umb__child_at(level, v[0], v[1], v[2]));
    }
    if (!link.mixed || level <= k) {
        return link_share(shares, link, level);
    }
    if (level == UMB_LEVEL_BRICK) {
        return share_in_brick(shares->query.bricks[link.number], v, k);
    }
    double sum = 0;
    for (uint32_t child = 0; child < 8; child++) {
        const uint32_t half = 1U << (level - 2), cube = ~(2 * half - 1);
        const uint32_t x = (v[0] & cube) + half * (child & 1);
        const uint32_t y = (v[1] & cube) + half * (child >> 1 & 1);
        const uint32_t z = (v[2] & cube) + half * (child >> 2);
        const unsigned at = umb__child_at(level - 2, x, y, z);
        sum += link_share(shares, umb__tree_child(&tree, link.number, at), level - 2);
    }
    return sum / 8;
}

/* Finds the two levels around a width, and the weight of the upper one. In: least: width of level
 * 0. top: the highest level. */
struct between {
    uint32_t level;
    double weight;
};

static struct between find_levels(double width, double least, uint32_t top)
{
    struct between at = {0, 0};
    for (; 2 * least <= width && at.level + 1 < top; at.level++) {
        least *= 2;
    }
    at.weight = width > least ? fmin((width - least) / least, 1) : 0;
    return at;
}

/* The points that need a level of MRAA, and their answers. */
static void ask_level(const struct far_assets *assets, uint32_t level, uint32_t taps,
                      const struct far_points *view, const struct between *between, float *values,
                      double *answers)
{
    const struct umb_query_settings settings = {.taps = taps};
    const size_t count = view->points.count;
    double(*places)[3] = malloc(count * sizeof *places);
    float(*normals)[3] = malloc(count * sizeof *normals);
    uint32_t *of = malloc(count * sizeof *of);
    struct umb_points batch = view->points;
    struct umb_answers to = {.values = values};
    struct umb_query query;
    struct umb_error error;
    if (places == NULL || normals == NULL || of == NULL) {
        bench_fail("a level of %zu points: out of memory", count);
    }
    batch.count = 0;
    for (uint32_t i = 0; i < count; i++) {
        if (between[i].level == level || (between[i].level + 1 == level && between[i].weight > 0)) {
            memcpy(places[batch.count], (const double *)view->points.positions + 3 * i, 24);
            memcpy(normals[batch.count], (const float *)view->points.normals + 3 * i, 12);
            of[batch.count++] = i;
        }
    }
    batch.positions = places;
    batch.normals = normals;
    bench_must(umb_query_prepare(assets->level[level], &settings, &query, &error), &error, "MRAA");
    umb_query_run(&query, &batch, 0, batch.count, &to);
    for (size_t k = 0; k < batch.count; k++) {
        const struct between *at = &between[of[k]];
        answers[of[k]] += (at->level == level ? 1 - at->weight : at->weight) * (double)values[k];
    }
    free(places);
    free(normals);
    free(of);
}

void far_mraa(const struct far_assets *assets, uint32_t taps, const struct far_points *view,
              double *answers)
{
    const size_t count = view->points.count;
    struct between *between = malloc(count * sizeof *between);
    float *values = malloc(count * sizeof *values);
    if (between == NULL || values == NULL) {
        bench_fail("%zu points: out of memory", count);
    }
    for (size_t i = 0; i < count; i++) {
        between[i] = find_levels(view->widths[i], taps * assets->texel_m, FAR_LEVELS);
        answers[i] = 0;
    }
    for (uint32_t level = 0; level < FAR_LEVELS; level++) {
        ask_level(assets, level, taps, view, between, values, answers);
    }
    free(between);
    free(values);
}

/* Moves point i off its surface by the automatic bias of a window and of voxels `scale` times as
 * wide, whose lift counts from the point's own depth. Returns false if it faces away. */
static bool move_by(const struct umb__query *q, const struct umb_points *points, size_t i,
                    double taps, double scale, double v[3])
{
    double n[3], p[3], along[3];
    const double length2 = umb__normal(points, i, n);
    umb__position(q, points, i, p);
    if (!umb__is_normal(length2) || umb__dot(n, q->direction) >= 0) {
        return false;
    }
    for (unsigned axis = 0; axis < 3; axis++) {
        along[axis] = scale * fabs(umb__dot(n, q->voxel_step[axis]));
    }
    const double need = 0.5 * UMB__BIAS_SLACK * (taps * (along[0] + along[1]) + along[2]);
    const double most = UMB__LIFT_TEXELS(taps) * q->lift_texel;
    const double lift = most * along[2] < need ? most : need / along[2];
    for (unsigned axis = 0; axis < 3; axis++) {
        p[axis] += n[axis] * (need - lift * along[2]) / length2;
    }
    umb__to_voxel(q, p, v);
    v[2] -= scale * lift;
    return true;
}

/* Answers one level of VOAA. The bias is that of two cubes, so that the whole cube lies on the
 * light's side of the surface's plane, wherever in it the point is. */
static double voaa_level(struct far_shares *shares, const struct umb_points *points, size_t i,
                         uint32_t k)
{
    const struct umb__query *q = &shares->query;
    const double size = (double)((uint32_t)1 << q->log2_size);
    double v[3];
    if (!move_by(q, points, i, 1, k == 0 ? 1 : 2.0 * (double)(1U << k), v)) {
        return 0;
    }
    if (!(v[0] >= 0 && v[0] < size && v[1] >= 0 && v[1] < size && v[2] >= 0)) {
        return 1;
    }
    const uint32_t voxel[3] = {(uint32_t)v[0], (uint32_t)v[1], (uint32_t)fmin(v[2], size - 1)};
    return cube_share(shares, voxel, k);
}

void far_voaa(const struct far_assets *assets, struct far_shares *shares,
              const struct far_points *view, double *answers)
{
    const uint32_t top = shares->query.log2_size - 1;
    for (size_t i = 0; i < view->points.count; i++) {
        const struct between at = find_levels(view->widths[i], assets->texel_m, top);
        const double near = voaa_level(shares, &view->points, i, at.level);
        answers[i] = near;
        if (at.weight > 0) {
            answers[i] += at.weight * (voaa_level(shares, &view->points, i, at.level + 1) - near);
        }
    }
}

void far_window(const struct far_assets *assets, const struct far_points *view, double *answers)
{
    const struct umb__query q = one_tap(assets->level[0], 1);
    const struct umb__tree tree = umb__tree_of(&q);
    struct umb_query_stats stats = {0};
    for (size_t i = 0; i < view->points.count; i++) {
        const double texels = fmax(view->widths[i] / assets->texel_m, 1);
        double v[3];
        if (!move_by(&q, &view->points, i, texels, 1, v)) {
            answers[i] = 0;
            continue;
        }
        const struct umb__slice slice = {&tree, &stats, (int64_t)floor(v[2])};
        const struct umb__real_box box = {(int64_t)floor(v[0]), (int64_t)floor(v[1]), texels,
                                          texels};
        answers[i] = umb__slice_share(&slice, &box);
    }
}

/* Moves p, relative to the asset's origin, off a surface with unit normal n. */
static void move_off(const struct umb__query *q, enum far_bias bias, const double n[3], double p[3])
{
    struct umb__lift lift = {0, {0, 0}};
    double v[3], scale, shift = 0;
    if (bias == FAR_BY_NORMAL) {
        const double(*step)[3] = q->voxel_step;
        scale = 0.5 * UMB__BIAS_SLACK *
                (q->taps * (fabs(umb__dot(n, step[0])) + fabs(umb__dot(n, step[1]))) +
                 fabs(umb__dot(n, step[2])));
    } else {
        scale = umb__lift_auto(q, n, umb__dot(n, n), &lift);
        lift.depth *= scale > 0 ? 1 : 1.25;
        umb__to_voxel(q, p, v);
        shift = umb__lift_depth(&lift, v);
    }
    for (int k = 0; k < 3; k++) {
        p[k] += scale * n[k] + shift * q->voxel_step[2][k];
    }
}

void far_biased(const struct umb_asset *asset, enum far_bias bias, const struct far_points *view,
                float *values)
{
    const struct umb_query_settings settings = {.taps = 9, .bias_mode = UMB_BIAS_NONE};
    const struct umb__query q = one_tap(asset, settings.taps);
    struct umb_points points = view->points;
    struct umb_answers answers = {.values = values};
    struct umb_query query;
    struct umb_error error;
    double(*moved)[3] = malloc((points.count + 1) * sizeof *moved);
    if (moved == NULL) {
        bench_fail("%zu points: out of memory", points.count);
    }
    for (size_t i = 0; i < points.count; i++) {
        double n[3], p[3];
        umb__position(&q, &view->points, i, p);
        if (umb__is_normal(umb__normal(&view->points, i, n)) && umb__dot(n, q.direction) < 0) {
            move_off(&q, bias, n, p);
        }
        for (int k = 0; k < 3; k++) {
            moved[i][k] = p[k] + q.origin[k];
        }
    }
    points.positions = moved;
    memset(points.origin, 0, sizeof points.origin);
    points.format = UMB_POINT_F64;
    bench_must(umb_query_prepare(asset, &settings, &query, &error), &error, "far view");
    umb_query_run(&query, &points, 0, points.count, &answers);
    free(moved);
}

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The comparison of squares (squares_check.h): digests first, then rays.
 *
 * The rays of a directional light stay in their column, so the casters near the squares are enough
 * to trace them, and a hierarchy over few triangles takes no time. A verdict of "wrong" from them
 * may come from a solid whose far sides are missing, so it is given again with all casters.
 */
#include "bake/write/squares_check.h"

#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "bake/base/interrupt.h"
#include "bake/write/check_verdict.h"
#include "bake/write/near_casters.h"
#include "bake/write/square_content.h"
#include "base/try.h"
#include "query/volume_parts.h"
#include "rays/verify_squares.h"
#include "tool/threads.h"

/* Columns to trace at most, for each point of the random check: a column costs a quarter. */
#define COLUMNS_A_POINT 4U

/* One square of a tile that was not inherited. */
struct item {
    uint32_t frustum;
    uint32_t x, y; /* first texel */
    size_t number; /* in the frustum's records */
    const uint8_t *casters;
    int is_known; /* 1: compared by an earlier bake */
};

struct squares {
    const struct umb_asset *asset;
    const struct umbb_check *check;
    struct umb__tree *trees; /* [frustum_count] */
    struct item *items;      /* [count] */
    size_t count;
};

/* Number of squares of tiles that were not inherited. Counts tiles in `checked`. */
static size_t count_items(const struct umbb_proofs *proofs, struct umbb_checked *checked)
{
    size_t count = 0;
    for (uint32_t f = 0; f < proofs->frustum_count; f++) {
        const struct umbb_frustum_proofs *one = &proofs->frusta[f];
        checked->tiles += one->tile_count;
        for (size_t tile = 0; tile < one->tile_count; tile++) {
            checked->tiles_inherited += one->inherited[tile];
            count += one->inherited[tile] ? 0 : one->square_count;
        }
    }
    return count;
}

/* Lists the squares of a tile that was not inherited. */
static void list_tile(struct squares *squares, uint32_t frustum, size_t tile)
{
    const struct umbb_frustum_proofs *one = &squares->check->proofs->frusta[frustum];
    const size_t across = (size_t)1 << (one->log2_size - one->tile_log2);
    const uint32_t inner_log2 = one->tile_log2 - one->square_log2;
    for (size_t i = 0; i < one->square_count; i++) {
        const size_t column = i & (((size_t)1 << inner_log2) - 1), row = i >> inner_log2;
        squares->items[squares->count++] = (struct item){
            .frustum = frustum,
            .x = (uint32_t)((tile % across << one->tile_log2) + (column << one->square_log2)),
            .y = (uint32_t)((tile / across << one->tile_log2) + (row << one->square_log2)),
            .number = tile * one->square_count + i,
            .casters = one->casters[tile] != NULL ? one->casters[tile][i] : NULL,
        };
    }
}

static void list_items(struct squares *squares)
{
    const struct umbb_proofs *proofs = squares->check->proofs;
    for (uint32_t f = 0; f < proofs->frustum_count; f++) {
        for (size_t tile = 0; tile < proofs->frusta[f].tile_count; tile++) {
            if (!proofs->frusta[f].inherited[tile]) {
                list_tile(squares, f, tile);
            }
        }
    }
}

/* Finds the trees of all frusta. */
static enum umb_status find_trees(struct squares *squares, uint32_t lights, struct umb_error *error)
{
    for (uint32_t light = 0; light < lights; light++) {
        struct umb_volume volume;
        struct umb_light_info info;
        UMB__TRY(umb_volume_prepare(squares->asset, light, &volume, error));
        UMB__TRY(umb_asset_get_light(squares->asset, light, &info));
        const struct umb__volume v = umb__volume_of(&volume);
        for (uint32_t face = 0; face < info.frustum_count; face++) {
            squares->trees[info.first_frustum + face] = umb__volume_tree(&v, face);
        }
    }
    return UMB_OK;
}

/* Computes the digest of a square, and looks it up in the record of earlier bakes. */
static void digest_item(void *user, size_t i)
{
    struct squares *squares = user;
    struct item *item = &squares->items[i];
    struct umbb_frustum_proofs *one = &squares->check->proofs->frusta[item->frustum];
    const struct umbb_square_proof *before = &one->squares[item->number];
    struct umbb_square_proof *now = &one->squares_now[item->number];
    memset(now, 0, sizeof *now);
    if (item->casters == NULL) { /* no result of the tile: nothing to inherit, nothing to keep */
        return;
    }
    umbb_square_digest(&squares->trees[item->frustum], item->x, item->y, one->square_log2,
                       item->casters, now->digest);
    item->is_known = umbb_square_is_proven(one, before) &&
                     memcmp(before->digest, now->digest, sizeof now->digest) == 0;
    if (item->is_known) {
        *now = *before;
    }
}

/* Adds a comparison to the oldest. */
static void add_age(const struct umbb_square_proof *square, struct umbb_checked *checked)
{
    if (square->time_s != 0 && (checked->oldest_s == 0 || square->time_s < checked->oldest_s)) {
        checked->oldest_s = square->time_s;
    }
}

/* Finds the oldest comparison that was inherited. */
static void find_oldest(const struct umbb_proofs *proofs, struct umbb_checked *checked)
{
    for (uint32_t f = 0; f < proofs->frustum_count; f++) {
        const struct umbb_frustum_proofs *one = &proofs->frusta[f];
        for (size_t i = 0; i < one->tile_count * one->square_count; i++) {
            add_age(&one->squares_now[i], checked);
        }
    }
}

/* Lists the squares of a light that are to be traced, in pieces of UMBR_SQUARE texels; NULL if out
 * of memory. */
static struct umbr_square *pieces_of(const struct squares *squares,
                                     const struct umb_light_info *light, size_t *count)
{
    const struct umbb_frustum_proofs *any = squares->check->proofs->frusta;
    size_t most = 1;
    for (size_t i = 0; i < squares->count; i++) {
        most += (size_t)!squares->items[i].is_known
                << 2 * (any[squares->items[i].frustum].square_log2 - UMBB_SQUARE_LOG2);
    }
    struct umbr_square *pieces = malloc(most * sizeof *pieces);
    *count = 0;
    for (size_t i = 0; pieces != NULL && i < squares->count; i++) {
        const struct item *item = &squares->items[i];
        const uint32_t side = 1U << any[item->frustum].square_log2;
        if (item->is_known || item->frustum - light->first_frustum >= light->frustum_count) {
            continue;
        }
        for (uint32_t y = 0; y < side; y += UMBR_SQUARE) {
            for (uint32_t x = 0; x < side; x += UMBR_SQUARE) {
                pieces[(*count)++] = (struct umbr_square){item->frustum, item->x + x, item->y + y};
            }
        }
    }
    return pieces;
}

/* Compares pieces with rays among `casters`. */
static enum umb_status trace(const struct squares *squares, uint32_t light,
                             const struct umbb_near_casters *casters,
                             const struct umbr_square *pieces, size_t count,
                             struct umbr_squares_result *result, struct umb_error *error)
{
    const struct umbb_check *check = squares->check;
    const struct umbr_rays_options quick = {
        .quick = 1, .threads = check->threads, .cuts = &casters->cuts};
    const struct umbr_verify_options options = {
        .closed = casters->closed, .threads = check->threads, .cancelled = umbb_interrupted};
    struct umbr_rays *rays;
    UMB__TRY(umbr_rays_build(casters->corners, casters->count, &quick, &rays, error));
    const enum umb_status status =
        umbr_verify_squares(squares->asset, light, rays, &options, pieces, count, result, error);
    umbr_rays_destroy(rays);
    return status;
}

/* Compares pieces of a light, with rays against the casters near them. If these find an error,
 * compares again with all casters. */
static enum umb_status trace_light(const struct squares *squares, uint32_t light,
                                   const struct umbr_square *pieces, size_t count,
                                   struct umbr_squares_result *result, struct umb_error *error)
{
    const struct umbb_check *check = squares->check;
    struct umbb_near_casters near, all = {.corners = check->corners,
                                          .closed = check->closed,
                                          .cuts = *check->cuts,
                                          .count = check->count};
    int found;
    UMB__TRY(
        umbb_near_casters_find(squares->asset, light, check, pieces, count, &near, &found, error));
    if (found) {
        const enum umb_status status = trace(squares, light, &near, pieces, count, result, error);
        umbb_near_casters_finish(&near);
        if (status != UMB_OK || (result->found.outside_band == 0 && !result->gave_up)) {
            return status;
        }
    }
    return trace(squares, light, &all, pieces, count, result, error);
}

/* Compares all squares of one light that are not known. */
static enum umb_status check_light(const struct squares *squares, uint32_t light,
                                   struct umbb_checked *checked, int *sample,
                                   struct umb_error *error)
{
    struct umb_light_info info;
    struct umbr_squares_result result;
    size_t count;
    UMB__TRY(umb_asset_get_light(squares->asset, light, &info));
    struct umbr_square *pieces = pieces_of(squares, &info, &count);
    if (pieces == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "self-check: memory for squares refused");
    }
    enum umb_status status =
        count > 0 ? trace_light(squares, light, pieces, count, &result, error) : UMB_OK;
    if (status == UMB_OK && count > 0) {
        umbr_verify_result_add(&checked->verified, &result.found);
        checked->columns += result.found.records;
        *sample |= result.gave_up;
        status = umbb_check_verdict(squares->check, light, &result.found, error);
    }
    free(pieces);
    return status;
}

/* Notes the comparison of all squares that were not known. */
static void note_compared(const struct squares *squares, struct umbb_checked *checked)
{
    const uint64_t now = (uint64_t)time(NULL);
    for (size_t i = 0; i < squares->count; i++) {
        const struct item *item = &squares->items[i];
        struct umbb_frustum_proofs *one = &squares->check->proofs->frusta[item->frustum];
        checked->squares += !item->is_known;
        if (!item->is_known && item->casters != NULL) {
            one->squares_now[item->number].time_s = now;
            one->squares_now[item->number].columns = 1U << 2 * one->square_log2;
        }
    }
}

/* Columns of the squares that are not known. Counts the others in `checked`. */
static uint64_t count_columns(const struct squares *squares, struct umbb_checked *checked)
{
    uint64_t columns = 0;
    for (size_t i = 0; i < squares->count; i++) {
        const struct item *item = &squares->items[i];
        checked->squares_inherited += (uint64_t)item->is_known;
        columns += (uint64_t)!item->is_known
                   << 2 * squares->check->proofs->frusta[item->frustum].square_log2;
    }
    return columns;
}

/* Compares squares with their list and trees allocated. */
static enum umb_status check_squares(struct squares *squares, uint32_t lights,
                                     struct umbb_checked *checked, int *sample,
                                     struct umb_error *error)
{
    const struct umbb_check *check = squares->check;
    list_items(squares);
    UMB__TRY(find_trees(squares, lights, error));
    UMB__TRY(umbu_range_each(check->threads, squares->count, 16, digest_item, squares, error));
    find_oldest(check->proofs, checked);
    const uint64_t columns = count_columns(squares, checked);
    if (columns > COLUMNS_A_POINT * check->points ||
        checked->tiles_inherited + checked->squares_inherited == 0) {
        return UMB_OK; /* too many columns, or nothing to inherit: random points as asked for */
    }
    *sample = 0;
    for (uint32_t light = 0; light < lights && !*sample; light++) {
        UMB__TRY(check_light(squares, light, checked, sample, error));
    }
    if (!*sample) {
        note_compared(squares, checked);
    }
    return UMB_OK;
}

enum umb_status umbb_squares_check(const struct umb_asset *asset, const struct umbb_check *check,
                                   struct umbb_checked *checked, int *sample,
                                   struct umb_error *error)
{
    struct umb_asset_info info;
    struct squares squares = {.asset = asset, .check = check};
    const size_t count = count_items(check->proofs, checked);
    umb_asset_get_info(asset, &info);
    *sample = 1;
    squares.items = malloc((count + 1) * sizeof *squares.items);
    squares.trees = calloc(info.frustum_count + 1U, sizeof *squares.trees);
    const enum umb_status status =
        squares.items != NULL && squares.trees != NULL && info.frustum_count > 0
            ? check_squares(&squares, info.light_count, checked, sample, error)
            : umb_fail(error, UMB_E_NO_MEMORY, "self-check: memory for %zu squares refused", count);
    free(squares.items);
    free(squares.trees);
    return status;
}

void umbb_squares_sampled(struct umbb_proofs *proofs, uint64_t points)
{
    const uint64_t now = (uint64_t)time(NULL);
    for (uint32_t f = 0; f < proofs->frustum_count; f++) {
        struct umbb_frustum_proofs *one = &proofs->frusta[f];
        for (size_t tile = 0; tile < one->tile_count; tile++) {
            for (size_t i = 0; i < one->square_count && one->casters[tile] != NULL; i++) {
                struct umbb_square_proof *square = &one->squares_now[tile * one->square_count + i];
                if (square->time_s == 0) {
                    square->time_s = now;
                    square->points = points < UINT32_MAX ? (uint32_t)points : UINT32_MAX;
                }
            }
        }
    }
}

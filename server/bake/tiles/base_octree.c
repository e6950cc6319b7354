/* SPDX-License-Identifier: Apache-2.0 */
/* See base_octree.h. A base is one file of the cache, so it is written, checked, counted and
 * removed as a tile's result is. */
#include "bake/tiles/base_octree.h"

#include <stdlib.h>
#include <string.h>

#include "base/bytes.h"
#include "base/try.h"
#include "common/sha256.h"

#define MAGIC      "UMBBASE1"
#define HEAD_BYTES (8 + (size_t)UMB_ID_BYTES)
#define TILE_BYTES (2 * (size_t)UMB_ID_BYTES + 12)
#define RUN_BYTES  ((size_t)8)

/* A base is written anew when more than this part of its tiles have changed. */
#define CHANGED_SHARE 8U

static const char name_domain[16] = "umbrage base   ";

static void name_base(struct umbb_base *base)
{
    struct umbs_sha256_run run;
    umbs_sha256_begin(&run);
    umbs_sha256_add(&run, name_domain, sizeof name_domain);
    for (uint32_t i = 0; i < base->proofs->frustum_count; i++) {
        umbs_sha256_add(&run, base->proofs->frusta[i].place, UMB_ID_BYTES);
        base->tile_count += base->proofs->frusta[i].tile_count;
    }
    umbs_sha256_end(&run, base->name);
}

/* Returns the number of a tile among those of all frusta. */
static size_t number_of(const struct umbb_base *base, uint32_t frustum, uint32_t tile)
{
    size_t first = 0;
    for (uint32_t i = 0; i < frustum; i++) {
        first += base->proofs->frusta[i].tile_count;
    }
    return first + tile;
}

/* Reads a tile's entry and its runs. Returns 0 if they are not those of a tile; -1 if out of
 * memory. In: nodes: number of nodes of the tile's level. */
static int read_tile(const struct umbb_frustum_proofs *proofs, const uint8_t *at,
                     const uint8_t **run_at, const uint8_t *end, uint32_t nodes,
                     struct umbb_base_tiles *tiles, struct umbb_base_tile *tile)
{
    const uint8_t *counts = at + 2 * UMB_ID_BYTES, *run;
    const uint32_t voxels = 1U << proofs->log2_size;
    const uint32_t max_lit = umb__load32(counts), min_end = umb__load32(counts + 4);
    const uint32_t count = umb__load32(counts + 8);
    if (max_lit > voxels || min_end > voxels || !umb__take(run_at, end, count, RUN_BYTES, &run)) {
        return 0;
    }
    memcpy(tile->proof.key, at, UMB_ID_BYTES);
    memcpy(tile->proof.result, at + UMB_ID_BYTES, UMB_ID_BYTES);
    tile->result = (struct umbb_tile_result){
        .max_lit = (int32_t)max_lit,
        .min_end = (int32_t)min_end,
        .column = umbb_column_bounds(proofs->tile_log2, (int32_t)max_lit, (int32_t)min_end)};
    tile->run_first = tiles->runs.count;
    uint32_t z = tile->result.column.mixed_first;
    for (uint32_t i = 0; i < count; i++, run += RUN_BYTES) {
        const uint32_t z_end = umb__load32(run), ref = umb__load32(run + 4);
        if (z_end <= z || z_end > tile->result.column.mixed_end ||
            (umb__ref_state(ref) == UMB__NODE_MIXED && ref >= nodes)) {
            return 0;
        }
        struct umb_error ignored;
        if (umbb_runs_push(&tiles->runs, tile->run_first, z_end, ref, &ignored) != UMB_OK) {
            return -1;
        }
        z = z_end;
    }
    tile->result.column.run_count = tiles->runs.count - tile->run_first;
    return z == tile->result.column.mixed_end || count == 0;
}

/* Number of nodes of a level in an image; 0 if there is no such level. */
static uint32_t nodes_of(const uint8_t *image, size_t size, uint32_t level)
{
    const size_t at = level == UMB_LEVEL_BRICK ? 0 : 4 + 8 * (size_t)(level - UMB_LEVEL_BRICK - 1);
    return size >= at + 4 ? umb__load32(image + at) : 0;
}

/* Finds the image behind the tiles' runs. Returns 0 if the runs do not fit. */
static int find_image(struct umbb_base *base, const uint8_t *tiles, const uint8_t *end)
{
    uint64_t runs = 0;
    for (size_t i = 0; i < base->tile_count; i++) {
        runs += umb__load32(tiles + i * TILE_BYTES + 2 * UMB_ID_BYTES + 8);
    }
    const uint8_t *at = tiles + base->tile_count * TILE_BYTES, *skipped;
    if (!umb__take(&at, end, runs, RUN_BYTES, &skipped) || !umb__take(&at, end, 1, 8, &skipped)) {
        return 0;
    }
    const uint64_t image = umb__load64(skipped);
    base->image = (size_t)(at - base->bytes);
    base->kept_at = base->image + (size_t)image;
    return umb__take(&at, end, image, 1, &skipped);
}

/* Decodes the tiles. Returns as read_tile. */
static int decode(struct umbb_base *base)
{
    const uint8_t *at = base->bytes, *const end = base->bytes + base->size, *head, *tiles;
    if (!umb__take(&at, end, 1, HEAD_BYTES, &head) || memcmp(head, MAGIC, 8) != 0 ||
        memcmp(head + 8, base->name, UMB_ID_BYTES) != 0 ||
        !umb__take(&at, end, base->tile_count, TILE_BYTES, &tiles) ||
        !find_image(base, tiles, end)) {
        return 0;
    }
    size_t number = 0;
    int read = 1;
    for (uint32_t f = 0; f < base->proofs->frustum_count; f++) {
        const struct umbb_frustum_proofs *one = &base->proofs->frusta[f];
        const uint32_t nodes =
            nodes_of(base->bytes + base->image, base->kept_at - base->image, one->tile_log2);
        for (size_t t = 0; t < one->tile_count && read == 1; t++, number++) {
            read = read_tile(one, tiles + number * TILE_BYTES, &at, end, nodes, &base->before,
                             &base->before.tiles[number]);
        }
    }
    return read;
}

static void tiles_finish(struct umbb_base_tiles *tiles)
{
    free(tiles->tiles);
    umbb_runs_finish(&tiles->runs);
    memset(tiles, 0, sizeof *tiles);
}

void umbb_base_release(struct umbb_base *base)
{
    umb__pack_kept_finish(&base->kept);
    free(base->bytes);
    base->bytes = NULL;
    base->size = base->image = base->kept_at = 0;
}

/* Forgets the base that was read. */
static void forget(struct umbb_base *base)
{
    umbb_base_release(base);
    tiles_finish(&base->before);
}

enum umb_status umbb_base_open(struct umbb_base *base, const struct umbb_proofs *proofs,
                               struct umbb_tile_cache *cache, size_t max_bytes,
                               struct umb_error *error)
{
    struct umb_error cause;
    *base = (struct umbb_base){.cache = cache, .proofs = proofs};
    name_base(base);
    base->now.tiles = calloc(base->tile_count + 1, sizeof *base->now.tiles);
    base->before.tiles = calloc(base->tile_count + 1, sizeof *base->before.tiles);
    if (base->now.tiles == NULL || base->before.tiles == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "base: memory for %zu tiles refused",
                        base->tile_count);
    }
    if (umbb_tile_cache_read(cache, base->name, 2 * max_bytes, &base->bytes, &base->size, &cause) !=
            UMB_OK ||
        base->bytes == NULL) {
        forget(base);
        return UMB_OK;
    }
    const int read = decode(base);
    if (read != 1) {
        forget(base);
    }
    if (read == 0) {
        umbb_tile_cache_drop(cache, base->name);
    }
    return read < 0 ? umb_fail(error, UMB_E_NO_MEMORY, "base: memory for its runs refused")
                    : UMB_OK;
}

void umbb_base_close(struct umbb_base *base)
{
    forget(base);
    tiles_finish(&base->now);
    memset(base, 0, sizeof *base);
}

void umbb_base_load(struct umbb_base *base, struct umb__pool *pool)
{
    struct umb_error cause;
    if (base->bytes == NULL) {
        return;
    }
    const enum umb_status status =
        umb__pool_load(pool, base->bytes + base->image, base->kept_at - base->image, &cause);
    base->is_loaded = status == UMB_OK;
    if (status != UMB_OK) {
        umb__pool_clear(pool);
        forget(base);
    }
    if (status == UMB_E_CORRUPT) {
        umbb_tile_cache_drop(base->cache, base->name);
    }
    for (uint32_t level = UMB_LEVEL_BRICK; level <= UMB_LEVEL_MAX; level++) {
        base->counts[level] = pool->level[level].count;
    }
}

const struct umbb_base_tile *umbb_base_find(const struct umbb_base *base, uint32_t frustum,
                                            uint32_t tile, const uint8_t key[UMB_ID_BYTES])
{
    if (!base->is_loaded) {
        return NULL;
    }
    const struct umbb_base_tile *found = &base->before.tiles[number_of(base, frustum, tile)];
    return memcmp(found->proof.key, key, UMB_ID_BYTES) == 0 ? found : NULL;
}

enum umb_status umbb_base_take(struct umbb_base *base, const struct umbb_base_tile *tile,
                               struct umbb_runs *runs, struct umbb_tile_result *result,
                               struct umb_error *error)
{
    *result = tile->result;
    result->column.run_first = runs->count;
    for (size_t i = 0; i < tile->result.column.run_count; i++) {
        const struct umbb_column_run *run = &base->before.runs.items[tile->run_first + i];
        UMB__TRY(umbb_runs_push(runs, result->column.run_first, run->z_end, run->ref, error));
    }
    result->column.run_count = runs->count - result->column.run_first;
    base->found++;
    umbb_tile_cache_touch(base->cache, tile->proof.key);
    return UMB_OK;
}

enum umb_status umbb_base_note(struct umbb_base *base, uint32_t frustum, uint32_t tile,
                               const struct umbb_tile_proof *proof,
                               const struct umbb_tile_result *result, const struct umbb_runs *runs,
                               struct umb_error *error)
{
    struct umbb_base_tile *now = &base->now.tiles[number_of(base, frustum, tile)];
    now->proof = *proof;
    now->result = *result;
    now->run_first = base->now.runs.count;
    for (size_t i = 0; i < result->column.run_count; i++) {
        const struct umbb_column_run *run = &runs->items[result->column.run_first + i];
        UMB__TRY(umbb_runs_push(&base->now.runs, now->run_first, run->z_end, run->ref, error));
    }
    now->result.column.run_count = base->now.runs.count - now->run_first;
    return UMB_OK;
}

/* Gives the runs of this bake the numbers of the compacted octree. */
static void renumber_runs(struct umbb_base *base, const struct umb__octree_map *map)
{
    size_t number = 0;
    for (uint32_t f = 0; f < base->proofs->frustum_count; f++) {
        const struct umbb_frustum_proofs *one = &base->proofs->frusta[f];
        for (size_t t = 0; t < one->tile_count; t++, number++) {
            const struct umbb_base_tile *tile = &base->now.tiles[number];
            for (size_t i = 0; i < tile->result.column.run_count; i++) {
                uint32_t *ref = &base->now.runs.items[tile->run_first + i].ref;
                if (umb__ref_state(*ref) == UMB__NODE_MIXED) {
                    *ref = map->numbers[one->tile_log2][*ref];
                }
            }
        }
    }
}

/* Reads what is kept of the cuts and pages. In: map: NULL: no node was removed. */
static enum umb_status read_kept(struct umbb_base *base, const struct umb__octree_map *map,
                                 struct umb_error *error)
{
    const enum umb_status status =
        umb__pack_kept_read(base->bytes + base->kept_at, base->size - base->kept_at, base->counts,
                            map, &base->kept, error);
    if (status == UMB_E_CORRUPT) {
        umb__pack_kept_finish(&base->kept);
        umbb_tile_cache_drop(base->cache, base->name);
        return UMB_OK;
    }
    return status;
}

enum umb_status umbb_base_compact(struct umbb_base *base, struct umb__octree *octree,
                                  struct umb_error *error)
{
    struct umb__octree_map map;
    if (!base->is_loaded) {
        return UMB_OK;
    }
    if (base->found == base->tile_count) {
        return read_kept(base, NULL, error);
    }
    enum umb_status status = umb__octree_compact(octree, &map, error);
    if (status == UMB_OK) {
        renumber_runs(base, &map);
        status = read_kept(base, &map, error);
    }
    umb__octree_map_finish(&map);
    return status;
}

/* Writes the entries of the tiles, and their runs. */
static void put_tiles(const struct umbb_base *base, uint8_t *at)
{
    uint8_t *runs = at + base->tile_count * TILE_BYTES;
    for (size_t i = 0; i < base->tile_count; i++, at += TILE_BYTES) {
        const struct umbb_base_tile *tile = &base->now.tiles[i];
        const size_t count = tile->result.column.run_count;
        memcpy(at, tile->proof.key, UMB_ID_BYTES);
        memcpy(at + UMB_ID_BYTES, tile->proof.result, UMB_ID_BYTES);
        umb__store32(at + 2 * UMB_ID_BYTES, (uint32_t)tile->result.max_lit);
        umb__store32(at + 2 * UMB_ID_BYTES + 4, (uint32_t)tile->result.min_end);
        umb__store32(at + 2 * UMB_ID_BYTES + 8, (uint32_t)count);
        for (size_t r = 0; r < count; r++, runs += RUN_BYTES) {
            umb__store32(runs, base->now.runs.items[tile->run_first + r].z_end);
            umb__store32(runs + 4, base->now.runs.items[tile->run_first + r].ref);
        }
    }
}

/* 1 if the base that was read serves the next bake as well as a new one. */
static int is_good(const struct umbb_base *base)
{
    return base->is_loaded && base->tile_count - base->found <= base->tile_count / CHANGED_SHARE;
}

enum umb_status umbb_base_keep(const struct umbb_base *base, const struct umb__pack_cuts *cuts,
                               const struct umb__kept_page *pages, uint32_t page_count,
                               struct umb_error *error)
{
    if (base->cache == NULL || is_good(base)) {
        return UMB_OK;
    }
    const size_t tiles =
        HEAD_BYTES + base->tile_count * TILE_BYTES + base->now.runs.count * RUN_BYTES;
    const uint64_t image = umb__octree_image_bytes(cuts->octree);
    const uint64_t size = tiles + 8 + image + umb__pack_kept_bytes(cuts, pages, page_count);
    uint8_t *bytes = size < SIZE_MAX / 2 ? malloc((size_t)size) : NULL;
    if (bytes == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "base: memory for %llu bytes refused",
                        (unsigned long long)size);
    }
    memcpy(bytes, MAGIC, 8);
    memcpy(bytes + 8, base->name, UMB_ID_BYTES);
    put_tiles(base, bytes + HEAD_BYTES);
    umb__store64(bytes + tiles, image);
    umb__octree_image_write(cuts->octree, bytes + tiles + 8);
    umb__pack_kept_write(cuts, pages, page_count, bytes + tiles + 8 + image);
    const enum umb_status status =
        umbb_tile_cache_write(base->cache, base->name, bytes, (size_t)size, error);
    free(bytes);
    return status;
}

void umbb_base_drop(const struct umbb_base *base)
{
    if (base->cache != NULL) {
        umbb_tile_cache_drop(base->cache, base->name);
    }
}

/* SPDX-License-Identifier: Apache-2.0 */
/* The tile loop's cache: a key names a tile, tile_code.h makes bytes of it, tile_cache.h keeps
 * them. */
#include "bake/tiles/tile_folder.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/try.h"
#include "common/sha256.h"

enum umb_status umbb_tile_folder_open(struct umbb_tile_folder *tile_folder,
                                      enum umbb_tile_folder_mode mode, const char *folder,
                                      uint64_t max_bytes, unsigned threads, struct umb_error *error)
{
    memset(tile_folder, 0, sizeof *tile_folder);
    tile_folder->mode = mode;
    if (mode == UMBB_TILE_FOLDER_MERGE && access(folder, R_OK | X_OK) != 0) {
        return umb_fail_errno(error, UMB_E_NO_INPUT, errno, "--from: cannot read '%.200s'", folder);
    }
    UMB__TRY(umbb_tile_cache_open(&tile_folder->cache, folder, max_bytes, error));
    return umbb_tile_ahead_create(threads, &tile_folder->ahead, error);
}

void umbb_tile_folder_close(struct umbb_tile_folder *tile_folder)
{
    umbb_tile_ahead_destroy(tile_folder->ahead);
    umb__pool_numbers_finish(&tile_folder->numbers);
    umbb_tile_cache_close(&tile_folder->cache);
    tile_folder->ahead = NULL;
}

void umbb_tile_folder_frustum(struct umbb_tile_folder *tile_folder, uint32_t frustum,
                              const struct umbb_tile_shape *shape, const struct umbb_depth *depth)
{
    tile_folder->depth = depth;
    tile_folder->shape = *shape;
    tile_folder->first = (uint64_t)frustum << (2 * (shape->log2_size - shape->tile_log2));
    tile_folder->missed[0].number = tile_folder->missed[1].number = UINT32_MAX;
    tile_folder->frustum = frustum;
    umbb_tile_ahead_begin(tile_folder->ahead, depth, shape, frustum, tile_folder->base);
    tile_folder->proof = tile_folder->proofs != NULL && tile_folder->proofs->frusta != NULL
                             ? &tile_folder->proofs->frusta[frustum]
                             : NULL;
}

void umbb_tile_folder_frustum_end(struct umbb_tile_folder *tile_folder)
{
    umbb_tile_ahead_end(tile_folder->ahead);
    tile_folder->depth = NULL;
    tile_folder->proof = NULL;
}

/* Prints the first failure of the cache. */
static void notice(struct umbb_tile_folder *tile_folder, const struct umb_error *error)
{
    if (!tile_folder->quiet && !tile_folder->silent) {
        fprintf(stderr, "umbrage-bake: notice: --cache: %s\n", error->message);
    }
    tile_folder->silent = 1;
}

/* Makes a tile the current one. */
static void turn_to(struct umbb_tile_folder *tile_folder, const struct umbb_tile_place *place)
{
    tile_folder->shape.occluder_depth_x = (uint32_t)place->x0 / UMB__OCCLUDER_DEPTH_SIDE;
    tile_folder->shape.occluder_depth_y = (uint32_t)place->y0 / UMB__OCCLUDER_DEPTH_SIDE;
}

/* Notes a tile for the self-check and for the next bake's base. In: digest: SHA-256 of its
 * result. */
static enum umb_status note(struct umbb_tile_folder *tile_folder,
                            const struct umbb_tile_place *place, const uint8_t *key,
                            const uint8_t *digest, const struct umbb_tile_nodes *nodes,
                            const struct umbb_tile_result *result, struct umb_error *error)
{
    if (tile_folder->base != NULL) {
        struct umbb_tile_proof proof;
        memcpy(proof.key, key, UMB_ID_BYTES);
        memcpy(proof.result, digest, UMB_ID_BYTES);
        UMB__TRY(umbb_base_note(tile_folder->base, tile_folder->frustum, place->number, &proof,
                                result, nodes->runs, error));
    }
    return tile_folder->proof == NULL ? UMB_OK
                                      : umbb_proofs_note(tile_folder->proof, tile_folder->depth,
                                                         place, key, digest, error);
}

/* Reads and decodes a result that was not read ahead; *found stays 0 if there is no whole one. */
static enum umb_status take(struct umbb_tile_folder *tile_folder,
                            const struct umbb_tile_place *place, const uint8_t *key,
                            const struct umbb_tile_nodes *nodes, struct umbb_tile_result *result,
                            int *found, struct umb_error *error)
{
    struct umb_error cause = {0};
    uint8_t *bytes, digest[UMB_ID_BYTES];
    size_t size;
    /* A third of the memory is for the nodes. */
    enum umb_status status = umbb_tile_cache_read(&tile_folder->cache, key,
                                                  nodes->max_bytes / 3 * 2, &bytes, &size, &cause);
    if (status != UMB_OK) {
        if (tile_folder->mode == UMBB_TILE_FOLDER_MERGE) {
            return umb_fail(error, status, "%s", cause.message);
        }
        notice(tile_folder, &cause);
        return UMB_OK;
    }
    if (bytes != NULL) {
        status = umbb_tile_decode(&tile_folder->shape, bytes, size, nodes, result, error);
        *found = status == UMB_OK;
        if (status == UMB_OK) {
            umbs_sha256_bytes(bytes, size, digest);
            status = note(tile_folder, place, key, digest, nodes, result, error);
        } else if (status == UMB_E_CORRUPT) {
            umbb_tile_cache_drop(&tile_folder->cache, key);
            status = UMB_OK;
        }
    }
    free(bytes);
    return status;
}

static enum umb_status find(void *user, const struct umbb_tile_place *place,
                            const struct umbb_tile_nodes *nodes, struct umbb_tile_result *result,
                            int *found, struct umb_error *error)
{
    struct umbb_tile_folder *tile_folder = user;
    *found = 0;
    turn_to(tile_folder, place);
    const struct umbb_tile_read *read = umbb_tile_ahead_get(tile_folder->ahead, &tile_folder->cache,
                                                            place->number, nodes->max_bytes);
    const uint8_t *key = read->key;
    if (read->base != NULL) {
        *found = 1;
        UMB__TRY(umbb_base_take(tile_folder->base, read->base, nodes->runs, result, error));
        return note(tile_folder, place, key, read->base->proof.result, nodes, result, error);
    }
    if (read->is_whole && tile_folder->proof != NULL &&
        umbb_proofs_contradict(tile_folder->proof, place->number, key, read->digest)) {
        umbb_tile_cache_drop(&tile_folder->cache, key);
    } else if (read->is_whole) {
        *found = 1;
        UMB__TRY(umbb_tile_join(&tile_folder->shape, &read->parsed, nodes, &tile_folder->numbers,
                                result, error));
        return note(tile_folder, place, key, read->digest, nodes, result, error);
    }
    UMB__TRY(take(tile_folder, place, key, nodes, result, found, error));
    if (*found) {
        return UMB_OK;
    }
    if (tile_folder->mode == UMBB_TILE_FOLDER_MERGE) {
        const unsigned long long number = tile_folder->first + place->number;
        return umb_fail(error, UMB_E_BUSY,
                        "tile %llu is not in '%.200s', or was damaged: bake it with "
                        "umbrage-bake tile --only %llu",
                        number, tile_folder->cache.folder, number);
    }
    const unsigned slot = tile_folder->next_missed++ & 1;
    tile_folder->missed[slot].number = place->number;
    memcpy(tile_folder->missed[slot].key, key, UMB_ID_BYTES);
    return UMB_OK;
}

static enum umb_status keep(void *user, const struct umbb_tile_place *place,
                            const struct umbb_tile_nodes *nodes,
                            const struct umbb_tile_result *result, struct umb_error *error)
{
    struct umbb_tile_folder *tile_folder = user;
    const unsigned slot = tile_folder->missed[0].number == place->number ? 0 : 1;
    struct umb_error cause = {0};
    uint8_t *bytes, digest[UMB_ID_BYTES];
    size_t size;
    turn_to(tile_folder, place);
    if (tile_folder->mode == UMBB_TILE_FOLDER_MERGE) {
        return UMB_OK;
    }
    enum umb_status noted = UMB_OK;
    enum umb_status status =
        umbb_tile_encode(&tile_folder->shape, nodes, result, &bytes, &size, &cause);
    const uint8_t *key = tile_folder->missed[slot].key;
    if (status == UMB_OK) {
        umbs_sha256_bytes(bytes, size, digest);
        noted = note(tile_folder, place, key, digest, nodes, result, error);
        status = umbb_tile_cache_write(&tile_folder->cache, key, bytes, size, &cause);
    }
    free(bytes);
    UMB__TRY(noted);
    if (status != UMB_OK && tile_folder->mode == UMBB_TILE_FOLDER_TILE) {
        return umb_fail(error, status, "%s", cause.message);
    }
    if (status != UMB_OK) {
        notice(tile_folder, &cause);
    }
    return UMB_OK;
}

struct umbb_cached_tiles umbb_tile_folder_cached_tiles(struct umbb_tile_folder *tile_folder)
{
    return (struct umbb_cached_tiles){.user = tile_folder, .find = find, .keep = keep};
}

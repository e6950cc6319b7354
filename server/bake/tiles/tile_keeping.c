/* SPDX-License-Identifier: Apache-2.0 */
/* Key, code and cache put together. */
#include "bake/tiles/tile_keeping.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "bake/tiles/tile_key.h"

enum umb_status umbb_tile_keeping_open(struct umbb_tile_keeping *keeping,
                                       enum umbb_keeping_mode mode, const char *folder,
                                       uint64_t max_bytes, struct umb_error *error)
{
    memset(keeping, 0, sizeof *keeping);
    keeping->mode = mode;
    if (mode == UMBB_KEEPING_MERGE && access(folder, R_OK | X_OK) != 0) {
        return umb_fail_errno(error, UMB_E_NO_INPUT, errno, "--from: cannot read '%.200s'", folder);
    }
    return umbb_tile_cache_open(&keeping->cache, folder, max_bytes, error);
}

void umbb_tile_keeping_close(struct umbb_tile_keeping *keeping)
{
    umbb_tile_cache_close(&keeping->cache);
}

void umbb_tile_keeping_frustum(struct umbb_tile_keeping *keeping, uint32_t frustum,
                               const struct umbb_tile_shape *shape, const struct umbb_depth *depth)
{
    keeping->depth = depth;
    keeping->shape = *shape;
    keeping->frustum = frustum;
    keeping->first = (uint64_t)frustum << (2 * (shape->log2_size - shape->tile_log2));
    keeping->missed[0].number = keeping->missed[1].number = UINT32_MAX;
}

/* Says once that the cache does not help. */
static void notice(struct umbb_tile_keeping *keeping, const struct umb_error *error)
{
    if (!keeping->quiet && !keeping->silent) {
        fprintf(stderr, "umbrage-bake: notice: --cache: %s\n", error->message);
    }
    keeping->silent = 1;
}

/* Turns to a tile. */
static void turn_to(struct umbb_tile_keeping *keeping, const struct umbb_tile_place *place)
{
    keeping->shape.front_x = (uint32_t)place->x0 / UMB_FRONT_SIDE;
    keeping->shape.front_y = (uint32_t)place->y0 / UMB_FRONT_SIDE;
}

/* Reads and decodes; found stays 0 if there is nothing whole. */
static enum umb_status take(struct umbb_tile_keeping *keeping, const uint8_t *key, size_t max_bytes,
                            struct umb_pool *pool, struct umbb_runs *runs,
                            struct umbb_tile_result *result, int *found, struct umb_error *error)
{
    struct umb_error cause = {0};
    uint8_t *bytes;
    size_t size;
    enum umb_status status =
        umbb_tile_cache_read(&keeping->cache, key, max_bytes, &bytes, &size, &cause);
    if (status != UMB_OK) {
        if (keeping->mode == UMBB_KEEPING_MERGE) {
            return umb_fail(error, status, "%s", cause.message);
        }
        notice(keeping, &cause);
        return UMB_OK;
    }
    if (bytes != NULL) {
        status = umbb_tile_decode(&keeping->shape, bytes, size, pool, runs, result, error);
        *found = status == UMB_OK;
        if (status == UMB_E_CORRUPT) {
            umbb_tile_cache_drop(&keeping->cache, key);
            status = UMB_OK;
        }
    }
    free(bytes);
    return status;
}

static enum umb_status find(void *user, const struct umbb_tile_place *place, size_t max_bytes,
                            struct umb_pool *pool, struct umbb_runs *runs,
                            struct umbb_tile_result *result, int *found, struct umb_error *error)
{
    struct umbb_tile_keeping *keeping = user;
    uint8_t key[UMB_ID_BYTES];
    *found = 0;
    turn_to(keeping, place);
    umbb_tile_key(keeping->depth, &keeping->shape, place, key);
    const enum umb_status status = take(keeping, key, max_bytes, pool, runs, result, found, error);
    if (status != UMB_OK) {
        return status;
    }
    keeping->found += *found != 0;
    if (!*found && keeping->mode == UMBB_KEEPING_MERGE) {
        return umb_fail(error, UMB_E_BUSY,
                        "tile %llu is not in '%.200s', or was damaged: bake it with "
                        "umbrage-bake tile --only %llu",
                        (unsigned long long)(keeping->first + place->number), keeping->cache.folder,
                        (unsigned long long)(keeping->first + place->number));
    }
    if (!*found) {
        const unsigned slot = keeping->next_missed++ & 1;
        keeping->missed[slot].number = place->number;
        memcpy(keeping->missed[slot].key, key, sizeof key);
    }
    return UMB_OK;
}

static enum umb_status keep(void *user, const struct umbb_tile_place *place, size_t max_bytes,
                            const struct umb_pool *pool, const struct umbb_runs *runs,
                            const struct umbb_tile_result *result, struct umb_error *error)
{
    struct umbb_tile_keeping *keeping = user;
    const unsigned slot = keeping->missed[0].number == place->number ? 0 : 1;
    struct umb_error cause = {0};
    uint8_t *bytes;
    size_t size;
    keeping->baked++;
    turn_to(keeping, place);
    if (keeping->mode == UMBB_KEEPING_MERGE) {
        return UMB_OK;
    }
    enum umb_status status =
        umbb_tile_encode(&keeping->shape, pool, runs, result, max_bytes, &bytes, &size, &cause);
    if (status == UMB_OK) {
        status =
            umbb_tile_cache_write(&keeping->cache, keeping->missed[slot].key, bytes, size, &cause);
    }
    free(bytes);
    if (status != UMB_OK && keeping->mode == UMBB_KEEPING_TILE) {
        return umb_fail(error, status, "%s", cause.message);
    }
    if (status != UMB_OK) {
        notice(keeping, &cause);
    }
    return UMB_OK;
}

struct umbb_tile_keeper umbb_tile_keeping_keeper(struct umbb_tile_keeping *keeping)
{
    return (struct umbb_tile_keeper){.user = keeping, .find = find, .keep = keep};
}

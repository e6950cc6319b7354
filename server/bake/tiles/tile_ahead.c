/* SPDX-License-Identifier: Apache-2.0 */
/* See tile_ahead.h. Tiles are read in groups: the next group starts when the owner asks for its
 * first tile. */
#include "bake/tiles/tile_ahead.h"

#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "bake/tiles/tile_folder.h"
#include "common/sha256.h"
#include "tool/threads.h"

enum {
    GROUP = 16, /* tiles that are read together */
    PARTS = 4,  /* file, result, its nodes and their tables: each takes as much as the result */
};

struct slot {
    struct umbb_tile_read read;
    struct umbb_tile_cache cache; /* the folder's, with a count of its own */
    atomic_int is_done;
};

struct umbb_tile_ahead {
    struct umbu_threads *threads;
    const struct umbb_depth *depth;
    struct umbb_tile_shape shape;
    uint32_t frustum;
    const struct umbb_base *base; /* NULL: none */
    uint32_t first, end;          /* tiles of the group; empty at first */
    size_t max_bytes;             /* of one tile */
    atomic_int ended;             /* 1: tiles of the group that were not begun are left out */
    struct slot slots[GROUP];
};

enum umb_status umbb_tile_ahead_create(unsigned threads, struct umbb_tile_ahead **out,
                                       struct umb_error *error)
{
    struct umbb_tile_ahead *ahead = *out = calloc(1, sizeof *ahead);
    if (ahead == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "tile cache: memory refused");
    }
    for (size_t i = 0; i < GROUP; i++) {
        umb__pool_init_loose(&ahead->slots[i].read.parsed.pool, NULL, SIZE_MAX);
    }
    return umbu_threads_create(threads, &ahead->threads, error);
}

void umbb_tile_ahead_destroy(struct umbb_tile_ahead *ahead)
{
    if (ahead == NULL) {
        return;
    }
    umbu_threads_destroy(ahead->threads);
    for (size_t i = 0; i < GROUP; i++) {
        umbb_tile_parsed_finish(&ahead->slots[i].read.parsed);
        free(ahead->slots[i].read.bytes);
    }
    free(ahead);
}

void umbb_tile_ahead_begin(struct umbb_tile_ahead *ahead, const struct umbb_depth *depth,
                           const struct umbb_tile_shape *shape, uint32_t frustum,
                           const struct umbb_base *base)
{
    ahead->depth = depth;
    ahead->frustum = frustum;
    ahead->base = base;
    ahead->shape = *shape;
    ahead->first = ahead->end = 0;
    atomic_store(&ahead->ended, 0);
}

void umbb_tile_ahead_end(struct umbb_tile_ahead *ahead)
{
    atomic_store(&ahead->ended, 1);
    umbu_threads_wait(ahead->threads, NULL, NULL);
    ahead->depth = NULL;
    ahead->first = ahead->end = 0;
}

/* Reads a tile's result. */
static void read_result(const struct umbb_tile_ahead *ahead, struct slot *slot)
{
    struct umbb_tile_read *read = &slot->read;
    struct umb_error cause;
    size_t size;
    if (umbb_tile_cache_read(&slot->cache, read->key, 2 * (ahead->max_bytes / PARTS), &read->bytes,
                             &size, &cause) != UMB_OK ||
        read->bytes == NULL) {
        return;
    }
    const enum umb_status status =
        umbb_tile_parse(&ahead->shape, read->bytes, size, &read->parsed, &cause);
    if (status == UMB_OK) {
        umbs_sha256_bytes(read->bytes, size, read->digest);
        read->is_whole = 1;
    } else if (status == UMB_E_CORRUPT) {
        umbb_tile_cache_drop(&slot->cache, read->key);
    }
}

/* Reads tile number `slice` of the group. */
static void read_job(void *user, uint32_t slice, unsigned thread)
{
    struct umbb_tile_ahead *ahead = user;
    struct slot *slot = &ahead->slots[slice];
    const struct umbb_tile_place place = umbb_tile_place_of(&ahead->shape, ahead->first + slice);
    (void)thread;
    if (atomic_load_explicit(&ahead->ended, memory_order_relaxed)) {
        return;
    }
    umbb_tile_key(ahead->depth, &ahead->shape, &place, slot->read.key);
    slot->read.base = ahead->base != NULL ? umbb_base_find(ahead->base, ahead->frustum,
                                                           place.number, slot->read.key)
                                          : NULL;
    if (slot->read.base == NULL) {
        read_result(ahead, slot);
    }
    atomic_store_explicit(&slot->is_done, 1, memory_order_release);
}

static int is_done(void *user)
{
    return atomic_load_explicit((atomic_int *)user, memory_order_acquire);
}

/* Starts the group that begins with a tile. */
static void start(struct umbb_tile_ahead *ahead, const struct umbb_tile_cache *cache,
                  uint32_t number, size_t max_bytes)
{
    const uint32_t count = 1U << (2 * (ahead->shape.log2_size - ahead->shape.tile_log2));
    const uint32_t left = count - number;
    umbu_threads_wait(ahead->threads, NULL, NULL);
    ahead->first = number;
    ahead->end = number + (left < GROUP ? left : GROUP);
    ahead->max_bytes = max_bytes / GROUP;
    for (size_t i = 0; i < GROUP; i++) {
        struct slot *slot = &ahead->slots[i];
        umbb_tile_parsed_clear(&slot->read.parsed);
        free(slot->read.bytes);
        slot->read.bytes = NULL;
        slot->read.is_whole = 0;
        slot->read.base = NULL;
        slot->cache = *cache;
        slot->cache.damaged = 0;
        atomic_store(&slot->is_done, 0);
    }
    umbu_threads_start(ahead->threads, read_job, ahead, ahead->end - ahead->first);
}

const struct umbb_tile_read *umbb_tile_ahead_get(struct umbb_tile_ahead *ahead,
                                                 struct umbb_tile_cache *cache, uint32_t number,
                                                 size_t max_bytes)
{
    if (number < ahead->first || number >= ahead->end) {
        start(ahead, cache, number, max_bytes);
    }
    struct slot *slot = &ahead->slots[number - ahead->first];
    umbu_threads_wait_until(ahead->threads, is_done, &slot->is_done);
    cache->damaged += slot->cache.damaged;
    slot->cache.damaged = 0;
    return &slot->read;
}

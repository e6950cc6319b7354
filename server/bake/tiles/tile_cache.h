/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_TILES_TILE_CACHE_H
#define UMBRAGE_SERVER_BAKE_TILES_TILE_CACHE_H
/*
 * A folder of tile results, one file each, named by their key.
 *
 *     umbb_tile_cache_open(&cache, "tiles", max_bytes, &error);
 *     umbb_tile_cache_read(&cache, key, max_bytes, &bytes, &size, &error);
 *     umbb_tile_cache_write(&cache, key, bytes, size, &error);
 *     umbb_tile_cache_close(&cache);
 *
 * File: KEY.umbt, KEY in hexadecimal: magic "UMBTIL1\n", the key (32 bytes), the result's size
 * (uint64), XXH3-64 of those 48 bytes followed by the rest (uint64), then the result (tile_code.h)
 * as one zstd frame. All little-endian.
 *
 * A file appears whole or not at all (tool/output.h). So a killed bake leaves only whole results
 * and at most one temporary file. Opening the folder removes temporaries that are older than a
 * minute. The checksum shows damage: the file is removed and the tile baked again. The content of
 * results is trusted: give write access only to users that may decide what is baked.
 *
 * Size: when the results exceed max_bytes, the least recently used ones are removed until a tenth
 * of max_bytes is free.
 * Threads and processes: one cache a thread. Any number of processes may share a folder: equal keys
 * mean equal bytes, and a missing file is baked again. Each process counts only its own additions,
 * so several may exceed the limit together until one of them reads the folder again.
 */
#include <stddef.h>
#include <stdint.h>
#include "umbrage/asset.h"

struct umbb_tile_cache {
    char *folder;
    uint64_t max_bytes; /* UINT64_MAX: no limit, no file is removed for room */
    uint64_t bytes;     /* size of all results, as far as known */
    uint64_t damaged;   /* files found damaged and removed */
};

/* Opens a folder, which is created if missing, and removes old temporaries and surplus results.
 * Fails: E_CANNOT_CREATE, E_IO, E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbb_tile_cache_open(struct umbb_tile_cache *cache, const char *folder,
                                                 uint64_t max_bytes, struct umb_error *error);
void umbb_tile_cache_close(struct umbb_tile_cache *cache);

/*
 * Reads a result.
 *
 * In:    max_bytes: limit of the result.
 * Out:   bytes: malloced; NULL if there is no result, or only a damaged one (which is removed).
 * Fails: E_LIMIT (max_bytes), E_NO_MEMORY, E_IO.
 * Trust: safe on hostile bytes.
 */
UMB_CHECKED enum umb_status umbb_tile_cache_read(struct umbb_tile_cache *cache,
                                                 const uint8_t key[UMB_ID_BYTES], size_t max_bytes,
                                                 uint8_t **bytes, size_t *size,
                                                 struct umb_error *error);

/* Marks a result as used now, if it is there. */
void umbb_tile_cache_touch(const struct umbb_tile_cache *cache, const uint8_t key[UMB_ID_BYTES]);

/* Removes a result that proved to be damaged. */
void umbb_tile_cache_drop(struct umbb_tile_cache *cache, const uint8_t key[UMB_ID_BYTES]);

/* Writes a result, durably. A result above the limit of the whole cache is not written.
 * Fails: E_CANNOT_CREATE, E_IO, E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbb_tile_cache_write(struct umbb_tile_cache *cache,
                                                  const uint8_t key[UMB_ID_BYTES],
                                                  const uint8_t *bytes, size_t size,
                                                  struct umb_error *error);

#endif

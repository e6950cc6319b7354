/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_TILES_TILE_SWEEP_H
#define UMBRAGE_SERVER_BAKE_TILES_TILE_SWEEP_H
/* Tidying up a folder of tile results: removes old temporaries, and makes room. */
#include <stdint.h>
#include "umbrage/status.h"

#define UMBB_TILE_SUFFIX ".umbt"

/* Age in seconds at which a temporary was left by a killed process: writing one takes seconds. */
#define UMBB_TILE_STALE_S 60

/*
 * Removes old temporaries. If all results together are larger than max_bytes, it also removes the
 * least recently used ones until keep_bytes are left.
 *
 * Out:   bytes: size of the results that are left.
 * Fails: E_IO (the folder cannot be read), E_NO_MEMORY. A file that cannot be removed is left.
 * Cost:  one stat of each file in the folder.
 */
UMB_CHECKED enum umb_status umbb_tile_sweep(const char *folder, uint64_t max_bytes,
                                            uint64_t keep_bytes, uint64_t *bytes,
                                            struct umb_error *error);

#endif

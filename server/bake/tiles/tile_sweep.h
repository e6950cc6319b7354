/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_TILES_TILE_SWEEP_H
#define UMBRAGE_SERVER_BAKE_TILES_TILE_SWEEP_H
/* Tidying up a folder of tile results: old temporaries, and room. */
#include <stdint.h>
#include "umbrage/status.h"

#define UMBB_TILE_SUFFIX ".umbt"

/* A temporary this old was left by a process that was killed: writing one takes seconds. */
#define UMBB_TILE_STALE_S 60

/*
 * Removes old temporaries, and, if all results together are larger than max_bytes, those that were
 * used longest ago until they are not larger than keep_bytes.
 *
 * Out:   bytes: of the results that are left.
 * Fails: E_IO (the folder cannot be read), E_NO_MEMORY. A file that cannot be removed is left.
 * Cost:  one look at each file of the folder.
 */
UMB_CHECKED enum umb_status umbb_tile_sweep(const char *folder, uint64_t max_bytes,
                                            uint64_t keep_bytes, uint64_t *bytes,
                                            struct umb_error *error);

#endif

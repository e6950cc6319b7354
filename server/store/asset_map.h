/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STORE_ASSET_MAP_H
#define UMBRAGE_SERVER_STORE_ASSET_MAP_H
/*
 * A mapped asset file (.umbm) that stays harmless whatever other processes do to the file.
 *
 *     struct umbs_asset_map *map;
 *     umbs_asset_map_open(path, &options, &map, &error);
 *     ... umb_query_prepare on umbs_asset_map_asset(map) ...
 *     umbs_asset_map_read(map, run, &batch, &error);          runs the query, guarded
 *     umbs_asset_map_close(map);
 *
 * Changes of the file, and their effect on a read:
 * - The file is cut short: the read faults and is ended by the guard (fault_guard.h), or the rest
 *   of a page reads as zeros. In both cases umbs_asset_map_read fails, because after each read it
 *   compares the file's size and modification time with those at the opening.
 * - The file is overwritten in place: the same comparison finds the change. A node number read
 *   meanwhile may be wrong, but leads no further than the address space reserved without access
 *   after the map. A read there faults and is ended by the guard too.
 * - The bytes change while size and time stay (a failing disk, a clock set back, a write through a
 *   mapping that was dirty before): only umbs_asset_map_check finds such a change.
 * - The file is deleted or replaced by a rename: no effect; the map keeps the old bytes.
 *
 * With `copy` the file is read once into memory of this process, which is then write-protected:
 * later changes of the file have no effect.
 *
 * Threads: an open map is immutable. Reads and checks may run at the same time; close only when
 * none runs.
 */
#include <stddef.h>
#include <stdint.h>
#include <sys/stat.h>
#include <time.h>
#include "umbrage/asset.h"

struct umbs_asset_map; /* opaque */

/* Stamp of a file: equal stamps mean an unchanged file. */
struct umbs_stamp {
    uint64_t device, inode, size;
    struct timespec modified, changed;
};

struct umbs_stamp umbs_stamp_of(const struct stat *status);
int umbs_stamp_equal(const struct umbs_stamp *a, const struct umbs_stamp *b);

struct umbs_asset_map_options {
    uint8_t id[UMB_ID_BYTES]; /* Id of the asset that the file must hold */
    /* Stamp that the file had when it passed a full check, or NULL. If the stamp is unchanged,
     * opening checks only the head. Copies are always checked in full. */
    const struct umbs_stamp *known;
    /* SHA-256 of the whole file, [UMB_ID_BYTES], or NULL. A full check compares it. */
    const uint8_t *digest;
    int ours; /* 1 = a link, or a file that other users may write to, is refused */
    int copy; /* 1 = a copy is held in memory */
    int warm; /* 1 = the kernel reads the file ahead */
};

/*
 * Opens a mapped file and checks that it is the expected asset.
 *
 * Out:   out: the map, or NULL.
 * Fails: as umb_asset_open_file; E_CORRUPT also if the file is another asset's, is packed, does not
 *        have the digest, or changes while it is checked; E_PERMISSION if the file must be ours and
 *        is not.
 * Cost:  blocks on the disk: one pass over the file, or over its head if the stamp is known.
 */
UMB_CHECKED enum umb_status umbs_asset_map_open(const char *path,
                                                const struct umbs_asset_map_options *options,
                                                struct umbs_asset_map **out,
                                                struct umb_error *error);

/* Releases memory and descriptor. NULL is allowed. */
void umbs_asset_map_close(struct umbs_asset_map *map);

/* Returns the asset, borrowed until close. Its description may be read at any time, its voxels only
 * inside umbs_asset_map_read (umb_query_run reads voxels). */
const struct umb_asset *umbs_asset_map_asset(const struct umbs_asset_map *map);

/* 1 if the bytes are a copy: changes of the file have no effect on it. */
int umbs_asset_map_is_copy(const struct umbs_asset_map *map);

/* Expected SHA-256 of the file, or NULL. */
const uint8_t *umbs_asset_map_digest(const struct umbs_asset_map *map);

/* Stamp of the file at its opening. */
const struct umbs_stamp *umbs_asset_map_stamp(const struct umbs_asset_map *map);

/*
 * Calls read(user), which may read the asset's voxels and must not own anything (fault_guard.h).
 *
 * Fails: E_CORRUPT if the file was cut or changed since it was opened; discard the results of read
 *        then. A fault may have ended read midway.
 * Cost:  10 ns and one fstat, 0.2 us; with copy nothing.
 */
UMB_CHECKED enum umb_status umbs_asset_map_read(const struct umbs_asset_map *map,
                                                void (*read)(void *user), void *user,
                                                struct umb_error *error);

/*
 * umbs_asset_map_read in two steps, an optimistic read and a revalidation, for many small reads.
 * Use the results of optimistic reads only after a revalidation that followed all of them
 * succeeded. Each step fails as umbs_asset_map_read does.
 */
UMB_CHECKED enum umb_status umbs_asset_map_read_optimistic(const struct umbs_asset_map *map,
                                                           void (*read)(void *user), void *user,
                                                           struct umb_error *error);
UMB_CHECKED enum umb_status umbs_asset_map_revalidate(const struct umbs_asset_map *map,
                                                      struct umb_error *error);

/*
 * Checks the whole file again: by its digest, or, if there is none, by checksums, structure and
 * identity. Fails: E_CORRUPT and the like, E_IO, E_NO_MEMORY.
 * Cost:  one pass over the file (1 GB/s or more).
 */
UMB_CHECKED enum umb_status umbs_asset_map_check(const struct umbs_asset_map *map,
                                                 struct umb_error *error);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_COMMON_STORE_RECORD_H
#define UMBRAGE_SERVER_COMMON_STORE_RECORD_H
/*
 * What a store has proven before: for each packed file, told by its stamp, the id that its content
 * was proven to have and the stamp of the mapped file that passed a full check. As long as both
 * files still look so, opening the asset takes its head and nothing else.
 *
 * Kept as `.umbrage-cache/proven`, one line a file and a checksum at the end. The list is a memory,
 * not a source of truth: missing, damaged or old, it costs one more proof.
 *
 *     umbrage proven 1
 *     ID  DEVICE INODE SIZE MTIME NS CTIME NS  DEVICE INODE SIZE MTIME NS CTIME NS
 *     end XXH3-64 of all lines before, 16 hexadecimal digits
 *
 * Trust: who can write to the cache folder is believed (store.h). The lines are parsed with care
 * all the same.
 */
#include "common/asset_map.h"

#define UMBS_RECORDS_MAX ((size_t)1 << 20) /* files in one folder that are remembered */

struct umbs_record {
    uint8_t id[UMB_ID_BYTES];
    struct umbs_stamp packed, mapped;
};

struct umbs_records {
    size_t count, capacity;
    struct umbs_record *list;
};

/* Appends a record. Fails: E_NO_MEMORY (the list stays as it was). */
UMB_CHECKED enum umb_status umbs__records_add(struct umbs_records *records,
                                              const struct umbs_record *record);

/* The record of a packed file, or NULL. */
const struct umbs_record *umbs__records_find(const struct umbs_records *records,
                                             const struct umbs_stamp *packed);

/* True if both lists say the same in the same order. */
int umbs__records_equal(const struct umbs_records *a, const struct umbs_records *b);

/* Reads a list; a missing file is an empty one. Fails: E_CORRUPT, E_IO, E_NO_MEMORY: it is empty.
 */
UMB_CHECKED enum umb_status umbs__records_read(const char *path, struct umbs_records *records,
                                               struct umb_error *error);

/* Replaces the file. Fails: as umbs_file_*. */
UMB_CHECKED enum umb_status
umbs__records_write(const char *path, const struct umbs_records *records, struct umb_error *error);

void umbs__records_finish(struct umbs_records *records);

#endif

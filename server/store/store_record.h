/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STORE_STORE_RECORD_H
#define UMBRAGE_SERVER_STORE_STORE_RECORD_H
/*
 * Records of proven files. For each packed file, identified by its stamp, a record has three parts:
 * its verified id, the stamp of the mapped file that passed a full check, and that file's SHA-256.
 * As long as both files have these stamps, opening the asset reads its head and nothing else.
 *
 * The records are the file `proven` in the cache folder, one line for each packed file. Each line
 * ends with its HMAC-SHA256 under the cache's key, so only the daemon's user and root can write a
 * valid line; other lines are left out. The list only saves work: a missing line costs one more
 * verification.
 *
 *     umbrage proven 2
 *     ID DIGEST  STAMP  STAMP  MAC
 *
 * A stamp is DEVICE INODE SIZE MTIME NS CTIME NS. The packed file's stamp is the first of the two.
 */
#include "store/asset_map.h"
#include "common/sha256.h"

#define UMBS_RECORDS_MAX ((size_t)1 << 20) /* limit of records in one folder */

struct umbs_record {
    uint8_t id[UMB_ID_BYTES];
    uint8_t digest[UMB_ID_BYTES]; /* SHA-256 of the mapped file */
    struct umbs_stamp packed, mapped;
};

struct umbs_records {
    size_t count, capacity;
    struct umbs_record *list;
    uint32_t *places;   /* Hash table by the packed file's stamp, [place_count]: index in `list`
                           plus 1; 0 = empty */
    size_t place_count; /* a power of 2, at least twice as many as there are records */
};

/* Appends a record. Fails: E_NO_MEMORY (the list stays as it was). */
UMB_CHECKED enum umb_status umbs__records_add(struct umbs_records *records,
                                              const struct umbs_record *record);

/* The record of a packed file, or NULL. */
const struct umbs_record *umbs__records_find(const struct umbs_records *records,
                                             const struct umbs_stamp *packed);

/* The first record of an id, or NULL: walks the list. */
const struct umbs_record *umbs__records_of_id(const struct umbs_records *records,
                                              const uint8_t id[UMB_ID_BYTES]);

/* True if both lists say the same in the same order. */
int umbs__records_equal(const struct umbs_records *a, const struct umbs_records *b);

/*
 * Reads a list; a missing file is an empty list.
 *
 * Out:   refused: number of lines without a valid MAC, which are left out.
 * Fails: E_CORRUPT (not a list of this version), E_IO, E_PERMISSION (another user may write to the
 *        file), E_NO_MEMORY; the list is then empty.
 */
UMB_CHECKED enum umb_status umbs__records_read(const char *path, const uint8_t key[UMBS_KEY_BYTES],
                                               struct umbs_records *records, size_t *refused,
                                               struct umb_error *error);

/* Replaces the file. Fails: as umbu_output_replace. */
UMB_CHECKED enum umb_status umbs__records_write(const char *path, const uint8_t key[UMBS_KEY_BYTES],
                                                const struct umbs_records *records,
                                                struct umb_error *error);

void umbs__records_finish(struct umbs_records *records);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_JOBS_UPLOAD_H
#define UMBRAGE_SERVER_JOBS_UPLOAD_H
/*
 * Upload of a bundle. The bundle's files arrive in the manifest's order, and are written to an
 * empty folder and hashed. When every byte agrees with the manifest and is durable, the folder gets
 * its final name, the key.
 *
 * Durability: a bundle of a few files is synced file by file, a larger one by one syncfs for all.
 * Then the folders, the rename and the folder of bundles are synced. Only then may a job use the
 * bundle.
 *
 *     umbj_upload_begin(folder, &manifest, key, stop, &upload, &error);
 *     umbj_upload_write(upload, bytes, count, &error);          any number of times
 *     umbj_upload_accept(upload, &error);
 *     umbj_upload_discard(upload);               removes an upload that was not accepted
 *     umbj_upload_destroy(upload);
 *
 * Folders of a jobs folder: incoming/RANDOM, bundles/KEY, work/JOB.EPOCH.
 * Threads: one at a time. All but begin block on the disk.
 */
#include <stdatomic.h>

#include "jobs/bundle.h"

struct umbj_upload; /* opaque */

/* Begins an upload. In: folder: the jobs folder, borrowed. manifest: checked; it is copied. stop:
 * flag that ends writing soon, NULL = none. Fails: E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbj_upload_begin(const char *folder,
                                              const struct umbj_manifest *manifest,
                                              const uint8_t key[UMBJ_HASH_BYTES],
                                              const atomic_int *stop, struct umbj_upload **out,
                                              struct umb_error *error);

/* Writes the next bytes of the bundle. Fails: E_ARGUMENT (more bytes than the manifest says, a
 * wrong hash, a file with the name of a folder), E_IO, E_LIMIT (disk full), E_UNAVAILABLE (`stop`
 * was set). */
UMB_CHECKED enum umb_status umbj_upload_write(struct umbj_upload *upload, const void *bytes,
                                              size_t count, struct umb_error *error);

/* Syncs the bundle and gives it its name, unless it has its name already. Fails: E_ARGUMENT (bytes
 * are missing), E_IO, E_LIMIT, E_UNAVAILABLE. */
UMB_CHECKED enum umb_status umbj_upload_accept(struct umbj_upload *upload, struct umb_error *error);

/*
 * Begins to remove an accepted bundle: renames it in one step. So an interrupted removal leaves
 * nothing that a later upload of the key would take for complete.
 *
 * In:    jobs: descriptor of the jobs folder.
 * Out:   gone: path in the jobs folder that the caller must remove; "" if there is no bundle.
 * Returns 0; or -1 with errno, and the bundle is unchanged.
 */
#define UMBJ_GONE_SIZE 128
int umbj_bundle_take_away(int jobs, const uint8_t key[UMBJ_HASH_BYTES], char gone[UMBJ_GONE_SIZE]);

/* Removes the files of an upload that was not accepted. If `stop` was set, files may stay, which
 * the next start removes. NULL is allowed. */
void umbj_upload_discard(struct umbj_upload *upload);

/* Forgets the stop flag and leaves the files to the next start. */
void umbj_upload_leave(struct umbj_upload *upload);

/* Adds a holder: the upload's memory stays until every holder has released it. */
void umbj_upload_hold(struct umbj_upload *upload);
void umbj_upload_let_go(struct umbj_upload *upload);

/* Discards the upload and releases it: the last holder frees it. NULL is allowed. */
void umbj_upload_destroy(struct umbj_upload *upload);

#endif

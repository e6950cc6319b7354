/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_JOBS_UPLOAD_H
#define UMBRAGE_SERVER_JOBS_UPLOAD_H
/*
 * A bundle on its way in: its files, one behind the other in the manifest's order, are written to
 * an empty folder and hashed; only when every byte agreed with the manifest and is durable does the
 * folder get its name, the key.
 *
 *     umbj_upload_begin(&folders, &manifest, &upload, &error);
 *     umbj_upload_write(upload, bytes, count, &error);          as they come
 *     umbj_upload_accept(upload, &error);
 *     umbj_upload_destroy(upload);                              removes what was not accepted
 *
 * Folders of a jobs folder: incoming/RANDOM, bundles/KEY, work/JOB.EPOCH.
 * Threads: one at a time. Blocks on the disk.
 */
#include "jobs/bundle.h"

struct umbj_upload; /* opaque */

/* In: folder: the jobs folder. manifest: checked; copied. Fails: E_IO, E_LIMIT (disk full),
 * E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbj_upload_begin(const char *folder,
                                              const struct umbj_manifest *manifest,
                                              const uint8_t key[UMBJ_HASH_BYTES],
                                              struct umbj_upload **out, struct umb_error *error);

/* Takes the next bytes. Fails: E_ARGUMENT (more than the manifest says, a hash that does not fit,
 * a file that is also a folder), E_IO, E_LIMIT. */
UMB_CHECKED enum umb_status umbj_upload_write(struct umbj_upload *upload, const void *bytes,
                                              size_t count, struct umb_error *error);

/* Gives the bundle its name; harmless if it is there already. Fails: E_ARGUMENT (bytes are
 * missing), E_IO, E_LIMIT. */
UMB_CHECKED enum umb_status umbj_upload_accept(struct umbj_upload *upload, struct umb_error *error);

/* Takes an accepted bundle out of its place in one step, then removes it: a removal that is cut
 * short leaves nothing that a later upload of the key would take for whole. In: jobs: descriptor of
 * the jobs folder. Returns 0, also if there is none, or -1 with errno: it stays whole. */
int umbj_bundle_remove(int jobs, const uint8_t key[UMBJ_HASH_BYTES]);

/* NULL is allowed. */
void umbj_upload_destroy(struct umbj_upload *upload);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_JOBS_STAGING_H
#define UMBRAGE_SERVER_JOBS_STAGING_H
/*
 * Staging turns a worker's file into a file that the store may serve. The file is copied into the
 * folder of its final place, synced, read again and verified (SHA-256 of head and pages against the
 * id). Then it may get its name, ID.umb. Nothing that a worker wrote is trusted, not even its id.
 */
#include "tool/output.h"
#include "jobs/job.h"

/*
 * Stages a file of at most `most` bytes. Machines of a farm have no other limit.
 *
 * Out:   staged: to be committed or abandoned by the caller, even if the folder already has a file
 *        of that id: the steps must not depend on other owners. asset: the id.
 * Fails: E_TOO_LARGE, E_CORRUPT, E_FORMAT (no asset), E_IO, E_LIMIT (disk full), E_CANNOT_CREATE,
 *        E_NO_MEMORY; staged is then not begun.
 * Cost:  reads the file twice, writes it once.
 */
UMB_CHECKED enum umb_status umbj_stage(const char *path, uint64_t most, const char *folder,
                                       struct umbu_output *staged, uint8_t asset[UMBJ_HASH_BYTES],
                                       struct umb_error *error);

/* Path of an asset in the folder of jobs' assets. */
void umbj_asset_path(const char *folder, const uint8_t asset[UMBJ_HASH_BYTES], char *path,
                     size_t size);

#endif

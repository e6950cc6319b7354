/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_JOBS_STAGING_H
#define UMBRAGE_SERVER_JOBS_STAGING_H
/*
 * Staging: from a worker's file to one that the store may serve. The file is copied beside its
 * final place, synced, read again and proven (SHA-256 of head and pages against the id); then it
 * may get its name, ID.umb. Nothing that a worker wrote is trusted, not even its id.
 */
#include "tool/output.h"
#include "jobs/job.h"

/*
 * Stages a file of at most `most` bytes: machines of a farm have no limit of their own.
 *
 * Out:   staged: to be committed or abandoned by the caller, also if a file of that id is in the
 *        folder already: the steps must not depend on other owners. asset: the id.
 * Fails: E_TOO_LARGE, E_CORRUPT, E_FORMAT (no asset), E_IO, E_LIMIT (disk full), E_CANNOT_CREATE,
 *        E_NO_MEMORY: staged is not begun.
 * Cost:  reads the file twice, writes it once.
 */
UMB_CHECKED enum umb_status umbj_stage(const char *path, uint64_t most, const char *folder,
                                       struct umbu_output *staged, uint8_t asset[UMBJ_HASH_BYTES],
                                       struct umb_error *error);

/* Path of an asset in the folder of jobs' assets. */
void umbj_asset_path(const char *folder, const uint8_t asset[UMBJ_HASH_BYTES], char *path,
                     size_t size);

#endif

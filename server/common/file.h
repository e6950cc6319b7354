/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_COMMON_FILE_H
#define UMBRAGE_SERVER_COMMON_FILE_H
/*
 * Files that appear whole or not at all: write a temporary beside the target, fsync, rename, fsync
 * the folder. A crash at any step leaves the old file or the new one, and at most a stray `.tmp.`
 * file that the store sweeps. A failed fsync is never tried again: the temporary goes.
 */
#include <sys/types.h>
#include <stdio.h>
#include "format/content.h"

struct umbs_file {
    int fd;
    char *path;       /* path of the target */
    char *temporary;  /* path of the temporary, beside the target */
    int system_error; /* errno of the first failed write, else 0; commit then refuses */
    int unsynced;     /* 1: commit syncs nothing, for many files whose caller syncs them together */
};

/*
 * Checks whether path can be replaced, so that long work does not find out at its end. Writes
 * nothing. Fails: E_CANNOT_CREATE where umbs_file_begin would.
 */
UMB_CHECKED enum umb_status umbs_file_check(const char *path, struct umb_error *error);

/* Starts a replacement of path. Fails: E_CANNOT_CREATE. */
UMB_CHECKED enum umb_status umbs_file_begin(const char *path, struct umbs_file *file,
                                            struct umb_error *error);

/* Starts a replacement with a file that only this user may read or write, whatever the umask. */
UMB_CHECKED enum umb_status umbs_file_begin_private(const char *path, struct umbs_file *file,
                                                    struct umb_error *error);

/* Appends bytes. Fails: E_IO (disk full and the like); then call umbs_file_abandon. */
UMB_CHECKED enum umb_status umbs_file_write(struct umbs_file *file, const void *bytes, size_t count,
                                            struct umb_error *error);

/* Makes the new content durable and visible. On failure the temporary is removed. */
UMB_CHECKED enum umb_status umbs_file_commit(struct umbs_file *file, struct umb_error *error);

/* Removes the temporary. Harmless after commit and on a zeroed struct. */
void umbs_file_abandon(struct umbs_file *file);

/* A core sink that appends to a file being replaced. */
struct umb_sink umbs_file_sink(struct umbs_file *file);

#endif

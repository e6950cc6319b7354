/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_COMMON_FILE_SYSTEM_H
#define UMBRAGE_SERVER_COMMON_FILE_SYSTEM_H
/* Closing and reading files, and the kind of file system that a file is on. */
#include <stdint.h>
#include <sys/types.h>
#include "umbrage/status.h"

/* Closes a descriptor, unless it is -1, and sets it to -1. Keeps errno. */
void umbs_hang_up(int *fd);

/* Reads `size` bytes from a descriptor, or fewer at the file's end. Returns their number, or -1
 * with errno. */
ssize_t umbs_read_full(int fd, void *bytes, size_t size);

/*
 * Reads an open file of `size` bytes whole.
 *
 * In:    what: name of the file in messages.
 * Out:   bytes: malloc, with room for one more byte; NULL on failure.
 * Fails: E_TRUNCATED (the file is shorter), E_IO, E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbs_read_file(int fd, size_t size, const char *what, uint8_t **bytes,
                                           struct umb_error *error);

/* Reach of a file system: one machine or several. Locks and shared memory of a file work for all
 * processes only if one kernel has the file system. Sources: statfs(2), linux/magic.h. */
enum umbs_reach {
    UMBS_REACH_LOCAL,   /* this machine alone: ext4, XFS, Btrfs, ZFS, tmpfs, F2FS */
    UMBS_REACH_UNKNOWN, /* overlay and every file system not listed */
    UMBS_REACH_NETWORK, /* shared with other machines: NFS, SMB, Lustre, Ceph, FUSE, 9p, GPFS */
};

/* Returns the reach of an open file's file system. Out: name: name of the file system's type,
 * static; may be NULL. */
enum umbs_reach umbs_file_system(int fd, const char **name);

#endif

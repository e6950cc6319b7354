/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_COMMON_FILE_SYSTEM_H
#define UMBRAGE_SERVER_COMMON_FILE_SYSTEM_H
/*
 * Reach of a file system. Locks and shared memory of a file work for all processes only if one
 * kernel has the file system. Sources: statfs(2), linux/magic.h.
 */

enum umbs_reach {
    UMBS_REACH_LOCAL,   /* this machine alone: ext4, XFS, Btrfs, ZFS, tmpfs, F2FS */
    UMBS_REACH_UNKNOWN, /* overlay and every file system not listed */
    UMBS_REACH_NETWORK, /* shared with other machines: NFS, SMB, Lustre, Ceph, FUSE, 9p, GPFS */
};

/* Reach of the file system of an open file. Out: name: name of its type, static; may be NULL. */
enum umbs_reach umbs_file_system(int fd, const char **name);

#endif

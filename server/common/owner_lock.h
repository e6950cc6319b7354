/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_COMMON_OWNER_LOCK_H
#define UMBRAGE_SERVER_COMMON_OWNER_LOCK_H
/*
 * A lock file that lets one process use a folder or table. The file names its owner.
 *
 *     umbs_owner_lock_take("DIR/lock", &lock, &error);     E_BUSY names the host and the pid
 *     umbs_owner_lock_beat(&lock, &error);                 every few seconds: E_STATE = lost
 *     umbs_owner_lock_release(&lock);
 *
 * The owner holds two kernel locks on the file: flock, and a lock of the open file description by
 * fcntl. Some network file systems forward only the second. On a local file system the locks are
 * enough, and a crashed owner's file is taken over at once.
 *
 * On other file systems locks may work on one machine only, or not at all. There the owner also
 * increments a number in the file every UMBS_BEAT_MS. A file of another machine's owner, or one
 * that cannot be locked, is taken over only after its number stood still for UMBS_TAKE_OVER_MS.
 * Readers open the file anew each time, so that NFS shows the latest bytes (close-to-open). Two
 * processes that take over at the same moment detect it by their first beat.
 *
 * Not detectable: machines that do not see each other's writes.
 * Threads: one at a time.
 */
#include <stdint.h>
#include "common/file_system.h"
#include "umbrage/status.h"

#define UMBS_BEAT_MS       3000  /* milliseconds between two beats */
#define UMBS_TAKE_OVER_MS  15000 /* milliseconds without a beat after which an owner is dead */
#define UMBS_OWNER_SIZE    320   /* bytes of an owner's line, with its NUL */
#define UMBS_LOCK_PATH_MAX 4200

struct umbs_owner_lock {
    int fd;                        /* Descriptor of the file; -1 = not held */
    int beats;                     /* 1 = the kernel's locks alone are not enough */
    uint64_t number;               /* Number of the last beat */
    char owner[UMBS_OWNER_SIZE];   /* Name of this process: host, boot, pid, a random word */
    char path[UMBS_LOCK_PATH_MAX]; /* Path of the file */
};

/* Takes a lock. Fails: E_BUSY (another process has it), E_CANNOT_CREATE, E_LIMIT. Cost: blocks for
 * UMBS_TAKE_OVER_MS if the number in the file must be watched. */
UMB_CHECKED enum umb_status umbs_owner_lock_take(const char *path, struct umbs_owner_lock *lock,
                                                 struct umb_error *error);

/* The same as umbs_owner_lock_take, for a given reach of the file system and a given watching
 * time. */
UMB_CHECKED enum umb_status umbs__owner_lock_take(const char *path, enum umbs_reach reach,
                                                  uint32_t watch_ms, struct umbs_owner_lock *lock,
                                                  struct umb_error *error);

/* Increments the number that shows that the owner is alive; does nothing if the kernel locks are
 * enough. Fails: E_STATE (another process took the file over: stop using the guarded files), E_IO
 * (not written; try again). */
UMB_CHECKED enum umb_status umbs_owner_lock_beat(struct umbs_owner_lock *lock,
                                                 struct umb_error *error);

/* Returns 1 if a held lock's file was not removed or replaced at its path. */
int umbs_owner_lock_is_there(const struct umbs_owner_lock *lock);

/* Removes the owner from the file and unlocks the file. A lock that is not held is allowed. */
void umbs_owner_lock_release(struct umbs_owner_lock *lock);

#endif

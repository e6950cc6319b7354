/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STORE_STORE_CACHE_H
#define UMBRAGE_SERVER_STORE_STORE_CACHE_H
/*
 * A folder of mapped files that only the daemon writes.
 *
 *     key         32 random bytes, made once, mode 0600
 *     lock        owner_lock.h: one daemon writes, others only read
 *     proven      list of the mapped files, each line with a MAC by the key (store_record.h)
 *     ID.umbm     mapped forms
 *
 * The folder is used only if no other user can change it (private_folder.h). A file in it is used
 * only if it belongs to this user or root, no other user may write to it, it has one name, and the
 * list has its SHA-256. A file that fails a check is made anew.
 *
 * Remaining risks: processes of the daemon's user and of root can read the key. A file with the
 * listed device, inode, size and times is opened without reading all of it. A user cannot set the
 * time of change. Root can (through the clock), and a failing disk can change bytes without
 * changing that time.
 *
 * Threads: any at once.
 */
#include <pthread.h>
#include "common/log.h"
#include "common/owner_lock.h"
#include "store/store_record.h"

#define UMBS_CACHE_KEY "key"
#define UMBS_PATH_SIZE                                                                             \
    4400 /* bytes of a path: Linux's longest folder, and the longest name in it */

/* Writes FOLDER/NAME; a longer path becomes "", which no call opens. */
void umbs__path(char path[UMBS_PATH_SIZE], const char *folder, const char *name);

struct umbs_cache {
    pthread_mutex_t mutex;       /* Guard of all fields below */
    const struct umbs_log *log;  /* Log of the daemon; may be NULL */
    char *path;                  /* Path as configured; without links once it is ready */
    int ready;                   /* 1 if only this user can change the folder and the key is read */
    int logged_shared;           /* 1 if the log has another daemon's pid already */
    struct umbs_owner_lock lock; /* Lock of the folder; held by the daemon that may write */
    uint8_t key[UMBS_KEY_BYTES];
    struct umbs_records records; /* Records of the last scan, and new ones of this scan */
    int unwritten;               /* 1 if the records differ from the file */
    size_t built;                /* Number of mapped files made in this scan */
    size_t unsynced;             /* Number of mapped files that may not be durable */
    int unsafe;                  /* 1 after a failed sync: no list is written any more */
};

/* Sets up the object; nothing is read yet. Fails: E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbs__cache_init(struct umbs_cache *cache, const char *path,
                                             const struct umbs_log *log, struct umb_error *error);
/* Frees the content and releases the lock, so that another daemon may write to the folder. */
void umbs__cache_finish(struct umbs_cache *cache);

/*
 * Makes the folder usable, unless it is already: created, checked and locked, its key and list
 * read. A failed step is repeated at the next call, because another daemon may have ended
 * meanwhile.
 *
 * Out:   writable: 1 if this daemon may write to the folder. May be NULL.
 * Fails: E_PERMISSION (other users can change it), E_BUSY (another daemon is making the key),
 *        E_CANNOT_CREATE, E_IO, E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbs__cache_ready(struct umbs_cache *cache, int *writable,
                                              struct umb_error *error);

/* Copies the record of the packed file with a stamp, or of an id if `packed` is NULL. Returns 0 if
 * there is no record. */
int umbs__cache_find(struct umbs_cache *cache, const struct umbs_stamp *packed, const uint8_t *id,
                     struct umbs_record *record);

/* Adds a record unless its packed file has one. */
void umbs__cache_remember(struct umbs_cache *cache, const struct umbs_record *record);

/*
 * Call these around making a mapped file. umbs__cache_syncs returns 1 if the file must be synced
 * separately, as the first files of each scan are. umbs__cache_made counts a complete file. Other
 * files are synced together before a list names them. A power cut may tear a mapped file that has
 * no record; such a file is made anew.
 */
int umbs__cache_syncs(struct umbs_cache *cache);
void umbs__cache_made(struct umbs_cache *cache, int synced);

/* Replaces the records by those of a scan, takes ownership of the new ones, and writes them if the
 * list on disk differs. Cost: may block on the disk for seconds; other threads may use the cache
 * meanwhile. */
void umbs__cache_keep(struct umbs_cache *cache, struct umbs_records *records);

/* Copies the path of the folder. Returns 1 if this daemon may write to the folder, else 0. The copy
 * is needed because another thread may change the field `path` when it makes the cache ready. */
int umbs__cache_own_folder(struct umbs_cache *cache, char path[UMBS_PATH_SIZE]);

/* Writes the path of the mapped file of an id. */
void umbs__cache_file(struct umbs_cache *cache, const uint8_t id[UMB_ID_BYTES],
                      char path[UMBS_PATH_SIZE]);

#endif

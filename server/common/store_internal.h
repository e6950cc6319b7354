/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_COMMON_STORE_INTERNAL_H
#define UMBRAGE_SERVER_COMMON_STORE_INTERNAL_H
/* What the files of the store share: entries, the table, and the steps of a scan. */
#include <pthread.h>
#include <sys/stat.h>
#include "common/store.h"

#define UMBS_CACHE_FOLDER ".umbrage-cache"

/* What tells one state of a file from another. */
struct umbs_stamp {
    dev_t device;
    ino_t inode;
    off_t size;
    struct timespec modified, changed;
};

struct umbs_entry {
    struct umbs_store *store;
    size_t references;       /* under store->mutex; the table holds one */
    struct umb_asset *asset; /* NULL if the file cannot answer */
    void *image;             /* packed bytes the asset borrows, or NULL */
    struct umbs_store_item item;
    struct umb_error error; /* why it cannot answer */
    struct umbs_stamp stamp;
    int has_id; /* item.id was read from its head */
    int retry;  /* the failure was not the file's: try at each scan */
    struct umbs_entry *next_retired;
};

/* Immutable once published. */
struct umbs_table {
    size_t count;
    struct umbs_entry **by_name; /* [count], sorted, each holding a reference */
    struct umbs_entry **by_id;   /* [healthy], sorted by id */
    size_t healthy;
};

struct umbs_store {
    char *folder, *cache;
    uint64_t max_memory_bytes;
    int no_cache;
    const struct umbs_log *log;
    void (*retired)(void *user);
    void *retired_user;

    pthread_mutex_t scan;  /* one rescan at a time; taken before mutex */
    size_t skipped_before; /* under scan */

    pthread_mutex_t mutex; /* the rest */
    struct umbs_table table;
    struct umbs_entry *graveyard; /* no references left, not freed yet */
    size_t entries;               /* that exist; the store outlives them */
    int closed;
};

/* Makes an entry for a file; a damaged file gives an entry without asset. NULL: out of memory.
 * Blocks; called by the scan without the mutex. */
struct umbs_entry *umbs__entry_load(struct umbs_store *store, const char *name);

/* Takes a further reference to an entry of the current table (scan only). */
void umbs__entry_retain(struct umbs_entry *entry);

/* Opens the mapped cache of a proven packed image, making it if need be. Fails: any status; the
 * caller then expands the packed form. Out: asset. */
UMB_CHECKED enum umb_status umbs__cache_open(struct umbs_store *store,
                                             const uint8_t id[UMB_ID_BYTES], const void *packed,
                                             size_t packed_size, struct umb_asset **asset,
                                             struct umb_error *error);

/* Removes stray temporaries of the store and its cache, and cache files of ids that table does not
 * have, when older than UMBS_STORE_TEMPORARY_AGE_S. Returns how many. */
size_t umbs__store_sweep(struct umbs_store *store, const struct umbs_table *table);

/* The healthy entry of that id, or NULL. */
struct umbs_entry *umbs__table_find_id(const struct umbs_table *table,
                                       const uint8_t id[UMB_ID_BYTES]);
struct umbs_entry *umbs__table_find_name(const struct umbs_table *table, const char *name);

struct umbs_stamp umbs__stamp_of(const struct stat *status);
int umbs__stamp_equal(const struct umbs_stamp *a, const struct umbs_stamp *b);

/* folder + "/" + name, malloc; NULL: out of memory. */
char *umbs__path_join(const char *folder, const char *name);

#endif

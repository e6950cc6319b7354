/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_COMMON_STORE_INTERNAL_H
#define UMBRAGE_SERVER_COMMON_STORE_INTERNAL_H
/* What the files of the store share: entries, the table, and the steps of a scan. */
#include <pthread.h>
#include <sys/stat.h>
#include "common/asset_map.h"
#include "common/store.h"

#define UMBS_CACHE_FOLDER ".umbrage-cache"

struct umbs_entry {
    struct umbs_store *store;
    size_t references;             /* under store->mutex; the table holds one */
    const struct umb_asset *asset; /* NULL if the file cannot answer */
    struct umbs_asset_map *map;    /* owns the asset; or NULL: */
    struct umb_asset *expanded;    /* owns it, in memory */
    struct umbs_store_item item;
    struct umb_error error; /* why it cannot answer */
    struct umbs_stamp stamp;
    int has_id;  /* item.id was read from its head */
    int faulted; /* under store->mutex: its map was cut or changed, error says so */
    int retry;   /* the failure was not the file's: try at each scan */
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
    int no_cache, copy, warm;
    const struct umbs_log *log;
    void (*retired)(void *user);
    void (*faulted)(void *user);
    void *owner;

    pthread_mutex_t scan;  /* one rescan at a time; taken before mutex */
    size_t skipped_before; /* under scan */

    pthread_mutex_t mutex; /* the rest */
    struct umbs_table table;
    struct umbs_entry *graveyard; /* no references left, not freed yet */
    size_t entries;               /* that exist; the store outlives them */
    uint64_t faults;
    int closed;
};

/* Makes an entry for a file; a damaged file gives an entry without asset. rebuild: make its cache
 * anew, whatever is there. NULL: out of memory. Blocks; called by the scan without the mutex. */
struct umbs_entry *umbs__entry_load(struct umbs_store *store, const char *name, int rebuild);

/* Takes a further reference to an entry of the current table (scan only). */
void umbs__entry_retain(struct umbs_entry *entry);

/* Removes stray temporaries of the store and its cache, and cache files of ids that table does not
 * have, when older than UMBS_STORE_TEMPORARY_AGE_S. Returns how many. */
size_t umbs__store_sweep(struct umbs_store *store, const struct umbs_table *table);

/* The healthy entry of that id, or NULL. */
struct umbs_entry *umbs__table_find_id(const struct umbs_table *table,
                                       const uint8_t id[UMB_ID_BYTES]);
struct umbs_entry *umbs__table_find_name(const struct umbs_table *table, const char *name);

/* folder + "/" + name, malloc; NULL: out of memory. */
char *umbs__path_join(const char *folder, const char *name);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STORE_STORE_INTERNAL_H
#define UMBRAGE_SERVER_STORE_STORE_INTERNAL_H
/* What the files of the store share: entries, the table, and the steps of a scan. */
#include <pthread.h>
#include <stdatomic.h>
#include <sys/stat.h>
#include "store/asset_map.h"
#include "store/store.h"
#include "store/store_cache.h"

#define UMBS_CACHE_FOLDER ".umbrage-cache"

struct umbs_entry {
    struct umbs_store *store;
    atomic_size_t references;      /* number of references; each table with this entry holds one */
    const struct umb_asset *asset; /* NULL if the file cannot answer */
    struct umbs_asset_map *map;    /* map that owns the asset; or NULL: */
    struct umb_asset *expanded;    /* asset expanded in memory, owned */
    struct umbs_store_item item;
    /* Reason why it cannot answer; written before faulted, else not changed. */
    struct umb_error error;
    struct umbs_stamp stamp;
    size_t folder; /* index of its folder in the store */
    /* Serial of the scan that last loaded it or tried to replace it; under store->scan. */
    uint64_t tried;
    atomic_uint_fast64_t checked_ms; /* of the last full check, umbu_clock_ms; 0 = before */
    int has_id;                      /* item.id was read from its head */
    atomic_int faulted;  /* 1 once its map was found cut or changed; error has the reason */
    atomic_int replaced; /* 1 if its file is being replaced: umbs_store_replacing */
    int retry; /* 1: the failure was not the file's; each scan tries again; under store->scan */
    struct umbs_entry *next_retired;
};

/* A table of entries, immutable once published. */
struct umbs_table {
    /* One for the store, one for each reader, one for each walk in progress. */
    atomic_size_t references;
    size_t count;
    struct umbs_entry **by_name; /* [count], sorted, each holding a reference */
    struct umbs_entry **by_id;   /* [healthy], sorted by id */
    size_t healthy;
    struct umbs_entry *
        *damaged; /* [damaged_count], sorted by id: entries with an id but no asset */
    size_t damaged_count;
    struct umbs_table *next_retired;
};

struct umbs_reader {
    struct umbs_store *store;
    /* Held table that look-ups use; touched only by the reader's thread. */
    struct umbs_table *table;
    _Atomic(struct umbs_table *) mail; /* held newer table, put here by a scan; NULL: none */
    struct umbs_reader *next;          /* under store->mutex */
};

struct umbs_folder {
    char *path;
    struct umbs_cache *cache; /* cache of the folder, one of the store's */
    /* Under the store's scan mutex: */
    size_t skipped_before, shadowed_before;
};

/* One asset's name, and the folder that has it. */
struct umbs_name {
    size_t folder;
    char text[UMBS_STORE_NAME_MAX + 1];
};

/* The lane that loads large files, store_lane.c. */
struct umbs_lane {
    pthread_mutex_t mutex; /* guards all fields from state on */
    pthread_cond_t changed;
    pthread_t thread;
    int running;         /* set before the first scan that uses it */
    uint64_t from_bytes; /* packed size in bytes from which the lane loads a file */
    struct umbs_entry *(*load)(struct umbs_store *store, const struct umbs_name *name, int rebuild);
    enum {
        UMBS_LANE_IDLE,
        UMBS_LANE_LOADING,
        UMBS_LANE_DONE
    } state;
    int stopping, ended;
    struct umbs_name name; /* Name of the file; not changed while it loads */
    struct umbs_stamp stamp;
    int rebuild;
    int yielded;              /* 1: the file loaded last asked again and yields to the others */
    struct umbs_entry *entry; /* Loaded entry; NULL: out of memory */
    uint64_t load_ms;
};

struct umbs_store {
    struct umbs_folder folders[UMBS_STORE_FOLDERS_MAX];
    size_t folder_count;
    struct umbs_cache caches[UMBS_STORE_FOLDERS_MAX]; /* one for all folders, or one for each */
    size_t cache_count;
    struct umbs_lane lane;
    uint64_t max_memory_bytes;
    int no_cache, copy, warm;
    const struct umbs_log *log;
    void (*retired)(void *user);
    void (*faulted)(void *user);
    void *owner;

    pthread_mutex_t scan; /* one rescan at a time; taken before mutex */
    uint64_t serial;      /* serial of the scan; under scan */

    pthread_mutex_t mutex;       /* for a few instructions each time: */
    struct umbs_table *table;    /* newest table; only scans change it */
    struct umbs_reader *readers; /* readers that get the next table */
    uint64_t faults, scrubbed;
    int64_t scrubbed_at;

    /* Unreferenced tables and entries that wait to be freed. These stacks are only ever taken
     * whole, so a push is one compare and exchange. */
    _Atomic(struct umbs_table *) old_tables;
    _Atomic(struct umbs_entry *) free_list;
    /* Entries that exist, plus 1 until the store is closed: the store outlives its entries. */
    atomic_size_t holders;
    atomic_int closed;
};

struct umbs_name_list {
    size_t count, capacity;
    struct umbs_name *names;
};

/* Collects the names of all folders, sorted, each once. Fails: E_NO_INPUT, E_IO, E_NO_MEMORY; the
 * caller frees the list in every case. */
UMB_CHECKED enum umb_status umbs__names_read(struct umbs_store *store, struct umbs_name_list *list,
                                             struct umbs_store_report *report,
                                             struct umb_error *error);

/* Makes an entry for a file; a damaged file gives an entry without asset. rebuild: 1 = make its
 * cache anew in any case. NULL: out of memory. Blocks; called by the scan without the mutex. */
struct umbs_entry *umbs__entry_load(struct umbs_store *store, const struct umbs_name *name,
                                    int rebuild);

/* Makes an entry for a file with a known stamp whose mapped file is unchanged; NULL if it is not
 * so. Quick. */
struct umbs_entry *umbs__entry_recall(struct umbs_store *store, const struct umbs_name *name,
                                      const struct umbs_stamp *packed);

enum umbs_lane_answer {
    UMBS_LANE_NOT_FOR_IT, /* small, or there is no lane: the scan loads it */
    UMBS_LANE_WAIT,       /* the lane loads it, or another one first */
    UMBS_LANE_TAKE,       /* it is loaded */
};

/* Asks the lane for a file, from a scan. Out: entry: with _TAKE, NULL if out of memory; load_ms. */
enum umbs_lane_answer umbs__lane_ask(struct umbs_store *store, const struct umbs_name *name,
                                     const struct umbs_stamp *stamp, int rebuild,
                                     struct umbs_entry **entry, uint64_t *load_ms);

/* 1 if the lane has a result that no scan took yet. */
int umbs__lane_has_done(struct umbs_store *store);

/* At the end of a pass: drops a result that was there at its beginning (was_done) and that no file
 * asked for. Returns 1 if the lane could load another file now. */
int umbs__lane_clear(struct umbs_store *store, int was_done);

void umbs__lane_init(struct umbs_lane *lane);
void umbs__lane_finish(struct umbs_lane *lane);

/* 1 if the file is the reason that it could not be loaded: trying again does not help. */
int umbs__is_the_files_fault(enum umb_status status);

/* 1 if the file is damaged; other failures: too large, of another version, or partial. */
int umbs__is_damage(enum umb_status status);

/* Path of an asset's packed file, malloc; NULL: out of memory. */
char *umbs__packed_path(const struct umbs_store *store, const struct umbs_name *name);

/* Takes an entry out of use and calls the owner, once. */
void umbs__entry_quarantine(struct umbs_entry *entry, const struct umb_error *error);

/* Removes stray temporaries of the store and its cache, and cache files of ids that table does not
 * have, when older than UMBS_STORE_TEMPORARY_AGE_S. Returns how many. */
size_t umbs__store_sweep(struct umbs_store *store, const struct umbs_table *table);

/* An empty table with room for `room` entries, held once; NULL: out of memory. */
struct umbs_table *umbs__table_create(size_t room);

/* The newest table, held. _let_go releases any table: the last release leaves the table to
 * umbs_store_reap and returns 1. _walked does the same and has the table reaped soon. */
struct umbs_table *umbs__table_hold(struct umbs_store *store);
int umbs__table_let_go(struct umbs_store *store, struct umbs_table *table);
void umbs__table_walked(struct umbs_store *store, struct umbs_table *table);

/* umbs_store_acquire in a table that the caller holds: never waits. */
UMB_CHECKED enum umb_status umbs__table_acquire(const struct umbs_table *table,
                                                const char *name_or_id, struct umbs_entry **out,
                                                struct umb_error *error);

/* 1 if one of the first `folders` folders has a whole file with that id. */
int umbs__table_has(const struct umbs_table *table, const uint8_t id[UMB_ID_BYTES], size_t folders);

/* Makes a held table the newest, for the store and all its readers, and takes over the hold.
 * Returns the table before it, held. */
struct umbs_table *umbs__table_publish(struct umbs_store *store, struct umbs_table *table);

/* Leaves an entry without references to umbs_store_reap. */
void umbs__entry_retire(struct umbs_entry *entry);

/* Has retired memory freed: asks the owner, or frees it here if there is no owner to ask. */
void umbs__reap_soon(struct umbs_store *store);

/* The healthy entry with that id, or NULL. */
struct umbs_entry *umbs__table_find_id(const struct umbs_table *table,
                                       const uint8_t id[UMB_ID_BYTES]);
struct umbs_entry *umbs__table_find_name(const struct umbs_table *table, const char *name);

/* folder + "/" + name, malloc; NULL: out of memory. */
char *umbs__path_join(const char *folder, const char *name);

#endif

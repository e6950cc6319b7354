/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STORE_STORE_INTERNAL_H
#define UMBRAGE_SERVER_STORE_STORE_INTERNAL_H
/*
 * Shared by the files of the store. Each file uses those before it: store_entry.c (entries and
 * their end), store_table.c (look-ups), store_load.c (one file), store_lane.c, store_scan.c,
 * store.c.
 */
#include <pthread.h>
#include <stdatomic.h>
#include <sys/stat.h>
#include "store/asset_map.h"
#include "store/store.h"
#include "store/store_cache.h"

#define UMBS_CACHE_FOLDER ".umbrage-cache"

struct umbs_entry {
    struct umbs_store *store;
    uint64_t serial;               /* Number of the entry, from 1 on; never reused */
    atomic_size_t references;      /* Number of references; each table with this entry holds one */
    const struct umb_asset *asset; /* NULL if the file cannot answer */
    struct umbs_asset_map *map;    /* Map that owns the asset, or NULL */
    struct umb_asset *expanded;    /* Owned asset that was expanded in memory, or NULL */
    struct umbs_store_item item;
    struct umb_error error; /* Reason why it cannot answer; written before faulted, else constant */
    struct umbs_stamp stamp;
    size_t folder;  /* Index of its folder in the store */
    uint64_t tried; /* Last scan that loaded it, a serial; guarded by store->scan */
    atomic_uint_fast64_t checked_ms; /* Time of the last full check, umbu_clock_ms; 0 = none yet */
    int has_id;                      /* 1 if item.id was read from its head */
    atomic_int faulted;  /* 1 once its map was found cut or changed; error has the reason */
    atomic_int replaced; /* 1 if its file is being replaced: umbs_store_replacing */
    int retry;           /* 1 if the load failed for a reason other than the file, so that each scan
                  tries again; guarded by the mutex store->scan */
    struct umbs_entry *next_retired;
};

struct umbs_entry_list {
    struct umbs_entry **list; /* [count] */
    size_t count;
};

/* A table of entries, immutable once published. */
struct umbs_table {
    atomic_size_t references;       /* Holds by the store, by readers, and by walks in progress */
    struct umbs_entry_list all;     /* All entries by name, each holding a reference */
    struct umbs_entry_list by_id;   /* Healthy entries by id */
    struct umbs_entry_list damaged; /* Entries with an id but no asset, by id */
    struct umbs_table *next_retired;
};

struct umbs_reader {
    struct umbs_store *store;
    struct umbs_table *table; /* Held table for look-ups; touched only by the reader's thread */
    _Atomic(struct umbs_table *) mail; /* Held newer table, put here by a scan; NULL: none */
    struct umbs_reader *next;          /* Link of the store's list; under store->mutex */
};

struct umbs_folder {
    char *path;
    struct umbs_cache *cache; /* Cache of the folder, one of the store's; NULL: none */
    size_t skipped_before;    /* Number of skipped names at the last scan; under store->scan */
};

/* One asset's name, and the folder that has it. */
struct umbs_name {
    size_t folder;
    char text[UMBS_STORE_NAME_MAX + 1];
};

/* The lane that loads large files, store_lane.c. */
struct umbs_lane {
    pthread_mutex_t mutex; /* Guard of all fields from state on */
    pthread_cond_t changed;
    pthread_t thread;
    int running;         /* 1 if there is a thread; set before the first scan that uses it */
    uint64_t from_bytes; /* Packed size in bytes from which the lane loads a file */
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
    int yielded;              /* 1 if the file loaded last asked again and yields to the others */
    struct umbs_entry *entry; /* Loaded entry; NULL: out of memory */
    uint64_t load_ms;
};

struct umbs_store {
    struct umbs_folder folders[UMBS_STORE_FOLDERS_MAX];
    size_t folder_count;
    struct umbs_cache caches[UMBS_STORE_FOLDERS_MAX]; /* One for all folders, or one for each */
    size_t cache_count;
    struct umbs_lane lane;
    /* Options; folders and cache are only valid while the store is opened. */
    struct umbs_store_options options;

    pthread_mutex_t scan; /* Mutex of rescans; taken before mutex */
    uint64_t serial;      /* Number of the scan; under scan */

    pthread_mutex_t mutex;       /* Guard of the next fields, for a few instructions each time */
    struct umbs_table *table;    /* Newest table; only scans change it */
    struct umbs_reader *readers; /* Readers that get the next table */
    uint64_t faults, scrubbed;
    int64_t scrubbed_at;

    /* Stacks of unreferenced tables and entries that wait to be freed. A stack is only ever emptied
     * as a whole, so a push is one compare-and-exchange. */
    _Atomic(struct umbs_table *) old_tables;
    _Atomic(struct umbs_entry *) free_list;
    atomic_size_t holders;        /* Number of entries, plus 1 until the store is closed */
    atomic_uint_fast64_t entries; /* Number of entries ever made */
    atomic_int closed;
};

/* --- store_entry.c --- */

/* Returns 1 if the status means a damaged file. Other failures: the file is too large, of another
 * version, or partial. */
int umbs__is_damage(enum umb_status status);

/* Returns 1 if the failure lies in the file itself, so that trying again does not help. */
int umbs__is_the_files_fault(enum umb_status status);

/* Writes the path of an asset's packed file. */
void umbs__packed_path(const struct umbs_store *store, const struct umbs_name *name,
                       char path[UMBS_PATH_SIZE]);

/* Makes an entry without content, with one reference; NULL: out of memory. */
struct umbs_entry *umbs__entry_create(struct umbs_store *store, const struct umbs_name *name);

/* Takes a damaged entry out of use: no further call gets the entry, and the owner is asked for a
 * scan that replaces it. If several batches find the same damage, only the first does so. */
void umbs__entry_quarantine(struct umbs_entry *entry, const struct umb_error *error);

/* Drops the references of an old table, and frees it. */
void umbs__table_free(struct umbs_table *table);

/* Asks the owner to free retired memory, or frees it here if the owner gave no callback. */
void umbs__reap_soon(struct umbs_store *store);

/* Gives back `count` holds of a store; the last one frees it. */
void umbs__store_let_go(struct umbs_store *store, size_t count);

/* --- store_table.c --- */

/* Creates an empty table for `room` entries, held once. NULL: out of memory. */
struct umbs_table *umbs__table_create(size_t room);

/* Returns the newest table and holds it. umbs__table_let_go releases a hold; if it was the last
 * one, it leaves the table to umbs_store_reap and returns 1. umbs__table_walked releases a hold
 * too, and asks the owner to reap soon. */
struct umbs_table *umbs__table_hold(struct umbs_store *store);
int umbs__table_let_go(struct umbs_store *store, struct umbs_table *table);
void umbs__table_walked(struct umbs_store *store, struct umbs_table *table);

/* Makes a held table the newest, for the store and all its readers, and takes over the hold.
 * Returns the previous table, held. */
struct umbs_table *umbs__table_publish(struct umbs_store *store, struct umbs_table *table);

/* umbs__table_find_id returns the healthy entry with an id, umbs__table_find_name the entry with a
 * name; NULL if there is none. */
struct umbs_entry *umbs__table_find_id(const struct umbs_table *table,
                                       const uint8_t id[UMB_ID_BYTES]);
struct umbs_entry *umbs__table_find_name(const struct umbs_table *table, const char *name);

/* --- store_load.c --- */

/* Loads a file into a new entry; a damaged file gives an entry without an asset. rebuild: 1 = make
 * the mapped file anew in any case. NULL: out of memory. Blocks; a scan calls it without the
 * mutex. */
struct umbs_entry *umbs__entry_load(struct umbs_store *store, const struct umbs_name *name,
                                    int rebuild);

/* Makes an entry from the record of a known stamp, quickly. Returns NULL if there is no such
 * record, or its mapped file is missing or changed. */
struct umbs_entry *umbs__entry_recall(struct umbs_store *store, const struct umbs_name *name,
                                      const struct umbs_stamp *packed);

/* --- store_lane.c --- */

enum umbs_lane_answer {
    UMBS_LANE_NOT_FOR_IT, /* the file is small, or there is no lane: the scan loads the file */
    UMBS_LANE_WAIT,       /* the lane is loading this file, or another one first */
    UMBS_LANE_TAKE,       /* the lane has loaded the file */
};

/* Asks the lane for a file; called by a scan. Out: entry, load_ms: set with UMBS_LANE_TAKE; entry
 * is NULL if memory was short. */
enum umbs_lane_answer umbs__lane_ask(struct umbs_store *store, const struct umbs_name *name,
                                     const struct umbs_stamp *stamp, int rebuild,
                                     struct umbs_entry **entry, uint64_t *load_ms);

/* 1 if the lane has a result that no scan took yet. */
int umbs__lane_has_done(struct umbs_store *store);

/* Called at the end of a scan's pass. Drops the lane's result if it existed at the pass's beginning
 * (was_done) and no file asked for it. Returns 1 if the lane could load another file now. */
int umbs__lane_clear(struct umbs_store *store, int was_done);

void umbs__lane_init(struct umbs_lane *lane);
void umbs__lane_finish(struct umbs_lane *lane);

/* --- store_scan.c --- */

/* Removes stray temporaries of the store and its cache, and cache files whose ids are not in
 * `table`, if they are older than UMBS_STORE_TEMPORARY_AGE_S. Returns their number. */
size_t umbs__store_sweep(struct umbs_store *store, const struct umbs_table *table);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STORE_STORE_H
#define UMBRAGE_SERVER_STORE_STORE_H
/*
 * The store: folders of packed assets (NAME.umb), kept open and ready to answer.
 *
 *     struct umbs_store *store;
 *     umbs_store_open(&options, &store, &error);
 *     umbs_store_rescan(store, &report, &error);          again whenever the folder changed
 *     struct umbs_entry *entry;
 *     umbs_store_acquire(store, "city", &entry, &error);
 *     ... umb_query_prepare on umbs_entry_asset(entry) ...
 *     umbs_entry_read(entry, run, &batch, &error);        run calls umb_query_run
 *     umbs_entry_release(entry);
 *     umbs_store_close(store);
 *
 * Names: a file's name without `.umb`, or FOLDER/NAME for a file one folder down. A symbolic link
 * is one more name of its target ("city/latest"). If two of the store's folders have the same name,
 * the earlier folder's file is served.
 *
 * Every packed file is proven (SHA-256 of head and pages against the id it carries) before its
 * first answer. It is then mapped from a cache file ID.umbm that the store makes itself and that no
 * other user can change (store_cache.h). The cache is only a faster form. A file in it that is
 * missing, damaged or different from its record is made anew. If the cache cannot be used, the
 * packed file is expanded in memory, with a notice. A known asset opens in milliseconds.
 *
 * A damaged file stays in the list with its reason: a request for it gives E_CORRUPT, and nothing
 * else is affected. A changed file (inode, size, time of change) is loaded and proven first, then
 * replaces the old version, which lives until its last batch releases it.
 *
 * If a mapped cache file is cut or overwritten, the batches that were reading it fail (asset_map.h)
 * and it is taken out of use at once; the next scan makes it anew from the packed file.
 *
 * Threads: acquire, release and list may be called from any thread at any time. Acquire and list
 * hold a mutex for a few instructions, never during a look-up, a batch, a load or an unmap. A
 * thread that must not wait even that long uses a reader of its own, below. Rescans exclude one
 * another. An entry is one version of one asset and immutable. A retired version cannot be freed
 * too early: a look-up holds its table, and the table holds one reference to each of its entries.
 * So an entry that was found cannot reach zero before the finder has its reference.
 * Trust: file content is hostile. Names beyond [A-Za-z0-9._-] and files that are not regular are
 * skipped. Packed files are read, not mapped, so a file cut short meanwhile gives an error and no
 * signal. Mapped files are trusted only if the key proves them.
 */
#include <stddef.h>
#include <stdint.h>
#include "common/log.h"
#include "umbrage/asset.h"

#define UMBS_STORE_NAME_MAX        251  /* bytes of an asset's name */
#define UMBS_STORE_TEMPORARY_AGE_S 3600 /* older `.tmp.*` files are left over */
#define UMBS_STORE_FOLDERS_MAX     17
/* A file that changed more recently may still be incomplete. */
#define UMBS_STORE_SETTLE_MS 500

struct umbs_store; /* opaque */
struct umbs_entry; /* opaque: one version of one asset */

struct umbs_store_options {
    const char *folders[UMBS_STORE_FOLDERS_MAX]; /* at least one; the first NULL ends the list */
    const char *cache; /* Folder of mapped files (store_cache.h); NULL = a folder `.umbrage-cache`
                          in each store folder */
    uint64_t max_memory_bytes;  /* limit of one asset's packed and expanded bytes; 0 = 64 GiB */
    const struct umbs_log *log; /* NULL = silent; must outlive the store */
    int no_cache;               /* 1 = never write cache files, expand in memory */
    int copy;                   /* 1 = hold copies in memory, so files may change */
    int warm;                   /* 1 = read mapped files ahead when they are opened */
    /* Callback when a retired version waits to be freed, on the thread that released the version.
     * It must not wait. The owner then calls umbs_store_reap where blocking is allowed. NULL: the
     * version is freed at once. */
    void (*retired)(void *user);
    /* Callback when an asset was taken out of use, on the thread that found the damage, and when
     * the lane (the thread for large files) has loaded an asset. The owner then rescans. NULL: the
     * next scan handles both. */
    void (*faulted)(void *user);
    void *owner; /* argument of both callbacks */
};

/* Counts of a rescan. */
struct umbs_store_report {
    size_t loaded, failed, removed, unchanged; /* number of files */
    size_t failed_machine; /* part of the failed: this machine's fault, not the file's */
    uint64_t load_ms;      /* milliseconds spent on the loaded and the failed */
    size_t skipped;        /* names that cannot be asset names */
    size_t shadowed;       /* names that an earlier folder has too */
    size_t swept;          /* stray temporaries removed */
    int unsettled; /* 1 if a file that failed was changed so recently that it should be tried again
                      soon */
};

struct umbs_store_item {
    char name[UMBS_STORE_NAME_MAX + 1];
    uint8_t id[UMB_ID_BYTES];
    uint64_t packed_bytes, memory_bytes;
    uint32_t light_count;
    enum umb_status status; /* UMB_OK, or why it cannot answer */
};

/* Opens a store's folders and caches. Does not scan yet. Fails: E_NO_INPUT, E_PERMISSION,
 * E_NO_MEMORY; as umbs__cache_ready, for a cache that the options name. */
UMB_CHECKED enum umb_status umbs_store_open(const struct umbs_store_options *options,
                                            struct umbs_store **out, struct umb_error *error);

/* Frees a store; entries still held stay valid until released. NULL is allowed. */
void umbs_store_close(struct umbs_store *store);

/*
 * Scans the folders: loads new and changed files, drops missing ones, and removes old temporaries.
 * Files that need no reading are published together first. Files that must be read follow in
 * groups.
 *
 * Out:   report: filled also on failure; may be NULL.
 * Fails: E_IO or E_NO_INPUT if the folder cannot be read (the old table stays), E_NO_MEMORY. A bad
 *        file is not a failure of the scan.
 * Cost:  blocks on the disk; new files are read and verified.
 */
UMB_CHECKED enum umb_status umbs_store_rescan(struct umbs_store *store,
                                              struct umbs_store_report *report,
                                              struct umb_error *error);

/*
 * Starts the lane: a thread of the store that loads files of from_bytes and more, one at a time.
 * Meanwhile rescans load the other files, and keep the old version of a large one. A rescan after
 * the `faulted` callback takes the new version. Without the lane, a rescan loads everything itself.
 * Stop the lane before the store is closed.
 *
 * umbs_store_lane_stop waits up to its limit for a load to end. It returns 0 if the load did not
 * end; the store then cannot be closed.
 * Threads: not at the same time as a rescan.
 * Fails: E_LIMIT (no thread).
 */
UMB_CHECKED enum umb_status umbs_store_lane_start(struct umbs_store *store, uint64_t from_bytes,
                                                  struct umb_error *error);
int umbs_store_lane_stop(struct umbs_store *store, uint32_t wait_ms);

/*
 * Checks one asset's mapped file again: the file with the oldest check, if that check is
 * interval_ms ago or more, or if the file was opened by its record alone. A damaged asset is taken
 * out of use, as after a failed read. Copies need no check. Returns 1 if there was a file to check.
 * Out: number of bytes read.
 *
 * Cost:  blocks on the disk; one pass over the file.
 */
int umbs_store_scrub(struct umbs_store *store, uint64_t interval_ms, uint64_t *bytes);

/* Frees retired versions without references. Blocks on unmapping. */
void umbs_store_reap(struct umbs_store *store);

/*
 * Finds an asset by its id (64 hexadecimal digits) or its name and takes a reference.
 *
 * Fails: E_NOT_FOUND; E_CORRUPT with the reason if its file is damaged.
 */
UMB_CHECKED enum umb_status umbs_store_acquire(struct umbs_store *store, const char *name_or_id,
                                               struct umbs_entry **out, struct umb_error *error);

/*
 * Announces that an asset's file is about to be replaced by an equal one, which must be loaded like
 * a new file. The asset's mapped form is removed, and umbs_entry_is_replaced returns 1 for the
 * version in use. That version answers until the next scan.
 *
 * In:    folder: number of the folder with the file; nothing happens if the asset is not served
 *        from it. yes: 0 = the replacement failed and the version in use stays.
 * Cost:  blocks on the disk.
 */
void umbs_store_replacing(struct umbs_store *store, const uint8_t id[UMB_ID_BYTES], size_t folder,
                          int yes);
int umbs_entry_is_replaced(const struct umbs_entry *entry);

/*
 * A reader: one thread's own access to the assets, for threads that answer queries. acquire, has
 * and refresh take no lock and never wait, whatever scans, other readers and releases do meanwhile.
 * They see everything that a scan published before the call.
 *
 * A reader holds the versions of its last look-up. An idle reader must refresh now and then, so
 * that replaced versions can be freed. Close it before the store.
 *
 * Threads: one at a time.
 * Fails: open E_NO_MEMORY; acquire as umbs_store_acquire.
 * Cost:  the look-up and two reads; after a scan has published, also an exchange and a count down.
 */
struct umbs_reader; /* opaque */

UMB_CHECKED enum umb_status umbs_reader_open(struct umbs_store *store, struct umbs_reader **out,
                                             struct umb_error *error);
void umbs_reader_close(struct umbs_reader *reader); /* NULL is allowed */

UMB_CHECKED enum umb_status umbs_reader_acquire(struct umbs_reader *reader, const char *name_or_id,
                                                struct umbs_entry **out, struct umb_error *error);
/* Returns 1 if one of the first `folders` folders has an undamaged file with that id. */
int umbs_reader_has(struct umbs_reader *reader, const uint8_t id[UMB_ID_BYTES], size_t folders);
void umbs_reader_refresh(struct umbs_reader *reader);

/* Fails with the E_NOT_FOUND and the message of umbs_store_acquire for a missing asset. */
UMB_CHECKED enum umb_status umbs_store_not_found(const char *name_or_id, struct umb_error *error);

/* Takes a further reference. Never waits. */
void umbs_entry_retain(struct umbs_entry *entry);

/* Releases a reference. It does not wait if the store has a `retired` callback. NULL is allowed. */
void umbs_entry_release(struct umbs_entry *entry);

/*
 * Calls read(user), which may read the entry's voxels (umb_query_run and the like). read must hold
 * no lock and own nothing, because a fault may end it midway.
 *
 * Fails: E_CORRUPT if the mapped file was cut or changed; discard the results of read then. The
 *        asset is taken out of use.
 * Cost:  0.2 us.
 */
UMB_CHECKED enum umb_status umbs_entry_read(struct umbs_entry *entry, void (*read)(void *user),
                                            void *user, struct umb_error *error);

/*
 * umbs_entry_read in two steps, an optimistic read and a revalidation, for many small reads. Use
 * the results of optimistic reads only after a revalidation that followed all of them succeeded.
 * Each step fails as umbs_entry_read does.
 * Cost:  read 10 ns, revalidate 0.2 us.
 */
UMB_CHECKED enum umb_status umbs_entry_read_optimistic(struct umbs_entry *entry,
                                                       void (*read)(void *user), void *user,
                                                       struct umb_error *error);
UMB_CHECKED enum umb_status umbs_entry_revalidate(struct umbs_entry *entry,
                                                  struct umb_error *error);

/* Returns the asset, borrowed until the release. Its description may be read at any time, its
 * voxels only inside umbs_entry_read. */
const struct umb_asset *umbs_entry_asset(const struct umbs_entry *entry);
const struct umbs_store_item *umbs_entry_item(const struct umbs_entry *entry);

/* Returns the entry's number, from 1 on. An entry made later, even at the same address, has another
 * number. */
uint64_t umbs_entry_serial(const struct umbs_entry *entry);

/*
 * Opens the packed file from which an entry was made, so that parts of the file can be read.
 *
 * Out:   fd: the caller closes it; -1 on failure. size: bytes of the file.
 * Fails: E_STATE (another file is in its place, or none), E_IO, E_NO_MEMORY.
 * Cost:  blocks on the disk.
 */
UMB_CHECKED enum umb_status umbs_entry_open_packed(const struct umbs_entry *entry, int *fd,
                                                   uint64_t *size, struct umb_error *error);

/* Copies the list of all assets, damaged ones included, sorted by name; free() it. Fails:
 * E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbs_store_list(struct umbs_store *store,
                                            struct umbs_store_item **items, size_t *count,
                                            struct umb_error *error);

struct umbs_store_counts {
    size_t healthy, damaged; /* files that can answer, and files that cannot */
    uint64_t memory_bytes;   /* bytes that queries of all healthy ones read */
    uint64_t faults;         /* maps found cut or changed since the start */
    uint64_t scrubbed;       /* checks by umbs_store_scrub that found an asset whole */
    int64_t scrubbed_at;     /* Unix seconds of the last one; 0 = none */
};

void umbs_store_count(struct umbs_store *store, struct umbs_store_counts *counts);

#endif

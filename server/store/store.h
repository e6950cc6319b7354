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
 * Names: a file's name less `.umb`, or FOLDER/NAME for one a folder further down. A symbolic link
 * is a further name of what it points to ("city/latest"). If two of the store's folders have a
 * name, the earlier one's is served.
 *
 * Every packed file is proven (SHA-256 of head and pages against the id it carries) before its
 * first answer, then mapped from a cache file ID.umbm that the store makes itself and that no other
 * user can change (store_cache.h). The cache is only a faster form. A file in it that is missing,
 * damaged or different from its record is made anew. If the cache cannot be used, the packed file
 * is expanded in memory, with a notice. A known asset opens in milliseconds.
 *
 * A damaged file stays in the list with its reason: asking for it gives E_CORRUPT, and nothing else
 * is affected. A changed file (inode, size, time of change) is loaded and proven first, then takes
 * the old one's place; the old version lives until its last batch lets go.
 *
 * A mapped cache that somebody cuts or overwrites fails the batches that were reading it
 * (asset_map.h) and is set aside at once; the next scan makes it anew from the packed file.
 *
 * Threads: acquire, release and list may be called from any thread at any time; acquire and list
 * hold a mutex for a few instructions, never during a look-up, a batch, a load or an unmap. A
 * thread that must not wait for others even so long looks through a reader of its own, below.
 * Rescans exclude one another. An entry is one version of one asset and immutable. Why a retired
 * version cannot be freed too early: who looks holds the table he looks into, the table holds one
 * reference to each of its entries, so an entry found cannot reach zero before the finder has it.
 * Trust: file content is hostile. Names beyond [A-Za-z0-9._-] and what is not a regular file are
 * skipped. Packed files are read, not mapped, so that one cut short meanwhile is an error and not
 * a signal. Mapped files are believed under a key only.
 */
#include <stddef.h>
#include <stdint.h>
#include "common/log.h"
#include "umbrage/asset.h"

#define UMBS_STORE_NAME_MAX        251  /* bytes of an asset's name */
#define UMBS_STORE_TEMPORARY_AGE_S 3600 /* older `.tmp.*` files belong to nobody */
#define UMBS_STORE_FOLDERS_MAX     17
#define UMBS_STORE_SETTLE_MS       500 /* a file changed less long ago may still be being copied */

struct umbs_store; /* opaque */
struct umbs_entry; /* opaque: one version of one asset */

struct umbs_store_options {
    const char *folders[UMBS_STORE_FOLDERS_MAX]; /* at least one; the first NULL ends the list */
    const char *cache; /* folder of mapped files (store_cache.h); NULL = `.umbrage-cache` in each */
    uint64_t max_memory_bytes;  /* packed and expanded size of one asset; 0 = 64 GiB */
    const struct umbs_log *log; /* NULL = silent; must outlive the store */
    int no_cache;               /* 1 = never write cache files, expand in memory */
    int copy;                   /* 1 = hold copies in memory, so that files may be changed */
    int warm;                   /* 1 = read mapped files ahead when they are opened */
    /* Called when a retired version waits to be freed, from whatever thread released it: must not
     * wait. The owner then calls umbs_store_reap where blocking is allowed. NULL: it is freed at
     * once. */
    void (*retired)(void *user);
    /* Called when an asset was set aside, from the thread that found it, and when the lane loaded
     * one: the owner then rescans. NULL: it waits for the next scan. */
    void (*faulted)(void *user);
    void *owner; /* user of both */
};

/* What a rescan found and did. */
struct umbs_store_report {
    size_t loaded, failed, removed, unchanged; /* files */
    size_t failed_machine;                     /* of the failed: no fault of the file's */
    uint64_t load_ms;                          /* spent on the loaded and the failed */
    size_t skipped;                            /* names that cannot be asset names */
    size_t shadowed;                           /* names that an earlier folder has too */
    size_t swept;                              /* stray temporaries removed */
    int unsettled; /* 1 if a file that failed is so young that it should be tried again soon */
};

struct umbs_store_item {
    char name[UMBS_STORE_NAME_MAX + 1];
    uint8_t id[UMB_ID_BYTES];
    uint64_t packed_bytes, memory_bytes;
    uint32_t light_count;
    enum umb_status status; /* UMB_OK, or why it cannot answer */
};

/* Opens a store's folders and caches. Does not scan yet. Fails: E_NO_INPUT, E_PERMISSION,
 * E_NO_MEMORY; what umbs__cache_ready fails with, for a cache that the options name. */
UMB_CHECKED enum umb_status umbs_store_open(const struct umbs_store_options *options,
                                            struct umbs_store **out, struct umb_error *error);

/* Frees a store; entries still held stay valid until released. NULL is allowed. */
void umbs_store_close(struct umbs_store *store);

/*
 * Looks at the folders, loads what is new or changed, drops what is gone, sweeps old temporaries.
 * What opens at once is published at once; what takes long is published one by one.
 *
 * Out:   report: filled also on failure; may be NULL.
 * Fails: E_IO or E_NO_INPUT if the folder cannot be read (the old table stays), E_NO_MEMORY. A bad
 *        file is not a failure of the scan.
 * Cost:  blocks on the disk; new files are read and proven.
 */
UMB_CHECKED enum umb_status umbs_store_rescan(struct umbs_store *store,
                                              struct umbs_store_report *report,
                                              struct umb_error *error);

/*
 * Has files of from_bytes and more loaded by a thread of the store's own, one at a time: rescans go
 * on with the others, keep the old version of such a file, and take the new one once `faulted` was
 * called. Without it a rescan loads everything itself. Stop it before the store is closed.
 *
 * _stop waits so long for a load to end; returns 0 if it did not: then the store cannot be closed.
 * Threads: not at once with a rescan. Fails: E_LIMIT (no thread).
 */
UMB_CHECKED enum umb_status umbs_store_lane_start(struct umbs_store *store, uint64_t from_bytes,
                                                  struct umb_error *error);
int umbs_store_lane_stop(struct umbs_store *store, uint32_t wait_ms);

/*
 * Checks again the one asset whose mapped file was last checked longest ago, if that is interval_ms
 * or more, or it was opened by what is known of it: damage sets it aside as a failed read does.
 * Copies need no check. Returns 1 if there was one to check, and how many bytes were read.
 *
 * Cost: blocks on the disk; one pass over the file.
 */
int umbs_store_scrub(struct umbs_store *store, uint64_t interval_ms, uint64_t *bytes);

/* Frees retired versions that nobody holds any more. Blocks on unmapping. */
void umbs_store_reap(struct umbs_store *store);

/*
 * Finds an asset by its id (64 hexadecimal digits) or its name and takes a reference.
 *
 * Fails: E_NOT_FOUND; E_CORRUPT with the reason if its file is damaged.
 */
UMB_CHECKED enum umb_status umbs_store_acquire(struct umbs_store *store, const char *name_or_id,
                                               struct umbs_entry **out, struct umb_error *error);

/*
 * The file of an asset is about to be replaced by an equal one, which shall be loaded as if it were
 * the first: the mapped form that is kept of it is removed, and the version in use is one that
 * umbs_entry_is_replaced tells. It goes on answering until the next scan.
 *
 * In:    folder: number of the folder whose file it is; nothing happens if the asset is not served
 *        from there. yes: 0 = the replacement failed and the version in use stays.
 *        Cost: blocks on the disk.
 */
void umbs_store_replacing(struct umbs_store *store, const uint8_t id[UMB_ID_BYTES], size_t folder,
                          int yes);
int umbs_entry_is_replaced(const struct umbs_entry *entry);

/*
 * One thread's own way to the assets, for threads that answer queries: acquire, has and refresh
 * take no lock and never wait, whatever scans, other readers and releases do meanwhile. They see
 * all that a scan published before they were called.
 *
 * A reader holds the versions of its last look; one that has nothing to look for refreshes now and
 * then, so that what was replaced can be freed. Close it before the store.
 *
 * Threads: one at a time. Fails: open E_NO_MEMORY; acquire as umbs_store_acquire.
 * Cost:  two reads more than the look-up; after a scan published, an exchange and a count down.
 */
struct umbs_reader; /* opaque */

UMB_CHECKED enum umb_status umbs_reader_open(struct umbs_store *store, struct umbs_reader **out,
                                             struct umb_error *error);
void umbs_reader_close(struct umbs_reader *reader); /* NULL is allowed */

UMB_CHECKED enum umb_status umbs_reader_acquire(struct umbs_reader *reader, const char *name_or_id,
                                                struct umbs_entry **out, struct umb_error *error);
/* 1 if one of the first so many folders has a whole file of that id. */
int umbs_reader_has(struct umbs_reader *reader, const uint8_t id[UMB_ID_BYTES], size_t folders);
void umbs_reader_refresh(struct umbs_reader *reader);

/* Says that there is no such asset: E_NOT_FOUND, as umbs_store_acquire does. */
UMB_CHECKED enum umb_status umbs_store_not_found(const char *name_or_id, struct umb_error *error);

/* Takes a further reference. Never waits. */
void umbs_entry_retain(struct umbs_entry *entry);

/* Gives a reference back; waits for nothing if there is a `retired`. NULL is allowed. */
void umbs_entry_release(struct umbs_entry *entry);

/*
 * Calls read(user), which may read the entry's voxels (umb_query_run and the like) and must hold no
 * lock and own nothing, because it may be left midway.
 *
 * Fails: E_CORRUPT if the mapped file was cut or changed: what read gave must not be used, and the
 *        asset is set aside.
 * Cost:  0.2 us.
 */
UMB_CHECKED enum umb_status umbs_entry_read(struct umbs_entry *entry, void (*read)(void *user),
                                            void *user, struct umb_error *error);

/*
 * The same in two steps, for many small reads: what optimistic reads gave may be used once a
 * revalidation after all of them succeeded. Each of the two fails as umbs_entry_read does.
 * Cost:  read 10 ns, revalidate 0.2 us.
 */
UMB_CHECKED enum umb_status umbs_entry_read_optimistic(struct umbs_entry *entry,
                                                       void (*read)(void *user), void *user,
                                                       struct umb_error *error);
UMB_CHECKED enum umb_status umbs_entry_revalidate(struct umbs_entry *entry,
                                                  struct umb_error *error);

/* Borrowed until the release. Its description may be read at any time, its voxels in
 * umbs_entry_read only. */
const struct umb_asset *umbs_entry_asset(const struct umbs_entry *entry);
const struct umbs_store_item *umbs_entry_item(const struct umbs_entry *entry);

/*
 * Opens the packed file that an entry was made from, for reading it in parts.
 *
 * Out:   fd: the caller closes it; -1 on failure. size: bytes of the file.
 * Fails: E_STATE (there is another file now, or none), E_IO, E_NO_MEMORY.
 * Cost:  blocks on the disk.
 */
UMB_CHECKED enum umb_status umbs_entry_open_packed(const struct umbs_entry *entry, int *fd,
                                                   uint64_t *size, struct umb_error *error);

/* Copies the list, sorted by name, damaged ones included; free() it. Fails: E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbs_store_list(struct umbs_store *store,
                                            struct umbs_store_item **items, size_t *count,
                                            struct umb_error *error);

struct umbs_store_counts {
    size_t healthy, damaged; /* files that answer, and that do not */
    uint64_t memory_bytes;   /* that queries of all healthy ones read */
    uint64_t faults;         /* maps found cut or changed since the start */
    uint64_t scrubbed;       /* checks by umbs_store_scrub that found an asset whole */
    int64_t scrubbed_at;     /* time of the last one, Unix seconds; 0 = none */
};

void umbs_store_count(struct umbs_store *store, struct umbs_store_counts *counts);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The store: opening, closing, entries and their end.
 *
 * Invariants: a table holds one reference to each of its entries. An entry with no references is in
 * no table; it is in the free list, or being freed by the thread that emptied the list. The store
 * itself lives until it is closed and its last entry is gone. A thread that pushes onto a free list
 * while the store may be closed holds the store during the push, because another thread may free
 * the pushed entry at once.
 */
#include "store/store_internal.h"

#include <assert.h>
#include <dirent.h>
#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "base/compat.h"
#include "base/open_status.h"

char *umbs__path_join(const char *folder, const char *name)
{
    size_t a = strlen(folder);
    size_t b = strlen(name);
    char *path = malloc(a + b + 2);
    if (path != NULL) {
        memcpy(path, folder, a);
        path[a] = '/';
        memcpy(path + a + 1, name, b + 1);
    }
    return path;
}

static void store_free(struct umbs_store *store)
{
    pthread_mutex_destroy(&store->mutex);
    pthread_mutex_destroy(&store->scan);
    umbs__lane_finish(&store->lane);
    for (size_t i = 0; i < store->folder_count; i++) {
        free(store->folders[i].path);
    }
    for (size_t i = 0; i < store->cache_count; i++) {
        umbs__cache_finish(&store->caches[i]);
    }
    free(store);
}

/* Gives back `count` holds of a store; the last one frees it. */
static void store_let_go(struct umbs_store *store, size_t count)
{
    if (atomic_fetch_sub(&store->holders, count) == count) {
        store_free(store);
    }
}

void umbs__entry_retire(struct umbs_entry *entry)
{
    struct umbs_store *store = entry->store;
    entry->next_retired = atomic_load(&store->free_list);
    while (!atomic_compare_exchange_weak(&store->free_list, &entry->next_retired, entry)) {
    }
}

/* Drops the references of an old table, and frees it. */
static void table_free(struct umbs_table *table)
{
    for (size_t i = 0; i < table->count; i++) {
        if (atomic_fetch_sub(&table->by_name[i]->references, 1) == 1) {
            umbs__entry_retire(table->by_name[i]);
        }
    }
    free(table->by_name);
    free(table->by_id);
    free(table->damaged);
    free(table);
}

/* Frees entries that are no longer reachable. Returns how many. */
static size_t free_entries(struct umbs_entry *list)
{
    size_t count = 0;
    while (list != NULL) {
        struct umbs_entry *entry = list;
        list = entry->next_retired;
        umbs_asset_map_close(entry->map);
        umb_asset_close(entry->expanded);
        free(entry);
        count++;
    }
    return count;
}

void umbs_store_reap(struct umbs_store *store)
{
    struct umbs_table *table = atomic_exchange(&store->old_tables, NULL);
    while (table != NULL) {
        struct umbs_table *next = table->next_retired;
        table_free(table);
        table = next;
    }
    store_let_go(store, free_entries(atomic_exchange(&store->free_list, NULL)));
}

void umbs__reap_soon(struct umbs_store *store)
{
    if (store->retired != NULL && !atomic_load(&store->closed)) {
        store->retired(store->owner);
    } else {
        umbs_store_reap(store);
    }
}

/* Adds a cache at a path, and reads its list of proven files. Only a cache that the options name
 * must be usable. */
static enum umb_status open_cache(struct umbs_store *store, const char *path, int is_asked_for,
                                  struct umb_error *error)
{
    struct umbs_cache *cache = &store->caches[store->cache_count++];
    struct umb_error cause;
    char quoted[UMBS_LOG_QUOTE_SIZE];
    enum umb_status status = umbs__cache_init(cache, path, store->log, error);
    if (status != UMB_OK || umbs__cache_ready(cache, NULL, &cause) == UMB_OK) {
        return status;
    }
    if (is_asked_for) {
        return umb_fail(error, cause.status, "--cache: %s", cause.message);
    }
    umbs_log_event(store->log, UMB_LOG_WARN, "cache_refused", "reason=%s option=--cache",
                   umbs_log_quote(cause.message, quoted));
    return UMB_OK;
}

/* Checks that a folder is there, and opens its cache. */
static enum umb_status open_folder(struct umbs_store *store, const char *path, const char *cache,
                                   struct umb_error *error)
{
    struct umbs_folder *folder = &store->folders[store->folder_count];
    DIR *opened = opendir(path);
    if (opened == NULL) {
        int code = errno;
        return umb_fail_errno(error, umb__open_status(code), code,
                              "cannot open the store folder '%.200s'", path);
    }
    closedir(opened);
    store->folder_count++;
    folder->path = strdup(path);
    if (folder->path == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for the store");
    }
    if (store->no_cache) {
        return UMB_OK;
    }
    if (cache != NULL) {
        folder->cache = &store->caches[0];
        return store->cache_count > 0 ? UMB_OK : open_cache(store, cache, 1, error);
    }
    folder->cache = &store->caches[store->cache_count];
    char *inside = umbs__path_join(path, UMBS_CACHE_FOLDER);
    enum umb_status status = inside != NULL
                                 ? open_cache(store, inside, 0, error)
                                 : umb_fail(error, UMB_E_NO_MEMORY, "out of memory for the store");
    free(inside);
    return status;
}

void umbs_store_close(struct umbs_store *store)
{
    if (store == NULL) {
        return;
    }
    assert(store->readers == NULL);
    assert(!store->lane.running);
    for (size_t i = 0; i < store->cache_count; i++) {
        umbs__cache_let_go(&store->caches[i]);
    }
    /* Before the reaping: a thread that retires an entry after this store sees it, and reaps the
     * entry itself. */
    atomic_store(&store->closed, 1);
    if (store->table != NULL) {
        (void)umbs__table_let_go(store, store->table);
    }
    umbs_store_reap(store);
    store_let_go(store, 1);
}

enum umb_status umbs_store_open(const struct umbs_store_options *options, struct umbs_store **out,
                                struct umb_error *error)
{
    *out = NULL;
    struct umbs_store *store = calloc(1, sizeof *store);
    if (store == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for the store");
    }
    store->max_memory_bytes =
        options->max_memory_bytes != 0 ? options->max_memory_bytes : (uint64_t)64 << 30;
    store->no_cache = options->no_cache;
    store->copy = options->copy;
    store->warm = options->warm;
    store->log = options->log;
    store->retired = options->retired;
    store->faulted = options->faulted;
    store->owner = options->owner;
    pthread_mutex_init(&store->scan, NULL);
    pthread_mutex_init(&store->mutex, NULL);
    umbs__lane_init(&store->lane);
    atomic_init(&store->holders, 1);
    store->table = umbs__table_create(0);
    enum umb_status status = store->table != NULL
                                 ? UMB_OK
                                 : umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a store");
    for (size_t i = 0; status == UMB_OK && i < UMBS_STORE_FOLDERS_MAX && options->folders[i]; i++) {
        status = open_folder(store, options->folders[i], options->cache, error);
    }
    if (status != UMB_OK) {
        umbs_store_close(store);
        return status;
    }
    *out = store;
    return UMB_OK;
}

enum umb_status umbs_store_acquire(struct umbs_store *store, const char *name_or_id,
                                   struct umbs_entry **out, struct umb_error *error)
{
    struct umbs_table *table = umbs__table_hold(store);
    enum umb_status status = umbs__table_acquire(table, name_or_id, out, error);
    umbs__table_walked(store, table);
    return status;
}

void umbs_entry_retain(struct umbs_entry *entry)
{
    atomic_fetch_add_explicit(&entry->references, 1, memory_order_relaxed);
}

void umbs_entry_release(struct umbs_entry *entry)
{
    if (entry == NULL || atomic_fetch_sub(&entry->references, 1) > 1) {
        return;
    }
    struct umbs_store *store = entry->store;
    atomic_fetch_add(&store->holders, 1);
    umbs__entry_retire(entry);
    umbs__reap_soon(store);
    store_let_go(store, 1);
}

/* Takes a damaged entry out of use: no further call gets it, and the owner is asked for a scan that
 * replaces it. Of several batches that find the same damage, only the first does so. */
void umbs__entry_quarantine(struct umbs_entry *entry, const struct umb_error *error)
{
    struct umbs_store *store = entry->store;
    void (*faulted)(void *user) = NULL;
    void *owner = NULL;
    pthread_mutex_lock(&store->mutex);
    int first = !atomic_load(&entry->faulted);
    if (first) {
        entry->error = *error;
        atomic_store(&entry->faulted, 1);
        store->faults++;
        faulted = atomic_load(&store->closed) ? NULL : store->faulted;
        owner = store->owner;
    }
    pthread_mutex_unlock(&store->mutex);
    if (first) {
        char quoted[UMBS_LOG_QUOTE_SIZE];
        umbs_log_event(store->log, UMB_LOG_ERROR, "asset_quarantined", "asset=%s reason=%s",
                       entry->item.name, umbs_log_quote(error->message, quoted));
    }
    if (faulted != NULL) {
        faulted(owner);
    }
}

/* Takes an entry out of use whose file proved to be damaged. */
static enum umb_status is_damaged(struct umbs_entry *entry, const struct umb_error *cause,
                                  struct umb_error *error)
{
    umbs__entry_quarantine(entry, cause);
    return umb_fail(error, cause->status, "asset: '%.64s' is damaged: %s", entry->item.name,
                    cause->message);
}

enum umb_status umbs_entry_read_optimistic(struct umbs_entry *entry, void (*read)(void *user),
                                           void *user, struct umb_error *error)
{
    struct umb_error cause UMB__UNSET;
    if (entry->map == NULL) {
        read(user);
        return UMB_OK;
    }
    return umbs_asset_map_read_optimistic(entry->map, read, user, &cause) == UMB_OK
               ? UMB_OK
               : is_damaged(entry, &cause, error);
}

enum umb_status umbs_entry_revalidate(struct umbs_entry *entry, struct umb_error *error)
{
    struct umb_error cause UMB__UNSET;
    return entry->map == NULL || umbs_asset_map_revalidate(entry->map, &cause) == UMB_OK
               ? UMB_OK
               : is_damaged(entry, &cause, error);
}

enum umb_status umbs_entry_read(struct umbs_entry *entry, void (*read)(void *user), void *user,
                                struct umb_error *error)
{
    enum umb_status status = umbs_entry_read_optimistic(entry, read, user, error);
    return status == UMB_OK ? umbs_entry_revalidate(entry, error) : status;
}

const struct umb_asset *umbs_entry_asset(const struct umbs_entry *entry)
{
    return entry->asset;
}

const struct umbs_store_item *umbs_entry_item(const struct umbs_entry *entry)
{
    return &entry->item;
}

enum umb_status umbs_store_list(struct umbs_store *store, struct umbs_store_item **items,
                                size_t *count, struct umb_error *error)
{
    *items = NULL;
    *count = 0;
    struct umbs_table *table = umbs__table_hold(store);
    size_t found = table->count;
    struct umbs_store_item *list = calloc(found + 1, sizeof *list);
    for (size_t i = 0; list != NULL && i < found; i++) {
        const struct umbs_entry *entry = table->by_name[i];
        list[i] = entry->item;
        list[i].status = atomic_load(&entry->faulted) ? UMB_E_CORRUPT : entry->item.status;
    }
    umbs__table_walked(store, table);
    if (list == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a list of %zu assets", found);
    }
    *items = list;
    *count = found;
    return UMB_OK;
}

void umbs_store_count(struct umbs_store *store, struct umbs_store_counts *counts)
{
    memset(counts, 0, sizeof *counts);
    struct umbs_table *table = umbs__table_hold(store);
    for (size_t i = 0; i < table->count; i++) {
        const struct umbs_entry *entry = table->by_name[i];
        if (entry->asset != NULL && !atomic_load(&entry->faulted)) {
            counts->healthy++;
            counts->memory_bytes += entry->item.memory_bytes;
        } else {
            counts->damaged++;
        }
    }
    umbs__table_walked(store, table);
    pthread_mutex_lock(&store->mutex);
    counts->faults = store->faults;
    counts->scrubbed = store->scrubbed;
    counts->scrubbed_at = store->scrubbed_at;
    pthread_mutex_unlock(&store->mutex);
}

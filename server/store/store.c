/* SPDX-License-Identifier: Apache-2.0 */
/* The store: opening, closing, scrubbing, and the announcement of replaced files. */
#include "store/store_internal.h"

#include <assert.h>
#include <dirent.h>
#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/open_status.h"
#include "base/try.h"
#include "tool/clock.h"

/* Adds a cache at a path, and reads its list of proven files. is_asked_for: 1 if the options name
 * the cache; opening the store then fails if the cache is not usable. */
static enum umb_status open_cache(struct umbs_store *store, const char *path, int is_asked_for,
                                  struct umb_error *error)
{
    struct umbs_cache *cache = &store->caches[store->cache_count++];
    struct umb_error cause;
    char quoted[UMBS_LOG_QUOTE_SIZE];
    UMB__TRY(umbs__cache_init(cache, path, store->options.log, error));
    if (umbs__cache_ready(cache, NULL, &cause) == UMB_OK) {
        return UMB_OK;
    }
    if (is_asked_for) {
        return umb_fail(error, cause.status, "--cache: %s", cause.message);
    }
    umbs_log_event(store->options.log, UMB_LOG_WARN, "cache_refused", "reason=%s option=--cache",
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
        return umb_fail_errno(error, umb__open_status(errno), errno,
                              "cannot open the store folder '%.200s'", path);
    }
    closedir(opened);
    store->folder_count++;
    folder->path = strdup(path);
    if (folder->path == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for the store");
    }
    if (store->options.no_cache) {
        return UMB_OK;
    }
    if (cache != NULL) {
        folder->cache = &store->caches[0];
        return store->cache_count > 0 ? UMB_OK : open_cache(store, cache, 1, error);
    }
    char inside[UMBS_PATH_SIZE];
    umbs__path(inside, path, UMBS_CACHE_FOLDER);
    folder->cache = &store->caches[store->cache_count];
    return open_cache(store, inside, 0, error);
}

void umbs_store_close(struct umbs_store *store)
{
    if (store == NULL) {
        return;
    }
    assert(store->readers == NULL);
    assert(!store->lane.running);
    umbs__lane_finish(&store->lane);
    for (size_t i = 0; i < store->cache_count; i++) {
        umbs__cache_finish(&store->caches[i]);
    }
    /* The flag is set before the reaping (the freeing of retired entries): a thread that retires an
     * entry afterwards sees it and frees the entry itself. */
    atomic_store(&store->closed, 1);
    if (store->table != NULL) {
        (void)umbs__table_let_go(store, store->table);
    }
    umbs_store_reap(store);
    umbs__store_let_go(store, 1);
}

enum umb_status umbs_store_open(const struct umbs_store_options *options, struct umbs_store **out,
                                struct umb_error *error)
{
    *out = NULL;
    struct umbs_store *store = calloc(1, sizeof *store);
    if (store == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for the store");
    }
    store->options = *options;
    if (store->options.max_memory_bytes == 0) {
        store->options.max_memory_bytes = (uint64_t)64 << 30;
    }
    pthread_mutex_init(&store->scan, NULL);
    pthread_mutex_init(&store->mutex, NULL);
    umbs__lane_init(&store->lane);
    atomic_init(&store->holders, 1);
    store->table = umbs__table_create(0);
    enum umb_status status = store->table != NULL
                                 ? UMB_OK
                                 : umb_fail(error, UMB_E_NO_MEMORY, "out of memory for the store");
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

void umbs_store_replacing(struct umbs_store *store, const uint8_t id[UMB_ID_BYTES], size_t folder,
                          int yes)
{
    char text[UMB_ID_TEXT_SIZE], path[UMBS_PATH_SIZE];
    struct umbs_entry *entry = NULL;
    struct umb_error error;
    umb_id_to_text(id, text);
    if (umbs_store_acquire(store, text, &entry, &error) == UMB_OK && entry->folder == folder) {
        struct umbs_cache *cache = store->folders[folder].cache;
        atomic_store(&entry->replaced, yes);
        if (yes && cache != NULL) {
            umbs__cache_file(cache, id, path);
            (void)unlink(path); /* processes that have mapped the file keep it */
        }
    }
    umbs_entry_release(entry);
}

/* Takes a reference to the asset whose mapped file was checked longest ago, if a check is due. */
static struct umbs_entry *take_due(struct umbs_store *store, uint64_t interval_ms)
{
    uint64_t now_ms = (uint64_t)umbu_clock_ms();
    struct umbs_entry *due = NULL;
    struct umbs_table *table = umbs__table_hold(store);
    for (size_t i = 0; i < table->all.count; i++) {
        struct umbs_entry *entry = table->all.list[i];
        if (entry->map != NULL && !atomic_load(&entry->faulted) &&
            !umbs_asset_map_is_copy(entry->map) &&
            (due == NULL || entry->checked_ms < due->checked_ms)) {
            due = entry;
        }
    }
    if (due != NULL && due->checked_ms != 0 && now_ms - due->checked_ms < interval_ms) {
        due = NULL;
    }
    if (due != NULL) {
        umbs_entry_retain(due);
    }
    umbs__table_walked(store, table);
    return due;
}

int umbs_store_scrub(struct umbs_store *store, uint64_t interval_ms, uint64_t *bytes)
{
    struct umb_error error;
    struct umbs_entry *entry = take_due(store, interval_ms);
    *bytes = 0;
    if (entry == NULL) {
        return 0;
    }
    enum umb_status status = umbs_asset_map_check(entry->map, &error);
    *bytes = umbs_asset_map_stamp(entry->map)->size;
    if (status != UMB_OK && status != UMB_E_NO_MEMORY) {
        umbs__entry_quarantine(entry, &error);
    }
    atomic_store(&entry->checked_ms, (uint64_t)umbu_clock_ms());
    if (status == UMB_OK) {
        pthread_mutex_lock(&store->mutex);
        store->scrubbed++;
        store->scrubbed_at = time(NULL);
        pthread_mutex_unlock(&store->mutex);
    }
    umbs_entry_release(entry);
    return 1;
}

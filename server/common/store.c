/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The store's table: look-up, references, retirement.
 *
 * Invariants: table entries hold one reference each; an entry with no references is in no table and
 * either in the graveyard or being freed by the thread that took the last one; the store itself
 * lives until it is closed and its last entry is gone.
 */
#include "common/store_internal.h"

#include <dirent.h>
#include <errno.h>
#include <stdlib.h>
#include <string.h>

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

struct umbs_entry *umbs__table_find_name(const struct umbs_table *table, const char *name)
{
    size_t low = 0;
    size_t high = table->count;
    while (low < high) {
        size_t middle = low + (high - low) / 2;
        int order = strcmp(name, table->by_name[middle]->item.name);
        if (order == 0) {
            return table->by_name[middle];
        }
        if (order < 0) {
            high = middle;
        } else {
            low = middle + 1;
        }
    }
    return NULL;
}

static int has_id(const struct umbs_table *table, size_t index, const uint8_t id[UMB_ID_BYTES])
{
    return index < table->healthy && memcmp(table->by_id[index]->item.id, id, UMB_ID_BYTES) == 0;
}

/* Where the entries of an id begin: several files may hold the same asset. */
static size_t first_of_id(const struct umbs_table *table, const uint8_t id[UMB_ID_BYTES])
{
    size_t low = 0;
    size_t high = table->healthy;
    while (low < high) {
        size_t middle = low + (high - low) / 2;
        if (memcmp(id, table->by_id[middle]->item.id, UMB_ID_BYTES) <= 0) {
            high = middle;
        } else {
            low = middle + 1;
        }
    }
    return low;
}

struct umbs_entry *umbs__table_find_id(const struct umbs_table *table,
                                       const uint8_t id[UMB_ID_BYTES])
{
    const size_t first = first_of_id(table, id);
    return has_id(table, first, id) ? table->by_id[first] : NULL;
}

static void store_free(struct umbs_store *store)
{
    pthread_mutex_destroy(&store->mutex);
    pthread_mutex_destroy(&store->scan);
    for (size_t i = 0; i < store->folder_count; i++) {
        free(store->folders[i].path);
        free(store->folders[i].cache);
        free(store->folders[i].proven);
        umbs__records_finish(&store->folders[i].records);
    }
    free(store);
}

/* Frees entries that nobody can reach any more, without the mutex, then settles the count. */
static void bury(struct umbs_store *store, struct umbs_entry *list)
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
    pthread_mutex_lock(&store->mutex);
    store->entries -= count;
    int last = store->closed && store->entries == 0;
    pthread_mutex_unlock(&store->mutex);
    if (last) {
        store_free(store);
    }
}

/* Looks whether a folder is there, and reads what was proven in it before. */
static enum umb_status open_folder(struct umbs_store *store, const char *path,
                                   struct umb_error *error)
{
    struct umbs_folder *folder = &store->folders[store->folder_count];
    struct umb_error cause;
    DIR *opened = opendir(path);
    if (opened == NULL) {
        int code = errno;
        return umb_fail_errno(error, umb__open_status(code), code,
                              "cannot open the store folder '%.200s'", path);
    }
    closedir(opened);
    store->folder_count++;
    folder->path = strdup(path);
    folder->cache = umbs__path_join(path, UMBS_CACHE_FOLDER);
    folder->proven = umbs__path_join(path, UMBS_CACHE_FOLDER "/proven");
    if (folder->path == NULL || folder->cache == NULL || folder->proven == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for the store");
    }
    if (!store->no_cache &&
        umbs__records_read(folder->proven, &folder->records, &cause) != UMB_OK) {
        char quoted[UMBS_LOG_QUOTE_SIZE];
        umbs_log_event(store->log, UMB_LOG_WARN, "proven_forgotten", "reason=%s",
                       umbs_log_quote(cause.message, quoted));
    }
    return UMB_OK;
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
    enum umb_status status = UMB_OK;
    for (size_t i = 0; status == UMB_OK && i < UMBS_STORE_FOLDERS_MAX && options->folders[i]; i++) {
        status = open_folder(store, options->folders[i], error);
    }
    if (status != UMB_OK) {
        store_free(store);
        return status;
    }
    *out = store;
    return UMB_OK;
}

void umbs_store_close(struct umbs_store *store)
{
    if (store == NULL) {
        return;
    }
    pthread_mutex_lock(&store->mutex);
    struct umbs_table table = store->table;
    memset(&store->table, 0, sizeof store->table);
    struct umbs_entry *dead = store->graveyard;
    store->graveyard = NULL;
    for (size_t i = 0; i < table.count; i++) {
        struct umbs_entry *entry = table.by_name[i];
        if (--entry->references == 0) {
            entry->next_retired = dead;
            dead = entry;
        }
    }
    store->closed = 1;
    pthread_mutex_unlock(&store->mutex);
    free(table.by_name);
    free(table.by_id);
    bury(store, dead);
}

void umbs_store_reap(struct umbs_store *store)
{
    pthread_mutex_lock(&store->mutex);
    struct umbs_entry *dead = store->graveyard;
    store->graveyard = NULL;
    pthread_mutex_unlock(&store->mutex);
    if (dead != NULL) {
        bury(store, dead);
    }
}

void umbs_entry_retain(struct umbs_entry *entry)
{
    pthread_mutex_lock(&entry->store->mutex);
    entry->references++;
    pthread_mutex_unlock(&entry->store->mutex);
}

/* Failures that are the file's are told as damage; others (no memory) as what they are. */
static enum umb_status told_status(enum umb_status status)
{
    switch (status) {
    case UMB_E_FORMAT:
    case UMB_E_TRUNCATED:
        return UMB_E_CORRUPT;
    default:
        return status;
    }
}

/* A damaged file whose head says it is that asset, so that who asks by id hears the same as who
 * asks by name. Usually there is none to look at. */
static struct umbs_entry *find_damaged(const struct umbs_table *table,
                                       const uint8_t id[UMB_ID_BYTES])
{
    for (size_t i = 0; table->healthy < table->count && i < table->count; i++) {
        struct umbs_entry *entry = table->by_name[i];
        if (entry->asset == NULL && entry->has_id &&
            memcmp(entry->item.id, id, UMB_ID_BYTES) == 0) {
            return entry;
        }
    }
    return NULL;
}

int umbs_store_has(struct umbs_store *store, const uint8_t id[UMB_ID_BYTES], size_t folders)
{
    int has = 0;
    pthread_mutex_lock(&store->mutex);
    const struct umbs_table *table = &store->table;
    for (size_t i = first_of_id(table, id); has_id(table, i, id); i++) {
        has |= table->by_id[i]->folder < folders;
    }
    pthread_mutex_unlock(&store->mutex);
    return has;
}

enum umb_status umbs_store_not_found(const char *name_or_id, struct umb_error *error)
{
    char quoted[UMBS_LOG_QUOTE_SIZE];
    return umb_fail(error, UMB_E_NOT_FOUND, "asset: no asset named %.200s in this store",
                    umbs_log_quote(name_or_id, quoted));
}

enum umb_status umbs_store_acquire(struct umbs_store *store, const char *name_or_id,
                                   struct umbs_entry **out, struct umb_error *error)
{
    uint8_t id[UMB_ID_BYTES];
    int is_id = umb_id_from_text(name_or_id, id);
    enum umb_status status = UMB_OK;
    *out = NULL;
    pthread_mutex_lock(&store->mutex);
    struct umbs_entry *entry = is_id ? umbs__table_find_id(&store->table, id) : NULL;
    if (entry == NULL && is_id) {
        entry = find_damaged(&store->table, id);
    }
    if (entry == NULL) {
        entry = umbs__table_find_name(&store->table, name_or_id);
    }
    if (entry == NULL) {
        status = umbs_store_not_found(name_or_id, error);
    } else if (entry->asset == NULL || entry->faulted) {
        status = umb_fail(error, told_status(entry->error.status), "asset: '%.64s' is damaged: %s",
                          entry->item.name, entry->error.message);
    } else {
        entry->references++;
        *out = entry;
    }
    pthread_mutex_unlock(&store->mutex);
    return status;
}

void umbs_entry_release(struct umbs_entry *entry)
{
    if (entry == NULL) {
        return;
    }
    struct umbs_store *store = entry->store;
    void (*retired)(void *user) = NULL;
    void *user = NULL;
    struct umbs_entry *dead = NULL;
    pthread_mutex_lock(&store->mutex);
    if (--entry->references == 0) {
        if (store->retired != NULL && !store->closed) {
            entry->next_retired = store->graveyard;
            store->graveyard = entry;
            retired = store->retired;
            user = store->owner;
        } else {
            entry->next_retired = NULL;
            dead = entry;
        }
    }
    pthread_mutex_unlock(&store->mutex);
    if (dead != NULL) {
        bury(store, dead);
    } else if (retired != NULL) {
        retired(user);
    }
}

/* No further call gets the entry, and the owner is asked for a scan that replaces it. Only the
 * first of several batches that find the same damage does so. */
void umbs__entry_quarantine(struct umbs_entry *entry, const struct umb_error *error)
{
    struct umbs_store *store = entry->store;
    void (*faulted)(void *user) = NULL;
    void *owner = NULL;
    pthread_mutex_lock(&store->mutex);
    int first = !entry->faulted;
    if (first) {
        entry->faulted = 1;
        entry->error = *error;
        store->faults++;
        faulted = store->closed ? NULL : store->faulted;
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

/* Sets an entry aside whose file turned out to be damaged. */
static enum umb_status is_damaged(struct umbs_entry *entry, const struct umb_error *cause,
                                  struct umb_error *error)
{
    umbs__entry_quarantine(entry, cause);
    return umb_fail(error, cause->status, "asset: '%.64s' is damaged: %s", entry->item.name,
                    cause->message);
}

enum umb_status umbs_entry_peek(struct umbs_entry *entry, void (*read)(void *user), void *user,
                                struct umb_error *error)
{
    struct umb_error cause;
    if (entry->map == NULL) {
        read(user);
        return UMB_OK;
    }
    return umbs_asset_map_peek(entry->map, read, user, &cause) == UMB_OK
               ? UMB_OK
               : is_damaged(entry, &cause, error);
}

enum umb_status umbs_entry_prove(struct umbs_entry *entry, struct umb_error *error)
{
    struct umb_error cause;
    return entry->map == NULL || umbs_asset_map_prove(entry->map, &cause) == UMB_OK
               ? UMB_OK
               : is_damaged(entry, &cause, error);
}

enum umb_status umbs_entry_read(struct umbs_entry *entry, void (*read)(void *user), void *user,
                                struct umb_error *error)
{
    enum umb_status status = umbs_entry_peek(entry, read, user, error);
    return status == UMB_OK ? umbs_entry_prove(entry, error) : status;
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
    pthread_mutex_lock(&store->mutex);
    size_t found = store->table.count;
    struct umbs_store_item *list = calloc(found + 1, sizeof *list);
    for (size_t i = 0; list != NULL && i < found; i++) {
        const struct umbs_entry *entry = store->table.by_name[i];
        list[i] = entry->item;
        list[i].status = entry->faulted ? UMB_E_CORRUPT : entry->item.status;
    }
    pthread_mutex_unlock(&store->mutex);
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
    pthread_mutex_lock(&store->mutex);
    for (size_t i = 0; i < store->table.count; i++) {
        const struct umbs_entry *entry = store->table.by_name[i];
        if (entry->asset != NULL && !entry->faulted) {
            counts->healthy++;
            counts->memory_bytes += entry->item.memory_bytes;
        } else {
            counts->damaged++;
        }
    }
    counts->faults = store->faults;
    counts->scrubbed = store->scrubbed;
    counts->scrubbed_at = store->scrubbed_at;
    pthread_mutex_unlock(&store->mutex);
}

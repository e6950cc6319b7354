/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Tables and readers: the content of a store at one moment, never changed once published, and how a
 * thread finds assets without ever waiting for another one.
 *
 * An entry cannot be freed while a look-up finds it. The look-up holds the table and the table
 * holds the entry, so the entry's count is at least 1 when the look-up raises it.
 *
 * A reader looks into a table of its own, which it holds. A scan that publishes a table puts it
 * into each reader's mail field, with a hold for that reader. The reader takes the mail with one
 * exchange before it looks, so it sees everything that was published before the look-up. A newer
 * table replaces one that the reader has not taken. The thread that exchanges a table out of the
 * mail owns its hold. So each hold is released once, by the reader or by the scan.
 *
 * Waiting and freeing happen elsewhere. The mutex guards the list of readers; a reader takes it
 * only when it is opened and closed. A table that loses its last reader is left to umbs_store_reap.
 */
#include <stdlib.h>
#include <string.h>

#include "store/store_internal.h"

struct umbs_table *umbs__table_create(size_t room)
{
    struct umbs_table *table = calloc(1, sizeof *table);
    if (table == NULL) {
        return NULL;
    }
    struct umbs_entry_list *const lists[3] = {&table->all, &table->by_id, &table->damaged};
    for (int i = 0; i < 3; i++) {
        lists[i]->list = calloc(room + 1, sizeof(struct umbs_entry *));
        if (lists[i]->list == NULL) {
            umbs__table_free(table);
            return NULL;
        }
    }
    atomic_init(&table->references, 1);
    return table;
}

struct umbs_table *umbs__table_hold(struct umbs_store *store)
{
    pthread_mutex_lock(&store->mutex);
    struct umbs_table *table = store->table;
    atomic_fetch_add(&table->references, 1);
    pthread_mutex_unlock(&store->mutex);
    return table;
}

int umbs__table_let_go(struct umbs_store *store, struct umbs_table *table)
{
    if (atomic_fetch_sub(&table->references, 1) > 1) {
        return 0;
    }
    table->next_retired = atomic_load(&store->old_tables);
    while (!atomic_compare_exchange_weak(&store->old_tables, &table->next_retired, table)) {
    }
    return 1;
}

void umbs__table_walked(struct umbs_store *store, struct umbs_table *table)
{
    if (umbs__table_let_go(store, table)) {
        umbs__reap_soon(store);
    }
}

/* Returns the index of the first entry that is not before `key`. In: compare: order of key and
 * entry. */
static size_t find_first(const struct umbs_entry_list *entries, const void *key,
                         int (*compare)(const void *key, const struct umbs_entry *entry))
{
    size_t low = 0, high = entries->count;
    while (low < high) {
        const size_t middle = low + (high - low) / 2;
        if (compare(key, entries->list[middle]) <= 0) {
            high = middle;
        } else {
            low = middle + 1;
        }
    }
    return low;
}

/* Returns the first entry equal to `key`, or NULL. Several entries may be equal, because several
 * files may hold the same asset. */
static struct umbs_entry *find(const struct umbs_entry_list *entries, const void *key,
                               int (*compare)(const void *key, const struct umbs_entry *entry))
{
    const size_t first = find_first(entries, key, compare);
    return first < entries->count && compare(key, entries->list[first]) == 0 ? entries->list[first]
                                                                             : NULL;
}

static int compare_name(const void *name, const struct umbs_entry *entry)
{
    return strcmp(name, entry->item.name);
}

static int compare_id(const void *id, const struct umbs_entry *entry)
{
    return memcmp(id, entry->item.id, UMB_ID_BYTES);
}

struct umbs_entry *umbs__table_find_name(const struct umbs_table *table, const char *name)
{
    return find(&table->all, name, compare_name);
}

struct umbs_entry *umbs__table_find_id(const struct umbs_table *table,
                                       const uint8_t id[UMB_ID_BYTES])
{
    return find(&table->by_id, id, compare_id);
}

enum umb_status umbs_store_not_found(const char *name_or_id, struct umb_error *error)
{
    char quoted[UMBS_LOG_QUOTE_SIZE];
    return umb_fail(error, UMB_E_NOT_FOUND, "asset: no asset named %.200s in this store",
                    umbs_log_quote(name_or_id, quoted));
}

/* umbs_store_acquire in a table that the caller holds: never waits. */
static enum umb_status table_acquire(const struct umbs_table *table, const char *name_or_id,
                                     struct umbs_entry **out, struct umb_error *error)
{
    uint8_t id[UMB_ID_BYTES];
    int is_id = umb_id_from_text(name_or_id, id) == UMB_OK;
    *out = NULL;
    struct umbs_entry *entry = is_id ? umbs__table_find_id(table, id) : NULL;
    if (entry == NULL && is_id) { /* a call by id gets the same answer as a call by name */
        entry = find(&table->damaged, id, compare_id);
    }
    if (entry == NULL) {
        entry = umbs__table_find_name(table, name_or_id);
    }
    if (entry == NULL) {
        return umbs_store_not_found(name_or_id, error);
    }
    if (entry->asset == NULL || atomic_load(&entry->faulted)) {
        const enum umb_status cause = entry->error.status;
        /* If the file is at fault, the status is that of damage; another failure (no memory) keeps
         * its own. */
        return umb_fail(error, umbs__is_the_files_fault(cause) ? UMB_E_CORRUPT : cause,
                        "asset: '%.64s' %s: %s", entry->item.name,
                        umbs__is_damage(cause) ? "is damaged" : "cannot be read",
                        entry->error.message);
    }
    umbs_entry_retain(entry);
    *out = entry;
    return UMB_OK;
}

enum umb_status umbs_store_acquire(struct umbs_store *store, const char *name_or_id,
                                   struct umbs_entry **out, struct umb_error *error)
{
    struct umbs_table *table = umbs__table_hold(store);
    enum umb_status status = table_acquire(table, name_or_id, out, error);
    umbs__table_walked(store, table);
    return status;
}

enum umb_status umbs_store_list(struct umbs_store *store, struct umbs_store_item **items,
                                size_t *count, struct umb_error *error)
{
    *items = NULL;
    *count = 0;
    struct umbs_table *table = umbs__table_hold(store);
    size_t found = table->all.count;
    struct umbs_store_item *list = calloc(found + 1, sizeof *list);
    for (size_t i = 0; list != NULL && i < found; i++) {
        const struct umbs_entry *entry = table->all.list[i];
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
    for (size_t i = 0; i < table->all.count; i++) {
        const struct umbs_entry *entry = table->all.list[i];
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

struct umbs_table *umbs__table_publish(struct umbs_store *store, struct umbs_table *table)
{
    pthread_mutex_lock(&store->mutex);
    struct umbs_table *old = store->table;
    store->table = table;
    for (struct umbs_reader *reader = store->readers; reader != NULL; reader = reader->next) {
        atomic_fetch_add(&table->references, 1);
        struct umbs_table *unread = atomic_exchange(&reader->mail, table);
        if (unread != NULL) {
            (void)umbs__table_let_go(store, unread); /* the scan reaps after publishing */
        }
    }
    pthread_mutex_unlock(&store->mutex);
    return old;
}

enum umb_status umbs_reader_open(struct umbs_store *store, struct umbs_reader **out,
                                 struct umb_error *error)
{
    *out = NULL;
    struct umbs_reader *reader = calloc(1, sizeof *reader);
    if (reader == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a reader of the store");
    }
    reader->store = store;
    pthread_mutex_lock(&store->mutex);
    reader->table = store->table;
    atomic_fetch_add(&reader->table->references, 1);
    reader->next = store->readers;
    store->readers = reader;
    pthread_mutex_unlock(&store->mutex);
    *out = reader;
    return UMB_OK;
}

void umbs_reader_close(struct umbs_reader *reader)
{
    if (reader == NULL) {
        return;
    }
    struct umbs_store *store = reader->store;
    pthread_mutex_lock(&store->mutex);
    struct umbs_reader **at = &store->readers;
    while (*at != reader) {
        at = &(*at)->next;
    }
    *at = reader->next;
    pthread_mutex_unlock(&store->mutex);
    umbs_reader_refresh(reader); /* the reader is out of the list: no scan writes to its mail */
    umbs__table_walked(store, reader->table);
    free(reader);
}

void umbs_reader_refresh(struct umbs_reader *reader)
{
    /* The mailbox is nearly always empty. A relaxed load leaves its cache line shared with the
     * other readers. */
    if (atomic_load_explicit(&reader->mail, memory_order_relaxed) == NULL) {
        return;
    }
    struct umbs_table *old = reader->table;
    reader->table = atomic_exchange(&reader->mail, NULL);
    umbs__table_walked(reader->store, old);
}

enum umb_status umbs_reader_acquire(struct umbs_reader *reader, const char *name_or_id,
                                    struct umbs_entry **out, struct umb_error *error)
{
    umbs_reader_refresh(reader);
    return table_acquire(reader->table, name_or_id, out, error);
}

int umbs_reader_has(struct umbs_reader *reader, const uint8_t id[UMB_ID_BYTES], size_t folders)
{
    umbs_reader_refresh(reader);
    const struct umbs_entry_list *ids = &reader->table->by_id;
    for (size_t i = find_first(ids, id, compare_id);
         i < ids->count && compare_id(id, ids->list[i]) == 0; i++) {
        if (ids->list[i]->folder < folders) {
            return 1;
        }
    }
    return 0;
}

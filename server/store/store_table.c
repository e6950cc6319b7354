/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Tables: the content of a store at one moment, never changed once published; look-ups in a table,
 * and its holders.
 *
 * An entry cannot be freed while a look-up finds it: the look-up holds the table and the table
 * holds the entry, so the entry's count is at least 1 when the look-up raises it.
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
    table->by_name = calloc(room + 1, sizeof(struct umbs_entry *));
    table->by_id = calloc(room + 1, sizeof(struct umbs_entry *));
    table->damaged = calloc(room + 1, sizeof(struct umbs_entry *));
    if (table->by_name == NULL || table->by_id == NULL || table->damaged == NULL) {
        free(table->by_name);
        free(table->by_id);
        free(table->damaged);
        free(table);
        return NULL;
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

/* Entries sorted by id. */
struct id_list {
    struct umbs_entry *const *list;
    size_t count;
};

static struct id_list healthy_of(const struct umbs_table *table)
{
    return (struct id_list){table->by_id, table->healthy};
}

static int has_id(struct id_list ids, size_t index, const uint8_t id[UMB_ID_BYTES])
{
    return index < ids.count && memcmp(ids.list[index]->item.id, id, UMB_ID_BYTES) == 0;
}

/* Index of the first entry with an id: several files may hold the same asset. */
static size_t first_of_id(struct id_list ids, const uint8_t id[UMB_ID_BYTES])
{
    size_t low = 0;
    size_t high = ids.count;
    while (low < high) {
        size_t middle = low + (high - low) / 2;
        if (memcmp(id, ids.list[middle]->item.id, UMB_ID_BYTES) <= 0) {
            high = middle;
        } else {
            low = middle + 1;
        }
    }
    return low;
}

static struct umbs_entry *find_id(struct id_list ids, const uint8_t id[UMB_ID_BYTES])
{
    const size_t first = first_of_id(ids, id);
    return has_id(ids, first, id) ? ids.list[first] : NULL;
}

struct umbs_entry *umbs__table_find_id(const struct umbs_table *table,
                                       const uint8_t id[UMB_ID_BYTES])
{
    return find_id(healthy_of(table), id);
}

/* Finds a damaged file whose head carries that id, so that a call by id gets the same answer as a
 * call by name. Of several, the first by name is taken. */
static struct umbs_entry *find_damaged(const struct umbs_table *table,
                                       const uint8_t id[UMB_ID_BYTES])
{
    return find_id((struct id_list){table->damaged, table->damaged_count}, id);
}

enum umb_status umbs_store_not_found(const char *name_or_id, struct umb_error *error)
{
    char quoted[UMBS_LOG_QUOTE_SIZE];
    return umb_fail(error, UMB_E_NOT_FOUND, "asset: no asset named %.200s in this store",
                    umbs_log_quote(name_or_id, quoted));
}

enum umb_status umbs__table_acquire(const struct umbs_table *table, const char *name_or_id,
                                    struct umbs_entry **out, struct umb_error *error)
{
    uint8_t id[UMB_ID_BYTES];
    int is_id = umb_id_from_text(name_or_id, id) == UMB_OK;
    *out = NULL;
    struct umbs_entry *entry = is_id ? umbs__table_find_id(table, id) : NULL;
    if (entry == NULL && is_id) {
        entry = find_damaged(table, id);
    }
    if (entry == NULL) {
        entry = umbs__table_find_name(table, name_or_id);
    }
    if (entry == NULL) {
        return umbs_store_not_found(name_or_id, error);
    }
    if (entry->asset == NULL || atomic_load(&entry->faulted)) {
        const enum umb_status cause = entry->error.status;
        /* A fault of the file gives the status of damage; another failure (no memory) gives its
         * own. */
        return umb_fail(error, umbs__is_the_files_fault(cause) ? UMB_E_CORRUPT : cause,
                        "asset: '%.64s' %s: %s", entry->item.name,
                        umbs__is_damage(cause) ? "is damaged" : "cannot be read",
                        entry->error.message);
    }
    umbs_entry_retain(entry);
    *out = entry;
    return UMB_OK;
}

int umbs__table_has(const struct umbs_table *table, const uint8_t id[UMB_ID_BYTES], size_t folders)
{
    const struct id_list ids = healthy_of(table);
    for (size_t i = first_of_id(ids, id); has_id(ids, i, id); i++) {
        if (ids.list[i]->folder < folders) {
            return 1;
        }
    }
    return 0;
}

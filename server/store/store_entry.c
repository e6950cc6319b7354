/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Entries of the store: references, reads, damage, packed files; and the end of entries, tables and
 * store.
 *
 * Invariants: a table holds one reference to each of its entries. An entry without references is in
 * no table; it is in the free list, or is being freed by the thread that emptied the list. The
 * store itself lives until it is closed and its last entry is gone. If a thread pushes onto a free
 * list while the store may be closed, it holds the store during the push, because another thread
 * may free the pushed entry at once.
 */
#include "store/store_internal.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/compat.h"
#include "base/try.h"
#include "common/file_system.h"
#include "format/layout.h"

int umbs__is_damage(enum umb_status status)
{
    return status == UMB_E_FORMAT || status == UMB_E_TRUNCATED || status == UMB_E_CORRUPT;
}

int umbs__is_the_files_fault(enum umb_status status)
{
    return umbs__is_damage(status) || status == UMB_E_VERSION || status == UMB_E_UNSUPPORTED ||
           status == UMB_E_TOO_LARGE;
}

void umbs__packed_path(const struct umbs_store *store, const struct umbs_name *name,
                       char path[UMBS_PATH_SIZE])
{
    char file[UMBS_STORE_NAME_MAX + 8];
    (void)snprintf(file, sizeof file, "%s.umb", name->text);
    umbs__path(path, store->folders[name->folder].path, file);
}

struct umbs_entry *umbs__entry_create(struct umbs_store *store, const struct umbs_name *name)
{
    struct umbs_entry *entry = calloc(1, sizeof *entry);
    if (entry != NULL) {
        snprintf(entry->item.name, sizeof entry->item.name, "%s", name->text);
        entry->store = store;
        entry->serial = atomic_fetch_add(&store->entries, 1) + 1;
        entry->folder = name->folder;
        atomic_init(&entry->references, 1);
        atomic_fetch_add(&store->holders, 1);
    }
    return entry;
}

void umbs__store_let_go(struct umbs_store *store, size_t count)
{
    if (atomic_fetch_sub(&store->holders, count) > count) {
        return;
    }
    pthread_mutex_destroy(&store->mutex);
    pthread_mutex_destroy(&store->scan);
    for (size_t i = 0; i < store->folder_count; i++) {
        free(store->folders[i].path);
    }
    free(store);
}

/* Leaves an entry without references to umbs_store_reap. */
static void entry_retire(struct umbs_entry *entry)
{
    struct umbs_store *store = entry->store;
    entry->next_retired = atomic_load(&store->free_list);
    while (!atomic_compare_exchange_weak(&store->free_list, &entry->next_retired, entry)) {
    }
}

void umbs__table_free(struct umbs_table *table)
{
    for (size_t i = 0; i < table->all.count; i++) {
        if (atomic_fetch_sub(&table->all.list[i]->references, 1) == 1) {
            entry_retire(table->all.list[i]);
        }
    }
    free(table->all.list);
    free(table->by_id.list);
    free(table->damaged.list);
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
        umbs__table_free(table);
        table = next;
    }
    umbs__store_let_go(store, free_entries(atomic_exchange(&store->free_list, NULL)));
}

void umbs__reap_soon(struct umbs_store *store)
{
    if (store->options.retired != NULL && !atomic_load(&store->closed)) {
        store->options.retired(store->options.owner);
    } else {
        umbs_store_reap(store);
    }
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
    entry_retire(entry);
    umbs__reap_soon(store);
    umbs__store_let_go(store, 1);
}

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
        faulted = atomic_load(&store->closed) ? NULL : store->options.faulted;
        owner = store->options.owner;
    }
    pthread_mutex_unlock(&store->mutex);
    if (first) {
        char quoted[UMBS_LOG_QUOTE_SIZE];
        umbs_log_event(store->options.log, UMB_LOG_ERROR, "asset_quarantined", "asset=%s reason=%s",
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
    UMB__TRY(umbs_entry_read_optimistic(entry, read, user, error));
    return umbs_entry_revalidate(entry, error);
}

const struct umb_asset *umbs_entry_asset(const struct umbs_entry *entry)
{
    return entry->asset;
}

uint64_t umbs_entry_serial(const struct umbs_entry *entry)
{
    return entry->serial;
}

const struct umbs_store_item *umbs_entry_item(const struct umbs_entry *entry)
{
    return &entry->item;
}

int umbs_entry_is_replaced(const struct umbs_entry *entry)
{
    return atomic_load(&entry->replaced);
}

/* Returns 1 if the head of an open file carries the entry's id. Another file with the same asset
 * serves as well, because the receiver verifies its pages. */
static int is_of(const struct umbs_entry *entry, int fd, uint64_t *size)
{
    uint8_t head[UMB__HEAD_SIZE];
    struct stat stat_buffer;
    if (fstat(fd, &stat_buffer) != 0 || !S_ISREG(stat_buffer.st_mode) ||
        pread(fd, head, sizeof head, 0) != (ssize_t)sizeof head) {
        return 0;
    }
    *size = (uint64_t)stat_buffer.st_size;
    return memcmp(head, UMB__MAGIC_PACKED, 8) == 0 &&
           memcmp(head + UMB__HEAD_ID, entry->item.id, UMB_ID_BYTES) == 0;
}

enum umb_status umbs_entry_open_packed(const struct umbs_entry *entry, int *fd, uint64_t *size,
                                       struct umb_error *error)
{
    char path[UMBS_PATH_SIZE];
    struct umbs_name name = {.folder = entry->folder};
    (void)snprintf(name.text, sizeof name.text, "%s", entry->item.name);
    umbs__packed_path(entry->store, &name, path);
    *size = 0;
    *fd = open(path, O_RDONLY | O_NONBLOCK | O_CLOEXEC);
    if (*fd < 0 && errno != ENOENT) {
        return umb_fail_errno(error, UMB_E_IO, errno, "cannot open '%.64s.umb'", entry->item.name);
    }
    if (*fd >= 0 && is_of(entry, *fd, size)) {
        return UMB_OK;
    }
    umbs_hang_up(fd);
    return umb_fail(error, UMB_E_STATE, "asset: the packed file of this version of '%.64s' is gone",
                    entry->item.name);
}

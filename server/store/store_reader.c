/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Readers: how a thread finds assets without ever waiting for another one.
 *
 * A reader looks into a table of its own, which it holds. A scan that publishes a table puts it
 * into the mail of each reader, with a hold for that reader. The reader takes the mail with one
 * exchange before it looks, so it sees what was published before the look-up began. A newer table
 * replaces one that was not fetched. The thread that exchanges a table out of the mail owns its
 * hold; so each hold is given back once, by the reader or by the scan.
 *
 * Waiting and freeing happen elsewhere. The mutex guards the list of readers; a reader takes it
 * when it is opened and closed and never in between. A table that loses its last reader is left to
 * the reaper.
 */
#include <stdlib.h>

#include "store/store_internal.h"

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
    /* Mostly there is none: a relaxed load leaves the cache line shared with its other readers. */
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
    return umbs__table_acquire(reader->table, name_or_id, out, error);
}

int umbs_reader_has(struct umbs_reader *reader, const uint8_t id[UMB_ID_BYTES], size_t folders)
{
    umbs_reader_refresh(reader);
    return umbs__table_has(reader->table, id, folders);
}

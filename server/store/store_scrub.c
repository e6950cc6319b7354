/* SPDX-License-Identifier: Apache-2.0 */
/* Scrubbing: checks mapped files again, one by one, that were good when they were opened. */
#include <string.h>

#include "store/store_internal.h"

#include "tool/clock.h"

/* Retains the asset whose mapped file was checked longest ago, if it is due. */
static struct umbs_entry *take_due(struct umbs_store *store, uint64_t interval_ms)
{
    uint64_t now_ms = (uint64_t)umbu_clock_ms();
    struct umbs_entry *due = NULL;
    struct umbs_table *table = umbs__table_hold(store);
    for (size_t i = 0; i < table->count; i++) {
        struct umbs_entry *entry = table->by_name[i];
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

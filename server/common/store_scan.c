/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Scanning the store's folder and swapping the table.
 *
 * A scan builds a whole new table beside the old one (unchanged entries are shared by reference)
 * and swaps it in under the mutex, so a look-up sees the folder before or after, never in between.
 */
#include "common/store_internal.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "base/open_status.h"

struct name_list {
    size_t count, capacity;
    char (*names)[UMBS_STORE_NAME_MAX + 1];
};

static int compare_names(const void *a, const void *b)
{
    return strcmp(a, b);
}

static int compare_ids(const void *a, const void *b)
{
    const struct umbs_entry *const *left = a;
    const struct umbs_entry *const *right = b;
    return memcmp((*left)->item.id, (*right)->item.id, UMB_ID_BYTES);
}

/* Copies the stem of NAME.umb. Returns 1, 0 (not an asset's name) or -1 (an asset's, but refused).
 */
static int stem_of(const char *file, char stem[UMBS_STORE_NAME_MAX + 1])
{
    static const char allowed[] =
        "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789._-";
    size_t length = strlen(file);
    if (length < 5 || file[0] == '.' || strcmp(file + length - 4, ".umb") != 0) {
        return 0;
    }
    length -= 4;
    if (length > UMBS_STORE_NAME_MAX || strspn(file, allowed) < length) {
        return -1;
    }
    memcpy(stem, file, length);
    stem[length] = '\0';
    return 1;
}

static enum umb_status add_name(struct name_list *list, const char *stem, struct umb_error *error)
{
    if (list->count == list->capacity) {
        size_t capacity = list->capacity == 0 ? 16 : list->capacity * 2;
        if (capacity > SIZE_MAX / sizeof *list->names) {
            return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for %zu names", capacity);
        }
        void *names = realloc(list->names, capacity * sizeof *list->names);
        if (names == NULL) {
            return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for %zu names", capacity);
        }
        list->names = names;
        list->capacity = capacity;
    }
    memcpy(list->names[list->count++], stem, strlen(stem) + 1);
    return UMB_OK;
}

/* Collects the asset names of the folder, sorted. */
static enum umb_status read_names(struct umbs_store *store, struct name_list *list,
                                  struct umbs_store_report *report, struct umb_error *error)
{
    enum umb_status status = UMB_OK;
    char stem[UMBS_STORE_NAME_MAX + 1];
    char last_skipped[UMBS_LOG_QUOTE_SIZE] = "";
    DIR *folder = opendir(store->folder);
    if (folder == NULL) {
        int code = errno;
        return umb_fail_errno(error, umb__open_status(code), code,
                              "cannot open the store folder '%.200s'", store->folder);
    }
    while (status == UMB_OK) {
        errno = 0;
        struct dirent *item = readdir(folder);
        if (item == NULL) {
            if (errno != 0) {
                status = umb_fail_errno(error, UMB_E_IO, errno, "cannot read the folder '%.200s'",
                                        store->folder);
            }
            break;
        }
        int kind = stem_of(item->d_name, stem);
        if (kind > 0) {
            status = add_name(list, stem, error);
        } else if (kind < 0) {
            report->skipped++;
            umbs_log_quote(item->d_name, last_skipped);
        }
    }
    closedir(folder);
    if (report->skipped != store->skipped_before && report->skipped > 0) {
        umbs_log_event(store->log, UMB_LOG_WARN, "names_skipped",
                       "count=%zu last=%s allowed=[A-Za-z0-9._-]", report->skipped, last_skipped);
    }
    store->skipped_before = report->skipped;
    if (status == UMB_OK && list->count > 0) {
        qsort(list->names, list->count, sizeof *list->names, compare_names);
    }
    return status;
}

static int is_fresh(const struct stat *file)
{
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    int64_t age_ms = ((int64_t)now.tv_sec - file->st_mtim.tv_sec) * 1000 +
                     (now.tv_nsec - file->st_mtim.tv_nsec) / 1000000;
    return age_ms >= 0 && age_ms < UMBS_STORE_SETTLE_MS;
}

static int is_faulted(struct umbs_store *store, const struct umbs_entry *entry)
{
    pthread_mutex_lock(&store->mutex);
    int faulted = entry->faulted;
    pthread_mutex_unlock(&store->mutex);
    return faulted;
}

/*
 * Decides what stands for one file in the new table: the old entry, a new one, or none (NULL and
 * UMB_OK: the file vanished). The result holds a reference for the table.
 */
static enum umb_status place(struct umbs_store *store, const char *name,
                             struct umbs_store_report *report, struct umbs_entry **out,
                             struct umb_error *error)
{
    char file[UMBS_STORE_NAME_MAX + 8];
    struct stat now;
    *out = NULL;
    snprintf(file, sizeof file, "%s.umb", name);
    char *path = umbs__path_join(store->folder, file);
    if (path == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a path");
    }
    int missing = stat(path, &now) != 0;
    free(path);
    if (missing || !S_ISREG(now.st_mode)) {
        return UMB_OK;
    }
    /* Only scans change the table, and the scan mutex is held: reading it needs no other lock. */
    struct umbs_entry *old = umbs__table_find_name(&store->table, name);
    struct umbs_stamp stamp = umbs_stamp_of(&now);
    int faulted = old != NULL && is_faulted(store, old);
    if (old != NULL && !old->retry && !faulted && umbs_stamp_equal(&old->stamp, &stamp)) {
        umbs__entry_retain(old);
        report->unchanged++;
        *out = old;
        return UMB_OK;
    }
    struct umbs_entry *fresh = umbs__entry_load(store, name, faulted);
    if (fresh == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for asset '%.64s'", name);
    }
    if (fresh->asset != NULL) {
        report->loaded++;
    } else {
        report->failed++;
        if (is_fresh(&now)) {
            report->unsettled = 1;
            fresh->retry = 1;
        }
        if (fresh->retry && old != NULL && old->asset != NULL && !faulted) {
            /* Perhaps half copied, or no fault of the file's (no memory, no descriptor left): the
             * old version goes on answering until one can tell. */
            umbs__entry_retain(old);
            umbs_entry_release(fresh);
            fresh = old;
        }
    }
    *out = fresh;
    return UMB_OK;
}

static void table_release(struct umbs_table *table)
{
    for (size_t i = 0; i < table->count; i++) {
        umbs_entry_release(table->by_name[i]);
    }
    free(table->by_name);
    free(table->by_id);
    memset(table, 0, sizeof *table);
}

static enum umb_status build_table(struct umbs_store *store, const struct name_list *list,
                                   struct umbs_table *table, struct umbs_store_report *report,
                                   struct umb_error *error)
{
    memset(table, 0, sizeof *table);
    table->by_name = calloc(list->count + 1, sizeof(struct umbs_entry *));
    table->by_id = calloc(list->count + 1, sizeof(struct umbs_entry *));
    if (table->by_name == NULL || table->by_id == NULL) {
        table_release(table);
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a table of %zu assets",
                        list->count);
    }
    for (size_t i = 0; i < list->count; i++) {
        struct umbs_entry *entry = NULL;
        enum umb_status status = place(store, list->names[i], report, &entry, error);
        if (status != UMB_OK) {
            table_release(table);
            return status;
        }
        if (entry != NULL) {
            table->by_name[table->count++] = entry;
            if (entry->asset != NULL) {
                table->by_id[table->healthy++] = entry;
            }
        }
    }
    if (table->healthy > 0) {
        qsort(table->by_id, table->healthy, sizeof(struct umbs_entry *), compare_ids);
    }
    return UMB_OK;
}

enum umb_status umbs_store_rescan(struct umbs_store *store, struct umbs_store_report *report,
                                  struct umb_error *error)
{
    struct umbs_store_report own;
    struct name_list list = {0};
    struct umbs_table table = {0};
    report = report != NULL ? report : &own;
    memset(report, 0, sizeof *report);
    pthread_mutex_lock(&store->scan);
    enum umb_status status = read_names(store, &list, report, error);
    if (status == UMB_OK) {
        status = build_table(store, &list, &table, report, error);
    }
    free(list.names);
    if (status == UMB_OK) {
        pthread_mutex_lock(&store->mutex);
        struct umbs_table old = store->table;
        store->table = table;
        pthread_mutex_unlock(&store->mutex);
        for (size_t i = 0; i < old.count; i++) {
            if (umbs__table_find_name(&table, old.by_name[i]->item.name) == NULL) {
                report->removed++;
                umbs_log_event(store->log, UMB_LOG_INFO, "asset_removed", "asset=%s",
                               old.by_name[i]->item.name);
            }
        }
        table_release(&old);
        report->swept = umbs__store_sweep(store, &table);
    }
    pthread_mutex_unlock(&store->scan);
    umbs_store_reap(store);
    return status;
}

/* 1 if a cache file's id is still asked for, or the name is none of the cache's. */
static int cache_file_wanted(const char *name, const struct umbs_table *table)
{
    char text[UMB_ID_TEXT_SIZE];
    uint8_t id[UMB_ID_BYTES];
    if (strlen(name) != UMB_ID_TEXT_SIZE - 1 + 5 ||
        strcmp(name + UMB_ID_TEXT_SIZE - 1, ".umbm") != 0) {
        return 1;
    }
    memcpy(text, name, UMB_ID_TEXT_SIZE - 1);
    text[UMB_ID_TEXT_SIZE - 1] = '\0';
    return !umb_id_from_text(text, id) || umbs__table_find_id(table, id) != NULL;
}

static size_t sweep_folder(struct umbs_store *store, const char *path,
                           const struct umbs_table *cache_of)
{
    size_t swept = 0;
    struct stat status;
    time_t now = time(NULL);
    DIR *folder = opendir(path);
    if (folder == NULL) {
        return 0;
    }
    struct dirent *item;
    while ((item = readdir(folder)) != NULL) {
        int stray = strncmp(item->d_name, ".tmp.", 5) == 0 ||
                    (cache_of != NULL && !cache_file_wanted(item->d_name, cache_of));
        if (stray && fstatat(dirfd(folder), item->d_name, &status, AT_SYMLINK_NOFOLLOW) == 0 &&
            S_ISREG(status.st_mode) && now - status.st_mtime > UMBS_STORE_TEMPORARY_AGE_S &&
            unlinkat(dirfd(folder), item->d_name, 0) == 0) {
            char quoted[UMBS_LOG_QUOTE_SIZE];
            umbs_log_event(store->log, UMB_LOG_INFO, "file_swept", "file=%s",
                           umbs_log_quote(item->d_name, quoted));
            swept++;
        }
    }
    closedir(folder);
    return swept;
}

size_t umbs__store_sweep(struct umbs_store *store, const struct umbs_table *table)
{
    return sweep_folder(store, store->folder, NULL) + sweep_folder(store, store->cache, table);
}

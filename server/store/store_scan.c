/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Scanning the store's folders and replacing the table.
 *
 * The names of a store are NAME.umb in its folders, and FOLDER/NAME.umb one folder down. Symbolic
 * links count as names too, because opening follows them; a link to a folder counts as a folder.
 * Only one level below the top is read, so links cannot make the walk endless.
 *
 * A scan builds a whole new table beside the old one (unchanged entries are shared by reference)
 * and publishes it whole. So a look-up sees the folders before or after the scan, never in between.
 *
 * A scan publishes several times: first the files that need no reading (unchanged, or mapped in the
 * cache), then files that must be read whole, after each LOAD_MS of loading. So a large new asset
 * delays only the requests for it, and a thousand small ones do not take a thousand passes over all
 * names.
 */
#include "store/store_internal.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "base/memory.h"
#include "base/open_status.h"
#include "base/try.h"
#include "common/file_system.h"
#include "tool/clock.h"

#define LOAD_MS 100 /* Milliseconds of loading before a table with the loaded files is published */

struct name_list {
    size_t count, capacity;
    struct umbs_name *names;
};

static const char allowed[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789._-";

/* State of the reading of one folder. */
struct reading {
    struct name_list *list;
    size_t folder;
    size_t skipped;
    char last_skipped[UMBS_LOG_QUOTE_SIZE];
};

static int compare_names(const void *a, const void *b)
{
    const struct umbs_name *left = a;
    const struct umbs_name *right = b;
    int order = strcmp(left->text, right->text);
    return order != 0 ? order : (left->folder > right->folder) - (left->folder < right->folder);
}

/* Makes the asset's name from PREFIX/NAME.umb. Returns 1, 0 (not an asset's file) or -1 (an asset's
 * file whose name is not allowed). */
static int name_of(const char *prefix, const char *file, char name[UMBS_STORE_NAME_MAX + 1])
{
    size_t length = strlen(file);
    size_t before = prefix != NULL ? strlen(prefix) + 1 : 0;
    if (length < 5 || file[0] == '.' || strcmp(file + length - 4, ".umb") != 0) {
        return 0;
    }
    length -= 4;
    if (before + length > UMBS_STORE_NAME_MAX || strspn(file, allowed) < length) {
        return -1;
    }
    if (prefix != NULL) {
        memcpy(name, prefix, before - 1);
        name[before - 1] = '/';
    }
    memcpy(name + before, file, length);
    name[before + length] = '\0';
    return 1;
}

static enum umb_status add_name(struct reading *reading, const char *text, struct umb_error *error)
{
    struct name_list *list = reading->list;
    if (!umb__grow(NULL, &list->names, &list->capacity, list->count + 1, sizeof *list->names)) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for %zu names", list->count + 1);
    }
    struct umbs_name *name = &list->names[list->count++];
    name->folder = reading->folder;
    memcpy(name->text, text, strlen(text) + 1);
    return UMB_OK;
}

static enum umb_status read_file_name(struct reading *reading, const char *prefix, const char *file,
                                      struct umb_error *error)
{
    char name[UMBS_STORE_NAME_MAX + 1];
    int kind = name_of(prefix, file, name);
    if (kind < 0) {
        reading->skipped++;
        umbs_log_quote(file, reading->last_skipped);
    }
    return kind > 0 ? add_name(reading, name, error) : UMB_OK;
}

/* Reads an open folder and closes it. prefix: name of the subfolder; NULL at the top, where
 * subfolders are entered too. */
static enum umb_status read_folder(struct reading *reading, DIR *folder, const char *prefix,
                                   struct umb_error *error)
{
    enum umb_status status = UMB_OK;
    while (status == UMB_OK) {
        errno = 0;
        const struct dirent *item = readdir(folder);
        if (item == NULL && errno != 0) {
            status = umb_fail_errno(error, UMB_E_IO, errno, "cannot read a store folder");
        }
        if (item == NULL) {
            break;
        }
        const char *name = item->d_name;
        int below = -1;
        if (prefix == NULL && strspn(name, allowed) == strlen(name) && name[0] != '.') {
            below = openat(dirfd(folder), name, O_RDONLY | O_DIRECTORY | O_NONBLOCK | O_CLOEXEC);
        }
        DIR *inner = below >= 0 ? fdopendir(below) : NULL;
        if (inner != NULL) {
            status = read_folder(reading, inner, name, error);
        } else {
            umbs_hang_up(&below);
            status = read_file_name(reading, prefix, name, error);
        }
    }
    (void)closedir(folder);
    return status;
}

/* Logs how many names are not served, each time that number changes. */
static void tell(const struct umbs_store *store, size_t now, size_t *before, const char *event,
                 const char *last)
{
    if (now != *before && now > 0) {
        umbs_log_event(store->options.log, UMB_LOG_WARN, event,
                       "count=%zu last=%s allowed=[A-Za-z0-9._-]", now, last);
    }
    *before = now;
}

/* Keeps the first of equal names; returns how many were dropped. */
static size_t drop_doubles(struct name_list *list)
{
    size_t kept = 0;
    for (size_t i = 0; i < list->count; i++) {
        if (kept == 0 || strcmp(list->names[kept - 1].text, list->names[i].text) != 0) {
            list->names[kept++] = list->names[i];
        }
    }
    size_t dropped = list->count - kept;
    list->count = kept;
    return dropped;
}

/* Collects the names of all folders, sorted, each once. The caller frees the list, on failure too.
 * Fails: E_NO_INPUT, E_IO, E_NO_MEMORY. */
static enum umb_status read_names(struct umbs_store *store, struct name_list *list,
                                  struct umbs_store_report *report, struct umb_error *error)
{
    enum umb_status status = UMB_OK;
    for (size_t i = 0; status == UMB_OK && i < store->folder_count; i++) {
        struct umbs_folder *folder = &store->folders[i];
        struct reading reading = {.list = list, .folder = i};
        DIR *opened = opendir(folder->path);
        if (opened == NULL) {
            return umb_fail_errno(error, umb__open_status(errno), errno,
                                  "cannot open the store folder '%.200s'", folder->path);
        }
        status = read_folder(&reading, opened, NULL, error);
        tell(store, reading.skipped, &folder->skipped_before, "names_skipped",
             reading.last_skipped);
        report->skipped += reading.skipped;
    }
    if (status == UMB_OK && list->count > 0) {
        qsort(list->names, list->count, sizeof *list->names, compare_names);
        report->shadowed = drop_doubles(list);
    }
    return status;
}

/* One pass over the names. */
struct pass {
    struct umbs_store *store;
    struct umbs_store_report *report;
    int may_load;     /* 1 if another file may be read whole in this pass */
    uint64_t load_ms; /* Milliseconds spent on files read whole */
    int pending;      /* 1 if more files wait to be read whole */
    int waits;        /* 1 if a file waits for the lane */
};

static int compare_ids(const void *a, const void *b)
{
    const struct umbs_entry *const *left = a;
    const struct umbs_entry *const *right = b;
    const int order = memcmp((*left)->item.id, (*right)->item.id, UMB_ID_BYTES);
    return order != 0 ? order : strcmp((*left)->item.name, (*right)->item.name);
}

static void add_entry(struct umbs_entry_list *entries, struct umbs_entry *entry)
{
    entries->list[entries->count++] = entry;
}

static void sort_by_id(struct umbs_entry_list *entries)
{
    if (entries->count > 0) {
        qsort(entries->list, entries->count, sizeof(struct umbs_entry *), compare_ids);
    }
}

static int is_fresh(const struct stat *file)
{
    const int64_t modified_ms =
        (int64_t)file->st_mtim.tv_sec * 1000 + file->st_mtim.tv_nsec / 1000000;
    const int64_t age_ms = umbu_unix_ms() - modified_ms;
    return age_ms >= 0 && age_ms < UMBS_STORE_SETTLE_MS;
}

/* Record of a mapped entry; returns 0 if the entry is not mapped. */
static int record_of(const struct umbs_entry *entry, struct umbs_record *record)
{
    if (entry->map == NULL || umbs_asset_map_digest(entry->map) == NULL) {
        return 0;
    }
    record->packed = entry->stamp;
    record->mapped = *umbs_asset_map_stamp(entry->map);
    memcpy(record->id, entry->item.id, UMB_ID_BYTES);
    memcpy(record->digest, umbs_asset_map_digest(entry->map), UMB_ID_BYTES);
    return 1;
}

/* Adds the record of a verified entry to its cache, so that another name of the same file opens
 * without being read. */
static void remember(struct umbs_store *store, const struct umbs_entry *entry)
{
    struct umbs_record record;
    if (record_of(entry, &record)) {
        umbs__cache_remember(store->folders[entry->folder].cache, &record);
    }
}

/* Returns the entry for the new table: `fresh`, or `old` if fresh failed and a later scan may
 * succeed. */
static struct umbs_entry *choose(struct pass *pass, struct umbs_entry *old, int old_faulted,
                                 struct umbs_entry *fresh, const struct stat *file)
{
    fresh->tried = pass->store->serial;
    if (fresh->asset != NULL) {
        pass->report->loaded++;
        remember(pass->store, fresh);
        return fresh;
    }
    pass->report->failed++;
    pass->report->failed_machine += fresh->retry ? 1 : 0;
    if (is_fresh(file)) {
        pass->report->unsettled = 1;
        fresh->retry = 1;
    }
    if (fresh->retry && old != NULL && old->asset != NULL && !old_faulted) {
        /* Keep the old version until a later scan can decide: the file may be half copied, or the
         * machine is at fault (no memory, no descriptor left). */
        umbs_entry_retain(old);
        umbs_entry_release(fresh);
        old->tried = pass->store->serial;
        return old;
    }
    return fresh;
}

/* Chooses the entry of one file for the new table: the old one, a new one, or NULL with UMB_OK if
 * the file has vanished or waits for its turn. The caller gets a reference to the entry, for the
 * table. */
static enum umb_status place(struct pass *pass, const struct umbs_name *name,
                             struct umbs_entry **out, struct umb_error *error)
{
    struct umbs_store *store = pass->store;
    struct stat now;
    char path[UMBS_PATH_SIZE];
    *out = NULL;
    umbs__packed_path(store, name, path);
    if (stat(path, &now) != 0 || !S_ISREG(now.st_mode)) {
        return UMB_OK;
    }
    /* Only scans change the table, and this scan holds the scan mutex, so reading the table needs
     * no other lock. */
    struct umbs_entry *old = umbs__table_find_name(store->table, name->text);
    struct umbs_stamp stamp = umbs_stamp_of(&now);
    int faulted = old != NULL && atomic_load(&old->faulted);
    int tried = old != NULL && old->tried == store->serial;
    if (old != NULL && (tried || (!old->retry && !faulted && old->folder == name->folder &&
                                  umbs_stamp_equal(&old->stamp, &stamp)))) {
        umbs_entry_retain(old);
        pass->report->unchanged += !tried;
        *out = old;
        return UMB_OK;
    }
    uint64_t from_ms = (uint64_t)umbu_clock_ms();
    uint64_t lane_ms = 0;
    struct umbs_entry *fresh = faulted ? NULL : umbs__entry_recall(store, name, &stamp);
    enum umbs_lane_answer lane =
        fresh != NULL ? UMBS_LANE_NOT_FOR_IT
                      : umbs__lane_ask(store, name, &stamp, faulted, &fresh, &lane_ms);
    if (lane == UMBS_LANE_WAIT ||
        (lane == UMBS_LANE_NOT_FOR_IT && fresh == NULL && !pass->may_load)) {
        pass->waits |= lane == UMBS_LANE_WAIT;
        pass->pending |= lane != UMBS_LANE_WAIT;
        if (old != NULL) {
            umbs_entry_retain(old);
        }
        *out = old;
        return UMB_OK;
    }
    if (fresh == NULL && lane == UMBS_LANE_NOT_FOR_IT) {
        fresh = umbs__entry_load(store, name, faulted);
        pass->load_ms += (uint64_t)umbu_clock_ms() - from_ms;
        pass->may_load = pass->load_ms < LOAD_MS;
    }
    if (fresh == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for asset '%.64s'", name->text);
    }
    pass->report->load_ms += (uint64_t)umbu_clock_ms() - from_ms + lane_ms;
    *out = choose(pass, old, faulted, fresh, &now);
    return UMB_OK;
}

static enum umb_status build_table(struct pass *pass, const struct name_list *list,
                                   struct umbs_table **out, struct umb_error *error)
{
    enum umb_status status = UMB_OK;
    struct umbs_table *table = umbs__table_create(list->count);
    if (table == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a table of %zu assets",
                        list->count);
    }
    for (size_t i = 0; status == UMB_OK && i < list->count; i++) {
        struct umbs_entry *entry = NULL;
        status = place(pass, &list->names[i], &entry, error);
        if (entry != NULL) {
            add_entry(&table->all, entry);
            if (entry->asset != NULL) {
                add_entry(&table->by_id, entry);
            } else if (entry->has_id) {
                add_entry(&table->damaged, entry);
            }
        }
    }
    if (status != UMB_OK) {
        (void)umbs__table_let_go(pass->store, table); /* reaped at the scan's end */
        return status;
    }
    sort_by_id(&table->by_id);
    sort_by_id(&table->damaged);
    *out = table;
    return UMB_OK;
}

/* Puts a new table in place of the old one. */
static void publish(struct pass *pass, struct umbs_table *table)
{
    struct umbs_store *store = pass->store;
    struct umbs_table *old = umbs__table_publish(store, table);
    for (size_t i = 0; i < old->all.count; i++) {
        if (umbs__table_find_name(table, old->all.list[i]->item.name) == NULL) {
            pass->report->removed++;
            umbs_log_event(store->options.log, UMB_LOG_INFO, "asset_removed", "asset=%s",
                           old->all.list[i]->item.name);
        }
    }
    (void)umbs__table_let_go(store, old);
    umbs_store_reap(store);
}

/* Writes the records of the cache if they changed. */
static void write_records(struct umbs_store *store, struct umbs_cache *cache)
{
    struct umbs_records now = {0};
    const struct umbs_table *table = store->table; /* only scans change it */
    for (size_t i = 0; i < table->all.count; i++) {
        const struct umbs_entry *entry = table->all.list[i];
        struct umbs_record record;
        if (store->folders[entry->folder].cache == cache && !atomic_load(&entry->faulted) &&
            record_of(entry, &record) && umbs__records_add(&now, &record) != UMB_OK) {
            break;
        }
    }
    umbs__cache_keep(cache, &now);
}

/* Publishes tables until every file is in one. The first table has the unchanged files, and
 * those that the cache has in mapped form. */
static enum umb_status scan(struct pass *pass, struct name_list *list, struct umb_error *error)
{
    struct umbs_store *store = pass->store;
    UMB__TRY(read_names(store, list, pass->report, error));
    do {
        struct umbs_table *table = NULL;
        const int was_done = umbs__lane_has_done(store);
        pass->report->unchanged = 0;
        pass->pending = 0;
        pass->waits = 0;
        UMB__TRY(build_table(pass, list, &table, error));
        publish(pass, table);
        pass->may_load = 1; /* each further pass takes at least one more file: the loop ends */
        pass->load_ms = 0;
        pass->pending |= umbs__lane_clear(store, was_done) && pass->waits;
    } while (pass->pending);
    for (size_t i = 0; i < store->cache_count; i++) {
        write_records(store, &store->caches[i]);
    }
    pass->report->swept = umbs__store_sweep(store, store->table);
    return UMB_OK;
}

enum umb_status umbs_store_rescan(struct umbs_store *store, struct umbs_store_report *report,
                                  struct umb_error *error)
{
    struct umbs_store_report own;
    struct name_list list = {0};
    struct pass pass = {.store = store, .report = report != NULL ? report : &own};
    memset(pass.report, 0, sizeof *pass.report);
    pthread_mutex_lock(&store->scan);
    store->serial++;
    const enum umb_status status = scan(&pass, &list, error);
    pthread_mutex_unlock(&store->scan);
    free(list.names);
    umbs_store_reap(store);
    return status;
}

/* Returns 1 if a cache file must stay: the table has its id, or its name is not a cache file's. */
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
    return umb_id_from_text(text, id) != UMB_OK || umbs__table_find_id(table, id) != NULL;
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
            umbs_log_event(store->options.log, UMB_LOG_INFO, "file_swept", "file=%s",
                           umbs_log_quote(item->d_name, quoted));
            swept++;
        }
    }
    closedir(folder);
    return swept;
}

size_t umbs__store_sweep(struct umbs_store *store, const struct umbs_table *table)
{
    size_t swept = 0;
    for (size_t i = 0; i < store->folder_count; i++) {
        swept += sweep_folder(store, store->folders[i].path, NULL);
    }
    for (size_t i = 0; i < store->cache_count; i++) {
        char own[UMBS_PATH_SIZE];
        swept +=
            umbs__cache_own_folder(&store->caches[i], own) ? sweep_folder(store, own, table) : 0;
    }
    return swept;
}

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The names of a store: NAME.umb in its folders, and FOLDER/NAME.umb one folder down.
 *
 * Symbolic links count as names too, because opening follows them; a link to a folder counts as a
 * folder. Only one level below the top is read, so links cannot make the walk endless.
 */
#include "store/store_internal.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/open_status.h"

static const char allowed[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789._-";

/* State of the reading of one folder. */
struct reading {
    struct umbs_name_list *list;
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
    struct umbs_name_list *list = reading->list;
    if (list->count == list->capacity) {
        size_t capacity = list->capacity == 0 ? 16 : list->capacity * 2;
        void *names = capacity <= SIZE_MAX / sizeof *list->names
                          ? realloc(list->names, capacity * sizeof *list->names)
                          : NULL;
        if (names == NULL) {
            return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for %zu names", capacity);
        }
        list->names = names;
        list->capacity = capacity;
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
            if (below >= 0) {
                (void)close(below);
            }
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
        umbs_log_event(store->log, UMB_LOG_WARN, event, "count=%zu last=%s allowed=[A-Za-z0-9._-]",
                       now, last);
    }
    *before = now;
}

/* Keeps the first of equal names; returns how many were dropped. */
static size_t drop_doubles(struct umbs_name_list *list)
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

enum umb_status umbs__names_read(struct umbs_store *store, struct umbs_name_list *list,
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

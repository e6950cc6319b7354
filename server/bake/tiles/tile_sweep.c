/* SPDX-License-Identifier: Apache-2.0 */
/* One pass over the folder; only files with names of this program's pattern are ever removed. */
#include "bake/tiles/tile_sweep.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "bake/tiles/tile_key.h"

#define NAME_LENGTH (UMBB_TILE_KEY_TEXT - 1 + sizeof UMBB_TILE_SUFFIX - 1)

struct entry {
    char name[NAME_LENGTH + 1];
    uint64_t bytes;
    struct timespec used;
};

struct entries {
    struct entry *items;
    size_t count, capacity;
};

/* 1 if the `length` characters of name are KEY.umbt. */
static int is_result(const char *name, size_t length)
{
    return length == NAME_LENGTH && strspn(name, "0123456789abcdef") == UMBB_TILE_KEY_TEXT - 1 &&
           memcmp(name + UMBB_TILE_KEY_TEXT - 1, UMBB_TILE_SUFFIX, sizeof UMBB_TILE_SUFFIX - 1) ==
               0;
}

/* 1 if the name is a result's temporary (tool/output.h). */
static int is_temporary(const char *name)
{
    return strncmp(name, ".tmp.", 5) == 0 && strlen(name) > 5 + NAME_LENGTH &&
           is_result(name + 5, NAME_LENGTH);
}

static enum umb_status remember(struct entries *entries, const char *name, const struct stat *facts,
                                struct umb_error *error)
{
    if (entries->count == entries->capacity) {
        const size_t capacity = entries->capacity == 0 ? 256 : 2 * entries->capacity;
        struct entry *items = realloc(entries->items, capacity * sizeof *items);
        if (items == NULL) {
            return umb_fail(error, UMB_E_NO_MEMORY, "tile cache: memory for %zu names refused",
                            capacity);
        }
        entries->items = items;
        entries->capacity = capacity;
    }
    struct entry *entry = &entries->items[entries->count++];
    memcpy(entry->name, name, NAME_LENGTH + 1);
    entry->bytes = (uint64_t)facts->st_size;
    entry->used = facts->st_mtim;
    return UMB_OK;
}

/* Order of removal: least recently used first; by name for equal times. */
static int by_use(const void *a, const void *b)
{
    const struct entry *one = a, *two = b;
    if (one->used.tv_sec != two->used.tv_sec) {
        return one->used.tv_sec < two->used.tv_sec ? -1 : 1;
    }
    if (one->used.tv_nsec != two->used.tv_nsec) {
        return one->used.tv_nsec < two->used.tv_nsec ? -1 : 1;
    }
    return strcmp(one->name, two->name);
}

static enum umb_status look(DIR *folder, struct entries *entries, uint64_t *bytes,
                            struct umb_error *error)
{
    const time_t now = time(NULL);
    const struct dirent *found;
    enum umb_status status = UMB_OK;
    while (status == UMB_OK && (errno = 0, found = readdir(folder)) != NULL) {
        struct stat facts;
        const char *name = found->d_name;
        const int result = is_result(name, strlen(name));
        if ((!result && !is_temporary(name)) ||
            fstatat(dirfd(folder), name, &facts, AT_SYMLINK_NOFOLLOW) != 0 ||
            !S_ISREG(facts.st_mode)) {
            continue;
        }
        if (result) {
            *bytes += (uint64_t)facts.st_size;
            status = remember(entries, name, &facts, error);
        } else if (now - facts.st_mtime > UMBB_TILE_STALE_S) {
            (void)unlinkat(dirfd(folder), name, 0);
        }
    }
    return status;
}

enum umb_status umbb_tile_sweep(const char *path, uint64_t max_bytes, uint64_t keep_bytes,
                                uint64_t *bytes, struct umb_error *error)
{
    *bytes = 0;
    DIR *folder = opendir(path);
    if (folder == NULL) {
        return umb_fail_errno(error, UMB_E_IO, errno, "cannot read the tile cache '%.200s'", path);
    }
    struct entries entries = {NULL, 0, 0};
    const enum umb_status status = look(folder, &entries, bytes, error);
    if (status == UMB_OK && *bytes > max_bytes) {
        qsort(entries.items, entries.count, sizeof *entries.items, by_use);
        for (size_t i = 0; i<entries.count && * bytes> keep_bytes; i++) {
            if (unlinkat(dirfd(folder), entries.items[i].name, 0) == 0 || errno == ENOENT) {
                *bytes -= entries.items[i].bytes;
            }
        }
    }
    free(entries.items);
    closedir(folder);
    return status;
}

/* SPDX-License-Identifier: Apache-2.0 */
/* See tile_cache.h. First the functions for the whole folder and its size, then those for a single
 * result. */
#define XXH_INLINE_ALL
#include "bake/tiles/tile_cache.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>
#include <xxhash.h>
#include <zstd.h>

#include "base/bytes.h"
#include "base/memory.h"
#include "common/file_system.h"
#include "tool/output.h"

#define MAGIC      "UMBTIL1\n"
#define HEAD_BYTES ((size_t)56)
#define HASHED     ((size_t)48) /* hashed bytes of the head */

/* The fastest level: a result is written once and read a few times. */
#define ZSTD_LEVEL 1

#define SUFFIX ".umbt"

/* Age in seconds from which a temporary counts as abandoned: a write takes only seconds. */
#define STALE_S 60

#define NAME_LENGTH (UMB_ID_TEXT_SIZE - 1 + sizeof SUFFIX - 1)

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
    return length == NAME_LENGTH && strspn(name, "0123456789abcdef") == UMB_ID_TEXT_SIZE - 1 &&
           memcmp(name + UMB_ID_TEXT_SIZE - 1, SUFFIX, sizeof SUFFIX - 1) == 0;
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
    const size_t needed = entries->count + 1;
    if (!umb__grow(NULL, &entries->items, &entries->capacity, needed, sizeof *entries->items)) {
        return umb_fail(error, UMB_E_NO_MEMORY, "tile cache: memory for %zu names refused", needed);
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
        } else if (now - facts.st_mtime > STALE_S) {
            (void)unlinkat(dirfd(folder), name, 0);
        }
    }
    return status;
}

/*
 * Removes old temporaries. If all results together are larger than max_bytes, also removes the
 * least recently used ones until keep_bytes are left. A file that cannot be removed is left. Only
 * files with names of this program's pattern are ever removed.
 *
 * Out:  cache->bytes: size of the results that are left.
 * Cost: one stat of each file in the folder.
 */
static enum umb_status sweep(struct umbb_tile_cache *cache, uint64_t max_bytes, uint64_t keep_bytes,
                             struct umb_error *error)
{
    cache->bytes = 0;
    DIR *folder = opendir(cache->folder);
    if (folder == NULL) {
        return umb_fail_errno(error, UMB_E_IO, errno, "cannot read the tile cache '%.200s'",
                              cache->folder);
    }
    struct entries entries = {NULL, 0, 0};
    const enum umb_status status = look(folder, &entries, &cache->bytes, error);
    if (status == UMB_OK && cache->bytes > max_bytes) {
        qsort(entries.items, entries.count, sizeof *entries.items, by_use);
        for (size_t i = 0; i < entries.count && cache->bytes > keep_bytes; i++) {
            if (unlinkat(dirfd(folder), entries.items[i].name, 0) == 0 || errno == ENOENT) {
                cache->bytes -= entries.items[i].bytes;
            }
        }
    }
    free(entries.items);
    closedir(folder);
    return status;
}

enum umb_status umbb_tile_cache_open(struct umbb_tile_cache *cache, const char *folder,
                                     uint64_t max_bytes, struct umb_error *error)
{
    *cache = (struct umbb_tile_cache){.max_bytes = max_bytes};
    if (mkdir(folder, 0777) != 0 && errno != EEXIST) {
        return umb_fail_errno(error, UMB_E_CANNOT_CREATE, errno, "cannot make the folder '%.200s'",
                              folder);
    }
    cache->folder = strdup(folder);
    if (cache->folder == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for the name '%.200s'", folder);
    }
    return sweep(cache, max_bytes, max_bytes, error);
}

void umbb_tile_cache_close(struct umbb_tile_cache *cache)
{
    free(cache->folder);
    memset(cache, 0, sizeof *cache);
}

/* The path of a result; NULL if out of memory. */
static char *path_of(const struct umbb_tile_cache *cache, const uint8_t key[UMB_ID_BYTES])
{
    char text[UMB_ID_TEXT_SIZE];
    umb_id_to_text(key, text);
    const size_t size = strlen(cache->folder) + 1 + sizeof text + sizeof SUFFIX;
    char *path = malloc(size);
    if (path != NULL) {
        snprintf(path, size, "%s/%s%s", cache->folder, text, SUFFIX);
    }
    return path;
}

static uint64_t checksum(const uint8_t *file, size_t size)
{
    XXH3_state_t state;
    XXH3_64bits_reset(&state);
    XXH3_64bits_update(&state, file, HASHED);
    XXH3_64bits_update(&state, file + HEAD_BYTES, size - HEAD_BYTES);
    return XXH3_64bits_digest(&state);
}

/* The content of a file; data is malloced. */
struct content {
    uint8_t *data;
    size_t size;
};

/* Reads a whole file. Out: content: free its data after any result; NULL if there is no file. */
static enum umb_status read_file(const char *path, size_t max_bytes, struct content *content,
                                 struct umb_error *error)
{
    *content = (struct content){NULL, 0};
    const int fd = open(path, O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
    if (fd < 0) {
        return errno == ENOENT
                   ? UMB_OK
                   : umb_fail_errno(error, UMB_E_IO, errno, "cannot open '%.200s'", path);
    }
    struct stat facts;
    ssize_t got = 0;
    enum umb_status status = UMB_OK;
    if (fstat(fd, &facts) != 0 || !S_ISREG(facts.st_mode)) {
        status = umb_fail(error, UMB_E_IO, "'%.200s' is not a regular file", path);
    } else if ((uint64_t)facts.st_size > max_bytes) {
        status = umb_fail(error, UMB_E_LIMIT, "--memory: %llu MiB of a tile's result: %zu are left",
                          (unsigned long long)facts.st_size >> 20, max_bytes >> 20);
    } else if ((content->data = malloc((size_t)facts.st_size + 1)) == NULL) {
        status = umb_fail(error, UMB_E_NO_MEMORY, "memory for '%.200s' refused", path);
    } else if ((got = umbs_read_full(fd, content->data, (size_t)facts.st_size)) < 0) {
        status = umb_fail_errno(error, UMB_E_IO, errno, "cannot read '%.200s'", path);
    }
    if (status == UMB_OK) {
        content->size = (size_t)got;
        /* Marks the file as used now; if that is refused, the file is only removed sooner. */
        (void)futimens(fd, NULL);
    }
    (void)close(fd);
    return status;
}

/* Unpacks a file's result. Out: bytes: NULL if the file is damaged. */
static enum umb_status unpack(const struct content *file, const uint8_t *key, size_t max_bytes,
                              uint8_t **bytes, size_t *size, struct umb_error *error)
{
    if (file->size < HEAD_BYTES || memcmp(file->data, MAGIC, 8) != 0 ||
        memcmp(file->data + 8, key, UMB_ID_BYTES) != 0 ||
        umb__load64(file->data + HASHED) != checksum(file->data, file->size)) {
        return UMB_OK;
    }
    const uint64_t wanted = umb__load64(file->data + 40);
    if (wanted > max_bytes) {
        return umb_fail(error, UMB_E_LIMIT, "--memory: %llu MiB of a tile's result: %zu are left",
                        (unsigned long long)wanted >> 20, max_bytes >> 20);
    }
    *bytes = malloc((size_t)wanted + 1);
    if (*bytes == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "memory for a tile's result refused");
    }
    *size = (size_t)wanted;
    if (ZSTD_decompress(*bytes, *size, file->data + HEAD_BYTES, file->size - HEAD_BYTES) != *size) {
        free(*bytes);
        *bytes = NULL;
    }
    return UMB_OK;
}

static void remove_damaged(struct umbb_tile_cache *cache, const char *path)
{
    cache->damaged++;
    (void)unlink(path);
}

enum umb_status umbb_tile_cache_read(struct umbb_tile_cache *cache, const uint8_t key[UMB_ID_BYTES],
                                     size_t max_bytes, uint8_t **bytes, size_t *size,
                                     struct umb_error *error)
{
    *bytes = NULL;
    *size = 0;
    char *path = path_of(cache, key);
    if (path == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a tile's name");
    }
    struct content file;
    enum umb_status status = read_file(path, max_bytes / 2, &file, error);
    if (status == UMB_OK && file.data != NULL) {
        status = unpack(&file, key, max_bytes / 2, bytes, size, error);
        if (status == UMB_OK && *bytes == NULL) {
            remove_damaged(cache, path);
        }
    }
    free(file.data);
    free(path);
    return status;
}

void umbb_tile_cache_touch(const struct umbb_tile_cache *cache, const uint8_t key[UMB_ID_BYTES])
{
    char *path = path_of(cache, key);
    if (path != NULL) {
        (void)utimensat(AT_FDCWD, path, NULL, AT_SYMLINK_NOFOLLOW);
    }
    free(path);
}

void umbb_tile_cache_drop(struct umbb_tile_cache *cache, const uint8_t key[UMB_ID_BYTES])
{
    char *path = path_of(cache, key);
    if (path != NULL) {
        remove_damaged(cache, path);
    }
    free(path);
}

/* A whole file of a result; NULL if out of memory. */
static uint8_t *pack(const uint8_t *key, const uint8_t *bytes, size_t size, size_t *file_size)
{
    const size_t bound = ZSTD_compressBound(size);
    uint8_t *file = malloc(HEAD_BYTES + bound);
    if (file == NULL) {
        return NULL;
    }
    const size_t packed = ZSTD_compress(file + HEAD_BYTES, bound, bytes, size, ZSTD_LEVEL);
    if (ZSTD_isError(packed)) { /* out of memory; the room is enough */
        free(file);
        return NULL;
    }
    *file_size = HEAD_BYTES + packed;
    memcpy(file, MAGIC, 8);
    memcpy(file + 8, key, UMB_ID_BYTES);
    umb__store64(file + 40, size);
    umb__store64(file + HASHED, checksum(file, *file_size));
    return file;
}

enum umb_status umbb_tile_cache_write(struct umbb_tile_cache *cache,
                                      const uint8_t key[UMB_ID_BYTES], const uint8_t *bytes,
                                      size_t size, struct umb_error *error)
{
    size_t file_size = 0;
    char *path = path_of(cache, key);
    uint8_t *file = path == NULL ? NULL : pack(key, bytes, size, &file_size);
    enum umb_status status = UMB_OK;
    if (file == NULL) {
        status = umb_fail(error, UMB_E_NO_MEMORY, "memory for a tile's result refused");
    } else if (file_size <= cache->max_bytes) {
        if (cache->bytes > cache->max_bytes - file_size) {
            const uint64_t most = cache->max_bytes - cache->max_bytes / 10;
            const uint64_t keep = most > file_size ? most - file_size : 0;
            status = sweep(cache, keep, keep, error);
        }
        if (status == UMB_OK) {
            status = umbu_output_replace(path, 0, file, file_size, error);
        }
        cache->bytes += status == UMB_OK ? file_size : 0;
    }
    free(file);
    free(path);
    return status;
}

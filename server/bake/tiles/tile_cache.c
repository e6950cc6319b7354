/* SPDX-License-Identifier: Apache-2.0 */
/* Reading, checking and writing of single results; tile_sweep.c keeps the folder in size. */
#define XXH_INLINE_ALL
#include "bake/tiles/tile_cache.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <xxhash.h>
#include <zstd.h>

#include "bake/tiles/tile_key.h"
#include "bake/tiles/tile_sweep.h"
#include "base/bytes.h"
#include "tool/output.h"

#define MAGIC      "UMBTIL1\n"
#define HEAD_BYTES ((size_t)56)
#define HASHED     ((size_t)48) /* hashed bytes of the head */

/* The fastest level: a result is written once and read a few times. */
#define ZSTD_LEVEL 1

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
    return umbb_tile_sweep(folder, max_bytes, max_bytes, &cache->bytes, error);
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
    const size_t size = strlen(cache->folder) + 1 + sizeof text + sizeof UMBB_TILE_SUFFIX;
    char *path = malloc(size);
    if (path != NULL) {
        snprintf(path, size, "%s/%s%s", cache->folder, text, UMBB_TILE_SUFFIX);
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

/* Reads a whole file. Out: bytes: NULL if there is none. */
static enum umb_status read_file(const char *path, size_t max_bytes, uint8_t **bytes, size_t *size,
                                 struct umb_error *error)
{
    *bytes = NULL;
    const int fd = open(path, O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
    if (fd < 0) {
        return errno == ENOENT
                   ? UMB_OK
                   : umb_fail_errno(error, UMB_E_IO, errno, "cannot open '%.200s'", path);
    }
    struct stat facts;
    enum umb_status status = UMB_OK;
    if (fstat(fd, &facts) != 0 || !S_ISREG(facts.st_mode)) {
        status = umb_fail(error, UMB_E_IO, "'%.200s' is not a regular file", path);
    } else if ((uint64_t)facts.st_size > max_bytes) {
        status = umb_fail(error, UMB_E_LIMIT, "--memory: %llu MiB of a tile's result: %zu are left",
                          (unsigned long long)facts.st_size >> 20, max_bytes >> 20);
    } else if ((*bytes = malloc((size_t)facts.st_size + 1)) == NULL) {
        status = umb_fail(error, UMB_E_NO_MEMORY, "memory for '%.200s' refused", path);
    }
    ssize_t got = 1;
    for (*size = 0; status == UMB_OK && got > 0 && *size < (size_t)facts.st_size;) {
        got = read(fd, *bytes + *size, (size_t)facts.st_size - *size);
        *size += got > 0 ? (size_t)got : 0;
        if (got < 0 && errno == EINTR) {
            got = 1;
        } else if (got < 0) {
            status = umb_fail_errno(error, UMB_E_IO, errno, "cannot read '%.200s'", path);
        }
    }
    if (status == UMB_OK) {
        /* Marks it as used now; if that is refused, it is only removed sooner. */
        (void)futimens(fd, NULL);
    }
    (void)close(fd);
    return status;
}

/* Unpacks a file's result; NULL in bytes if the file is damaged. */
static enum umb_status unpack(const uint8_t *file, size_t file_size, const uint8_t *key,
                              size_t max_bytes, uint8_t **bytes, size_t *size,
                              struct umb_error *error)
{
    if (file_size < HEAD_BYTES || memcmp(file, MAGIC, 8) != 0 ||
        memcmp(file + 8, key, UMB_ID_BYTES) != 0 ||
        umb__load64(file + HASHED) != checksum(file, file_size)) {
        return UMB_OK;
    }
    const uint64_t wanted = umb__load64(file + 40);
    if (wanted > max_bytes) {
        return umb_fail(error, UMB_E_LIMIT, "--memory: %llu MiB of a tile's result: %zu are left",
                        (unsigned long long)wanted >> 20, max_bytes >> 20);
    }
    *bytes = malloc((size_t)wanted + 1);
    if (*bytes == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "memory for a tile's result refused");
    }
    *size = (size_t)wanted;
    if (ZSTD_decompress(*bytes, *size, file + HEAD_BYTES, file_size - HEAD_BYTES) != *size) {
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
    uint8_t *file;
    size_t file_size;
    enum umb_status status = read_file(path, max_bytes / 2, &file, &file_size, error);
    if (status == UMB_OK && file != NULL) {
        status = unpack(file, file_size, key, max_bytes / 2, bytes, size, error);
        if (status == UMB_OK && *bytes == NULL) {
            remove_damaged(cache, path);
        }
    }
    free(file);
    free(path);
    return status;
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
            status = umbb_tile_sweep(cache->folder, keep, keep, &cache->bytes, error);
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

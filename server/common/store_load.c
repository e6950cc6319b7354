/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Loading one file of the store: read whole, prove, map the cache (made here if need be) or expand.
 *
 * A packed file is read into memory and never mapped, so that truncation by another process while
 * it is looked at is a short read. It is proven in full (head and every page) at each load: that
 * also finds bytes that rotted since they were published.
 */
#include "common/store_internal.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "common/file.h"
#include "common/sha256.h"
#include "format/head.h"

/* Reads all of fd, whose size fstat gave; a file that shrank meanwhile is E_TRUNCATED. */
static enum umb_status read_all(int fd, size_t size, const char *name, uint8_t **bytes,
                                struct umb_error *error)
{
    uint8_t *block = malloc(size > 0 ? size : 1);
    if (block == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory to read %zu bytes of '%.64s'", size,
                        name);
    }
    size_t have = 0;
    while (have < size) {
        size_t part = size - have < ((size_t)1 << 30) ? size - have : (size_t)1 << 30;
        ssize_t count = read(fd, block + have, part);
        if (count < 0 && errno == EINTR) {
            continue;
        }
        if (count <= 0) {
            enum umb_status status =
                count < 0 ? umb_fail_errno(error, UMB_E_IO, errno, "cannot read '%.64s'", name)
                          : umb_fail(error, UMB_E_TRUNCATED, "'%.64s' ended at byte %zu of %zu",
                                     name, have, size);
            free(block);
            return status;
        }
        have += (size_t)count;
    }
    *bytes = block;
    return UMB_OK;
}

static enum umb_status read_packed(struct umbs_store *store, struct umbs_entry *entry,
                                   const char *path, size_t *size, struct umb_error *error)
{
    struct stat stat_buffer;
    uint8_t *bytes = NULL;
    enum umb_status status;
    int fd = open(path, O_RDONLY | O_NONBLOCK | O_CLOEXEC);
    if (fd < 0) {
        return umb_fail_errno(error, UMB_E_IO, errno, "cannot open '%.64s.umb'", entry->item.name);
    }
    if (fstat(fd, &stat_buffer) != 0) {
        status =
            umb_fail_errno(error, UMB_E_IO, errno, "cannot stat '%.64s.umb'", entry->item.name);
    } else if (!S_ISREG(stat_buffer.st_mode)) {
        status =
            umb_fail(error, UMB_E_FORMAT, "'%.64s.umb' is not a regular file", entry->item.name);
    } else if ((uint64_t)stat_buffer.st_size > store->max_memory_bytes) {
        status =
            umb_fail(error, UMB_E_TOO_LARGE, "'%.64s.umb' has %lld bytes, over the limit of %llu",
                     entry->item.name, (long long)stat_buffer.st_size,
                     (unsigned long long)store->max_memory_bytes);
    } else {
        entry->stamp = umbs__stamp_of(&stat_buffer);
        *size = (size_t)stat_buffer.st_size;
        status = read_all(fd, *size, entry->item.name, &bytes, error);
    }
    close(fd);
    entry->image = bytes;
    return status;
}

/* Opens a packed image in memory; the entry keeps the bytes. */
static enum umb_status expand(struct umbs_store *store, const void *packed, size_t size,
                              struct umb_asset **asset, struct umb_error *error)
{
    struct umb_open_options options = {.trust = UMB_TRUST_NOTHING,
                                       .max_memory_bytes = store->max_memory_bytes};
    return umb_asset_open_bytes(packed, size, &options, asset, error);
}

/* Opens a cache file and checks that it is the mapped form of that id. */
static enum umb_status cache_try(struct umbs_store *store, const char *path,
                                 const uint8_t id[UMB_ID_BYTES], struct umb_asset **asset,
                                 struct umb_error *error)
{
    struct umb_open_options options = {.trust = UMB_TRUST_NOTHING,
                                       .max_memory_bytes = store->max_memory_bytes};
    struct umb_asset_info info;
    enum umb_status status = umb_asset_open_file(path, &options, asset, error);
    if (status != UMB_OK) {
        return status;
    }
    umb_asset_get_info(*asset, &info);
    if (info.encoding != UMB_ENCODING_MAPPED || memcmp(info.id, id, UMB_ID_BYTES) != 0) {
        umb_asset_close(*asset);
        *asset = NULL;
        return umb_fail(error, UMB_E_CORRUPT, "the cache file is of another asset");
    }
    return UMB_OK;
}

static enum umb_status cache_build(struct umbs_store *store, const char *path, const void *packed,
                                   size_t size, struct umb_error *error)
{
    struct umb_asset *asset = NULL;
    struct umbs_file file = {.fd = -1};
    if (mkdir(store->cache, 0755) != 0 && errno != EEXIST) {
        return umb_fail_errno(error, UMB_E_CANNOT_CREATE, errno, "cannot create '%.200s'",
                              store->cache);
    }
    enum umb_status status = umbs_file_begin(path, &file, error);
    if (status != UMB_OK) {
        return status;
    }
    status = expand(store, packed, size, &asset, error);
    if (status == UMB_OK) {
        struct umb_sink sink = umbs_file_sink(&file);
        status = umb_mapped_write(asset, &sink, error);
    }
    umb_asset_close(asset);
    if (status == UMB_OK) {
        return umbs_file_commit(&file, error);
    }
    if (file.system_error != 0) {
        status = umb_fail_errno(error, UMB_E_IO, file.system_error, "cannot write '%.200s'", path);
    }
    umbs_file_abandon(&file);
    return status;
}

enum umb_status umbs__cache_open(struct umbs_store *store, const uint8_t id[UMB_ID_BYTES],
                                 const void *packed, size_t packed_size, struct umb_asset **asset,
                                 struct umb_error *error)
{
    char name[UMB_ID_TEXT_SIZE + 8];
    *asset = NULL;
    umb_id_to_text(id, name);
    memcpy(name + UMB_ID_TEXT_SIZE - 1, ".umbm", 6);
    char *path = umbs__path_join(store->cache, name);
    if (path == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a path");
    }
    enum umb_status status = cache_try(store, path, id, asset, error);
    if (status != UMB_OK) {
        if (status != UMB_E_NO_INPUT) {
            char quoted[UMBS_LOG_QUOTE_SIZE];
            umbs_log_event(store->log, UMB_LOG_WARN, "cache_rebuilt", "file=%s reason=%s", name,
                           umbs_log_quote(error->message, quoted));
        }
        status = cache_build(store, path, packed, packed_size, error);
        if (status == UMB_OK) {
            status = cache_try(store, path, id, asset, error);
        }
    }
    free(path);
    return status;
}

static enum umb_status prove(struct umbs_entry *entry, size_t size, struct umb_error *error)
{
    struct umb__head head;
    enum umb_status status = umb__head_parse(entry->image, size, &head, error);
    if (status != UMB_OK) {
        return status;
    }
    memcpy(entry->item.id, head.id, UMB_ID_BYTES);
    entry->has_id = 1;
    if (head.encoding != UMB_ENCODING_PACKED) {
        return umb_fail(error, UMB_E_FORMAT,
                        "a mapped file (.umbm) cannot be published: it proves no identity");
    }
    return umb_pack_prove(entry->image, size, 1, &umbs_sha256, error);
}

/* Reads, proves and opens; on failure the entry has no asset. */
static enum umb_status load(struct umbs_store *store, struct umbs_entry *entry, const char *path,
                            struct umb_error *error)
{
    size_t size = 0;
    enum umb_status status = read_packed(store, entry, path, &size, error);
    if (status == UMB_OK) {
        status = prove(entry, size, error);
    }
    if (status != UMB_OK) {
        return status;
    }
    status = store->no_cache ? UMB_E_UNSUPPORTED
                             : umbs__cache_open(store, entry->item.id, entry->image, size,
                                                &entry->asset, error);
    if (status == UMB_OK) {
        free(entry->image);
        entry->image = NULL;
    } else {
        if (!store->no_cache) {
            char quoted[UMBS_LOG_QUOTE_SIZE];
            umbs_log_event(store->log, UMB_LOG_WARN, "cache_unavailable", "asset=%s reason=%s",
                           entry->item.name, umbs_log_quote(error->message, quoted));
        }
        status = expand(store, entry->image, size, &entry->asset, error);
    }
    if (status == UMB_OK) {
        struct umb_asset_info info;
        umb_asset_get_info(entry->asset, &info);
        entry->item.packed_bytes = size;
        entry->item.memory_bytes = info.memory_bytes;
        entry->item.light_count = info.light_count;
    }
    return status;
}

static int is_the_files_fault(enum umb_status status)
{
    return status == UMB_E_FORMAT || status == UMB_E_VERSION || status == UMB_E_TRUNCATED ||
           status == UMB_E_CORRUPT || status == UMB_E_UNSUPPORTED || status == UMB_E_TOO_LARGE;
}

struct umbs_entry *umbs__entry_load(struct umbs_store *store, const char *name)
{
    char file[UMBS_STORE_NAME_MAX + 8];
    char quoted[UMBS_LOG_QUOTE_SIZE];
    struct timespec from;
    struct timespec to;
    struct umbs_entry *entry = calloc(1, sizeof *entry);
    if (entry == NULL) {
        return NULL;
    }
    snprintf(entry->item.name, sizeof entry->item.name, "%s", name);
    snprintf(file, sizeof file, "%s.umb", name);
    entry->store = store;
    entry->references = 1;
    char *path = umbs__path_join(store->folder, file);
    if (path == NULL) {
        free(entry);
        return NULL;
    }
    clock_gettime(CLOCK_MONOTONIC, &from);
    entry->item.status = load(store, entry, path, &entry->error);
    clock_gettime(CLOCK_MONOTONIC, &to);
    free(path);
    if (entry->item.status != UMB_OK) {
        free(entry->image);
        entry->image = NULL;
        entry->retry = !is_the_files_fault(entry->item.status);
        umbs_log_event(store->log, UMB_LOG_ERROR, "asset_damaged", "asset=%s status=%s reason=%s",
                       name, umb_status_name(entry->item.status),
                       umbs_log_quote(entry->error.message, quoted));
    } else {
        char id[UMB_ID_TEXT_SIZE];
        umb_id_to_text(entry->item.id, id);
        umbs_log_event(store->log, UMB_LOG_INFO, "asset_loaded",
                       "asset=%s id=%s bytes=%llu memory=%llu dur_ms=%lld", name, id,
                       (unsigned long long)entry->item.packed_bytes,
                       (unsigned long long)entry->item.memory_bytes,
                       (long long)(to.tv_sec - from.tv_sec) * 1000 +
                           (to.tv_nsec - from.tv_nsec) / 1000000);
    }
    pthread_mutex_lock(&store->mutex);
    store->entries++;
    pthread_mutex_unlock(&store->mutex);
    return entry;
}

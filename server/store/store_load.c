/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Loading one file of the store: read it whole, prove it, map its cache file (made if needed) or
 * expand it in memory.
 *
 * A packed file is read into memory and never mapped, so truncation by another process gives a
 * short read and no signal. It is proven in full (head and every page) at each load: that also
 * finds bytes that rotted since the file was published.
 */
#include "store/store_internal.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/try.h"
#include "tool/clock.h"
#include "tool/output.h"
#include "common/sha256.h"
#include "format/head.h"

/* Reads all of fd, whose size fstat gave; E_TRUNCATED if the file shrank meanwhile. */
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

/* A packed file in memory. */
struct packed {
    uint8_t *bytes;
    size_t size;
};

static enum umb_status read_packed(struct umbs_store *store, struct umbs_entry *entry,
                                   const char *path, struct packed *packed, struct umb_error *error)
{
    struct stat stat_buffer;
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
        status = umb_fail(error, UMB_E_TOO_LARGE,
                          "'%.64s.umb' has %lld bytes, over the limit of %llu (--load-memory)",
                          entry->item.name, (long long)stat_buffer.st_size,
                          (unsigned long long)store->max_memory_bytes);
    } else {
        entry->stamp = umbs_stamp_of(&stat_buffer);
        packed->size = (size_t)stat_buffer.st_size;
        status = read_all(fd, packed->size, entry->item.name, &packed->bytes, error);
    }
    close(fd);
    return status;
}

/* Expands a packed image in memory, within what is left of the limit. */
static enum umb_status expand(struct umbs_store *store, const struct packed *packed,
                              struct umb_asset **asset, struct umb_error *error)
{
    struct umb_error cause;
    struct umb_open_options options = {
        .trust = UMB_TRUST_NOTHING,
        .max_memory_bytes =
            store->max_memory_bytes > packed->size ? store->max_memory_bytes - packed->size : 1};
    enum umb_status status =
        umb_asset_open_bytes(packed->bytes, packed->size, &options, asset, &cause);
    if (status == UMB_E_TOO_LARGE) {
        return umb_fail(error, status,
                        "loading it takes more than the %llu bytes of --load-memory, of which the "
                        "packed file takes %zu: %s",
                        (unsigned long long)store->max_memory_bytes, packed->size, cause.message);
    }
    return status == UMB_OK ? UMB_OK : umb_fail(error, status, "%s", cause.message);
}

/* Opens a mapped file and checks its id and its digest against the record. */
static enum umb_status cache_try(struct umbs_store *store, const char *path,
                                 const struct umbs_record *record, const struct umbs_stamp *known,
                                 struct umbs_entry *entry, struct umb_error *error)
{
    struct umbs_asset_map_options options = {.known = known,
                                             .digest = record->digest,
                                             .ours = 1,
                                             .copy = store->copy,
                                             .warm = store->warm};
    memcpy(options.id, record->id, UMB_ID_BYTES);
    return umbs_asset_map_open(path, &options, &entry->map, error);
}

/* A sink that hashes its bytes and passes them on. */
struct hashing {
    struct umb_sink to;
    struct umbs_sha256_run run;
};

static enum umb_status hash_and_write(void *user, const void *bytes, size_t count)
{
    struct hashing *hashing = user;
    umbs_sha256_add(&hashing->run, bytes, count);
    return hashing->to.write(hashing->to.user, bytes, count);
}

/* Writes the mapped form. Out: digest: SHA-256 of its bytes. */
static enum umb_status cache_build(struct umbs_store *store, struct umbs_cache *cache,
                                   const char *path, const struct packed *packed,
                                   uint8_t digest[UMB_ID_BYTES], struct umb_error *error)
{
    struct umb_asset *asset = NULL;
    struct umbu_output file = {.fd = -1};
    UMB__TRY(umbu_output_begin(path, UMBU_OUTPUT_PRIVATE, &file, error));
    struct hashing hashing = {.to = umbu_output_sink(&file)};
    umbs_sha256_begin(&hashing.run);
    enum umb_status status = expand(store, packed, &asset, error);
    if (status == UMB_OK) {
        struct umb_sink sink = {.write = hash_and_write, .user = &hashing};
        status = umb__mapped_write(asset, &sink, error);
    }
    umb_asset_close(asset);
    umbs_sha256_end(&hashing.run, digest);
    if (status == UMB_OK) {
        const int synced = umbs__cache_syncs(cache);
        file.unsynced = !synced;
        status = umbu_output_commit(&file, error);
        umbs__cache_made(cache, synced);
        return status;
    }
    if (file.system_error != 0) {
        status = umb_fail_errno(error, UMB_E_IO, file.system_error, "cannot write '%.200s'", path);
    }
    umbu_output_abandon(&file);
    return status;
}

/* Opens the mapped file that the list has for the id. Fails: E_NO_INPUT (the list has none, and
 * there is no file either), E_CORRUPT and the like: make it anew. */
static enum umb_status cache_reuse(struct umbs_store *store, struct umbs_entry *entry,
                                   const char *path, int rebuild, struct umb_error *error)
{
    struct umbs_record record;
    if (rebuild) {
        return umb_fail(error, UMB_E_CORRUPT, "it was changed while it was in use");
    }
    if (umbs__cache_find_id(store->folders[entry->folder].cache, entry->item.id, &record)) {
        return cache_try(store, path, &record, NULL, entry, error);
    }
    return access(path, F_OK) != 0
               ? umb_fail(error, UMB_E_NO_INPUT, "there is none")
               : umb_fail(error, UMB_E_CORRUPT,
                          "no line under the cache's key says what the mapped file must be");
}

/* Makes the mapped file and opens it. Fails: E_BUSY (another daemon may write), and the like. */
static enum umb_status cache_renew(struct umbs_store *store, struct umbs_entry *entry,
                                   const char *path, const struct packed *packed, int writable,
                                   struct umb_error *error)
{
    struct umbs_record record;
    if (!writable) {
        return umb_fail(error, UMB_E_BUSY, "another daemon writes to the cache");
    }
    if (error->status != UMB_E_NO_INPUT) {
        char quoted[UMBS_LOG_QUOTE_SIZE];
        umbs_log_event(store->log, UMB_LOG_WARN, "cache_rebuilt", "asset=%s reason=%s",
                       entry->item.name, umbs_log_quote(error->message, quoted));
    }
    memcpy(record.id, entry->item.id, UMB_ID_BYTES);
    struct umbs_cache *cache = store->folders[entry->folder].cache;
    enum umb_status status = cache_build(store, cache, path, packed, record.digest, error);
    return status == UMB_OK ? cache_try(store, path, &record, NULL, entry, error) : status;
}

/* Opens the mapped form of a proven packed image, made if needed. Fails: any status; the caller
 * then expands the packed form. */
static enum umb_status cache_open(struct umbs_store *store, struct umbs_entry *entry,
                                  const struct packed *packed, int rebuild, struct umb_error *error)
{
    struct umbs_cache *cache = store->folders[entry->folder].cache;
    int writable = 0;
    enum umb_status status = umbs__cache_ready(cache, &writable, error);
    char *path = status == UMB_OK ? umbs__cache_file(cache, entry->item.id) : NULL;
    if (status == UMB_OK && path == NULL) {
        status = umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a path");
    }
    if (status == UMB_OK) {
        status = cache_reuse(store, entry, path, rebuild, error);
        if (status != UMB_OK) {
            status = cache_renew(store, entry, path, packed, writable, error);
        }
    }
    free(path);
    return status;
}

/* Removes the mapped form of an asset, if there is one. */
static void forget_mapped(struct umbs_cache *cache, const uint8_t id[UMB_ID_BYTES])
{
    char *path = cache != NULL ? umbs__cache_file(cache, id) : NULL;
    if (path != NULL) {
        (void)unlink(path); /* processes that have mapped the file keep it */
    }
    free(path);
}

void umbs_store_replacing(struct umbs_store *store, const uint8_t id[UMB_ID_BYTES], size_t folder,
                          int yes)
{
    char text[UMB_ID_TEXT_SIZE];
    struct umbs_entry *entry = NULL;
    struct umb_error error;
    umb_id_to_text(id, text);
    if (umbs_store_acquire(store, text, &entry, &error) == UMB_OK && entry->folder == folder) {
        atomic_store(&entry->replaced, yes);
        if (yes) {
            forget_mapped(store->folders[folder].cache, id);
        }
    }
    umbs_entry_release(entry);
}

int umbs_entry_is_replaced(const struct umbs_entry *entry)
{
    return atomic_load(&entry->replaced);
}

static enum umb_status prove(struct umbs_entry *entry, const struct packed *packed,
                             struct umb_error *error)
{
    struct umb__head head;
    UMB__TRY(umb__head_parse(packed->bytes, packed->size, &head, error));
    memcpy(entry->item.id, head.id, UMB_ID_BYTES);
    entry->has_id = 1;
    if (head.encoding != UMB_ENCODING_PACKED) {
        return umb_fail(error, UMB_E_FORMAT,
                        "a mapped file (.umbm) cannot be published: it proves no identity");
    }
    return umb_packed_prove(packed->bytes, packed->size, NULL, &umbs_sha256, error);
}

/* Opens the asset of a proven packed image: mapped from its cache, else expanded. */
static enum umb_status open_proven(struct umbs_store *store, struct umbs_entry *entry,
                                   const struct packed *packed, int rebuild,
                                   struct umb_error *error)
{
    enum umb_status status =
        store->no_cache ? UMB_E_UNSUPPORTED : cache_open(store, entry, packed, rebuild, error);
    if (status == UMB_OK) {
        entry->asset = umbs_asset_map_asset(entry->map);
        return UMB_OK;
    }
    if (!store->no_cache) {
        char quoted[UMBS_LOG_QUOTE_SIZE];
        umbs_log_event(store->log, UMB_LOG_WARN, "cache_unavailable", "asset=%s reason=%s",
                       entry->item.name, umbs_log_quote(error->message, quoted));
    }
    status = expand(store, packed, &entry->expanded, error);
    entry->asset = entry->expanded;
    return status;
}

/* Reads, proves and opens a file; on failure the entry has no asset. */
static enum umb_status load(struct umbs_store *store, struct umbs_entry *entry, const char *path,
                            int rebuild, struct umb_error *error)
{
    struct packed packed = {0};
    enum umb_status status = read_packed(store, entry, path, &packed, error);
    if (status == UMB_OK) {
        status = prove(entry, &packed, error);
    }
    if (status == UMB_OK) {
        status = open_proven(store, entry, &packed, rebuild, error);
    }
    free(packed.bytes);
    return status;
}

/* Fills the description of an entry that has its asset. */
static void describe(struct umbs_entry *entry)
{
    struct umb_asset_info info;
    umb_asset_get_info(entry->asset, &info);
    entry->item.packed_bytes = entry->stamp.size;
    entry->item.memory_bytes = info.memory_bytes;
    entry->item.light_count = info.light_count;
}

int umbs__is_damage(enum umb_status status)
{
    return status == UMB_E_FORMAT || status == UMB_E_TRUNCATED || status == UMB_E_CORRUPT;
}

int umbs__is_the_files_fault(enum umb_status status)
{
    return umbs__is_damage(status) || status == UMB_E_VERSION || status == UMB_E_UNSUPPORTED ||
           status == UMB_E_TOO_LARGE;
}

char *umbs__packed_path(const struct umbs_store *store, const struct umbs_name *name)
{
    char file[UMBS_STORE_NAME_MAX + 8];
    snprintf(file, sizeof file, "%s.umb", name->text);
    return umbs__path_join(store->folders[name->folder].path, file);
}

static struct umbs_entry *entry_create(struct umbs_store *store, const struct umbs_name *name)
{
    struct umbs_entry *entry = calloc(1, sizeof *entry);
    if (entry != NULL) {
        snprintf(entry->item.name, sizeof entry->item.name, "%s", name->text);
        entry->store = store;
        entry->folder = name->folder;
        atomic_init(&entry->references, 1);
        atomic_fetch_add(&store->holders, 1);
    }
    return entry;
}

static void log_loaded(struct umbs_entry *entry, const char *how, uint64_t from_ms)
{
    char id[UMB_ID_TEXT_SIZE];
    umb_id_to_text(entry->item.id, id);
    umbs_log_event(entry->store->log, UMB_LOG_INFO, "asset_loaded",
                   "asset=%s id=%s bytes=%llu memory=%llu how=%s dur_ms=%llu", entry->item.name, id,
                   (unsigned long long)entry->item.packed_bytes,
                   (unsigned long long)entry->item.memory_bytes, how,
                   (unsigned long long)((uint64_t)umbu_clock_ms() - from_ms));
}

struct umbs_entry *umbs__entry_load(struct umbs_store *store, const struct umbs_name *name,
                                    int rebuild)
{
    uint64_t from_ms = (uint64_t)umbu_clock_ms();
    char *path = umbs__packed_path(store, name);
    struct umbs_entry *entry = path != NULL ? entry_create(store, name) : NULL;
    if (entry == NULL) {
        free(path);
        return NULL;
    }
    entry->item.status = load(store, entry, path, rebuild, &entry->error);
    entry->checked_ms = (uint64_t)umbu_clock_ms();
    free(path);
    if (entry->item.status != UMB_OK) {
        char quoted[UMBS_LOG_QUOTE_SIZE];
        entry->retry = !umbs__is_the_files_fault(entry->item.status);
        umbs_log_event(store->log, UMB_LOG_ERROR,
                       umbs__is_damage(entry->item.status) ? "asset_damaged" : "asset_unreadable",
                       "asset=%s status=%s reason=%s", name->text,
                       umb_status_name(entry->item.status),
                       umbs_log_quote(entry->error.message, quoted));
    } else {
        describe(entry);
        log_loaded(entry, "proven", from_ms);
    }
    return entry;
}

struct umbs_entry *umbs__entry_recall(struct umbs_store *store, const struct umbs_name *name,
                                      const struct umbs_stamp *packed)
{
    uint64_t from_ms = (uint64_t)umbu_clock_ms();
    struct umbs_cache *cache = store->folders[name->folder].cache;
    struct umbs_record known;
    struct umbs_entry *entry =
        cache != NULL && umbs__cache_find(cache, packed, &known) ? entry_create(store, name) : NULL;
    if (entry == NULL) {
        return NULL;
    }
    memcpy(entry->item.id, known.id, UMB_ID_BYTES);
    entry->has_id = 1;
    entry->stamp = *packed;
    char *path = umbs__cache_file(cache, entry->item.id);
    struct umb_error error;
    int good =
        path != NULL && cache_try(store, path, &known, &known.mapped, entry, &error) == UMB_OK;
    free(path);
    if (!good) {
        umbs_entry_release(entry);
        return NULL;
    }
    entry->asset = umbs_asset_map_asset(entry->map);
    /* The opening checked a changed mapped file in full, as it checks a copy. */
    if (store->copy || !umbs_stamp_equal(&known.mapped, umbs_asset_map_stamp(entry->map))) {
        entry->checked_ms = (uint64_t)umbu_clock_ms();
    }
    describe(entry);
    log_loaded(entry, "known", from_ms);
    return entry;
}

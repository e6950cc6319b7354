/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Loading one file of the store: read the packed file whole, verify it, and map its cache file
 * (made if needed) or expand it in memory.
 *
 * A packed file is read into memory and never mapped. If another process cuts it short, the read
 * ends early and no signal is raised. Each load verifies the head and every page, so it also finds
 * bytes that changed on the disk since the file was published.
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
#include "common/file_system.h"
#include "common/sha256.h"
#include "format/head.h"

/* A packed file in memory. */
struct packed {
    uint8_t *bytes;
    size_t size;
};

/* Reads a packed file whole, and its stamp. Fails: E_TRUNCATED if the file shrinks meanwhile. */
static enum umb_status read_packed(struct umbs_entry *entry, const char *path,
                                   struct packed *packed, struct umb_error *error)
{
    struct stat facts;
    char what[80];
    enum umb_status status;
    const char *name = entry->item.name;
    const uint64_t most = entry->store->options.max_memory_bytes;
    int fd = open(path, O_RDONLY | O_NONBLOCK | O_CLOEXEC);
    if (fd < 0 || fstat(fd, &facts) != 0) {
        status = umb_fail_errno(error, UMB_E_IO, errno, "cannot open '%.64s.umb'", name);
    } else if (!S_ISREG(facts.st_mode)) {
        status = umb_fail(error, UMB_E_FORMAT, "'%.64s.umb' is not a regular file", name);
    } else if ((uint64_t)facts.st_size > most) {
        status = umb_fail(error, UMB_E_TOO_LARGE,
                          "'%.64s.umb' has %lld bytes, over the limit of %llu (--load-memory)",
                          name, (long long)facts.st_size, (unsigned long long)most);
    } else {
        entry->stamp = umbs_stamp_of(&facts);
        packed->size = entry->stamp.size;
        (void)snprintf(what, sizeof what, "'%.64s'", name);
        status = umbs_read_file(fd, packed->size, what, &packed->bytes, error);
    }
    umbs_hang_up(&fd);
    return status;
}

/* Expands a packed image in memory, within what is left of the limit. */
static enum umb_status expand(struct umbs_store *store, const struct packed *packed,
                              struct umb_asset **asset, struct umb_error *error)
{
    struct umb_error cause;
    struct umb_open_options options = {.trust = UMB_TRUST_NOTHING,
                                       .max_memory_bytes =
                                           store->options.max_memory_bytes > packed->size
                                               ? store->options.max_memory_bytes - packed->size
                                               : 1};
    enum umb_status status =
        umb_asset_open_bytes(packed->bytes, packed->size, &options, asset, &cause);
    if (status == UMB_E_TOO_LARGE) {
        return umb_fail(error, status,
                        "loading it takes more than the %llu bytes of --load-memory, of which the "
                        "packed file takes %zu: %s",
                        (unsigned long long)store->options.max_memory_bytes, packed->size,
                        cause.message);
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
                                             .copy = store->options.copy,
                                             .warm = store->options.warm};
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

/* Opens the mapped file that the list records for the id. Fails: E_NO_INPUT (neither a record nor a
 * file), E_CORRUPT and the like: the file must be made anew. */
static enum umb_status cache_reuse(struct umbs_store *store, struct umbs_entry *entry,
                                   const char *path, int rebuild, struct umb_error *error)
{
    struct umbs_record record;
    if (rebuild) {
        return umb_fail(error, UMB_E_CORRUPT, "it was changed while it was in use");
    }
    if (umbs__cache_find(store->folders[entry->folder].cache, NULL, entry->item.id, &record)) {
        return cache_try(store, path, &record, NULL, entry, error);
    }
    return access(path, F_OK) != 0
               ? umb_fail(error, UMB_E_NO_INPUT, "there is none")
               : umb_fail(error, UMB_E_CORRUPT,
                          "no line under the cache's key says what the mapped file must be");
}

/* Makes the mapped file and opens it. Fails: E_BUSY (only another daemon may write to the cache),
 * and the like. */
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
        umbs_log_event(store->options.log, UMB_LOG_WARN, "cache_rebuilt", "asset=%s reason=%s",
                       entry->item.name, umbs_log_quote(error->message, quoted));
    }
    memcpy(record.id, entry->item.id, UMB_ID_BYTES);
    struct umbs_cache *cache = store->folders[entry->folder].cache;
    UMB__TRY(cache_build(store, cache, path, packed, record.digest, error));
    return cache_try(store, path, &record, NULL, entry, error);
}

/* Opens the mapped form of a verified packed image, made if needed. Fails: any status; the caller
 * then expands the packed form in memory. */
static enum umb_status cache_open(struct umbs_store *store, struct umbs_entry *entry,
                                  const struct packed *packed, int rebuild, struct umb_error *error)
{
    struct umbs_cache *cache = store->folders[entry->folder].cache;
    int writable = 0;
    char path[UMBS_PATH_SIZE];
    UMB__TRY(umbs__cache_ready(cache, &writable, error));
    umbs__cache_file(cache, entry->item.id, path);
    return cache_reuse(store, entry, path, rebuild, error) == UMB_OK
               ? UMB_OK
               : cache_renew(store, entry, path, packed, writable, error);
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

/* Opens the asset of a verified packed image: mapped from its cache, else expanded in memory. */
static enum umb_status open_proven(struct umbs_store *store, struct umbs_entry *entry,
                                   const struct packed *packed, int rebuild,
                                   struct umb_error *error)
{
    enum umb_status status = store->options.no_cache
                                 ? UMB_E_UNSUPPORTED
                                 : cache_open(store, entry, packed, rebuild, error);
    if (status == UMB_OK) {
        entry->asset = umbs_asset_map_asset(entry->map);
        return UMB_OK;
    }
    if (!store->options.no_cache) {
        char quoted[UMBS_LOG_QUOTE_SIZE];
        umbs_log_event(store->options.log, UMB_LOG_WARN, "cache_unavailable", "asset=%s reason=%s",
                       entry->item.name, umbs_log_quote(error->message, quoted));
    }
    status = expand(store, packed, &entry->expanded, error);
    entry->asset = entry->expanded;
    return status;
}

/* Fills the description of an entry that has its asset, and logs how it was opened. */
static void describe(struct umbs_entry *entry, const char *how, uint64_t from_ms)
{
    char id[UMB_ID_TEXT_SIZE];
    struct umb_asset_info info;
    umb_asset_get_info(entry->asset, &info);
    entry->item.packed_bytes = entry->stamp.size;
    entry->item.memory_bytes = info.memory_bytes;
    entry->item.light_count = info.light_count;
    umb_id_to_text(entry->item.id, id);
    umbs_log_event(entry->store->options.log, UMB_LOG_INFO, "asset_loaded",
                   "asset=%s id=%s bytes=%llu memory=%llu how=%s dur_ms=%llu", entry->item.name, id,
                   (unsigned long long)entry->item.packed_bytes,
                   (unsigned long long)entry->item.memory_bytes, how,
                   (unsigned long long)((uint64_t)umbu_clock_ms() - from_ms));
}

/* Reads, proves and opens a file; on failure the entry has no asset. */
static enum umb_status load(struct umbs_store *store, struct umbs_entry *entry, const char *path,
                            struct packed *packed, int rebuild, struct umb_error *error)
{
    UMB__TRY(read_packed(entry, path, packed, error));
    UMB__TRY(prove(entry, packed, error));
    return open_proven(store, entry, packed, rebuild, error);
}

struct umbs_entry *umbs__entry_load(struct umbs_store *store, const struct umbs_name *name,
                                    int rebuild)
{
    const uint64_t from_ms = (uint64_t)umbu_clock_ms();
    struct packed packed = {0};
    char path[UMBS_PATH_SIZE];
    struct umbs_entry *entry = umbs__entry_create(store, name);
    if (entry == NULL) {
        return NULL;
    }
    umbs__packed_path(store, name, path);
    entry->item.status = load(store, entry, path, &packed, rebuild, &entry->error);
    entry->checked_ms = (uint64_t)umbu_clock_ms();
    free(packed.bytes);
    if (entry->item.status != UMB_OK) {
        char quoted[UMBS_LOG_QUOTE_SIZE];
        entry->retry = !umbs__is_the_files_fault(entry->item.status);
        umbs_log_event(store->options.log, UMB_LOG_ERROR,
                       umbs__is_damage(entry->item.status) ? "asset_damaged" : "asset_unreadable",
                       "asset=%s status=%s reason=%s", name->text,
                       umb_status_name(entry->item.status),
                       umbs_log_quote(entry->error.message, quoted));
    } else {
        describe(entry, "proven", from_ms);
    }
    return entry;
}

struct umbs_entry *umbs__entry_recall(struct umbs_store *store, const struct umbs_name *name,
                                      const struct umbs_stamp *packed)
{
    const uint64_t from_ms = (uint64_t)umbu_clock_ms();
    struct umbs_cache *cache = store->folders[name->folder].cache;
    struct umbs_record known;
    struct umb_error error;
    char path[UMBS_PATH_SIZE];
    struct umbs_entry *entry = cache != NULL && umbs__cache_find(cache, packed, NULL, &known)
                                   ? umbs__entry_create(store, name)
                                   : NULL;
    if (entry == NULL) {
        return NULL;
    }
    memcpy(entry->item.id, known.id, UMB_ID_BYTES);
    entry->has_id = 1;
    entry->stamp = *packed;
    umbs__cache_file(cache, known.id, path);
    if (cache_try(store, path, &known, &known.mapped, entry, &error) != UMB_OK) {
        umbs_entry_release(entry);
        return NULL;
    }
    entry->asset = umbs_asset_map_asset(entry->map);
    /* A copy, or a mapped file with another stamp, has just been checked in full by the opening. */
    if (store->options.copy || !umbs_stamp_equal(&known.mapped, umbs_asset_map_stamp(entry->map))) {
        entry->checked_ms = (uint64_t)umbu_clock_ms();
    }
    describe(entry, "known", from_ms);
    return entry;
}

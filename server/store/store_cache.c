/* SPDX-License-Identifier: Apache-2.0 */
/* See store_cache.h. */
#define _GNU_SOURCE /* getrandom, syncfs */
#include "store/store_cache.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/try.h"
#include "tool/output.h"
#include "common/private_folder.h"

#define SYNC_EACH_MAX 8 /* mapped files of a scan that are synced one by one; more: syncfs */

void umbs__path(char path[UMBS_PATH_SIZE], const char *folder, const char *name)
{
    if (snprintf(path, UMBS_PATH_SIZE, "%s/%s", folder, name) >= UMBS_PATH_SIZE) {
        path[0] = '\0';
    }
}

enum umb_status umbs__cache_init(struct umbs_cache *cache, const char *path,
                                 const struct umbs_log *log, struct umb_error *error)
{
    *cache = (struct umbs_cache){.log = log, .path = strdup(path), .lock = {.fd = -1}};
    pthread_mutex_init(&cache->mutex, NULL);
    return cache->path != NULL ? UMB_OK
                               : umb_fail(error, UMB_E_NO_MEMORY, "out of memory for the cache");
}

void umbs__cache_finish(struct umbs_cache *cache)
{
    umbs_owner_lock_release(&cache->lock);
    umbs__records_finish(&cache->records);
    free(cache->path);
    pthread_mutex_destroy(&cache->mutex);
}

static void warn(const struct umbs_cache *cache, const char *event, const struct umb_error *error)
{
    char quoted[UMBS_LOG_QUOTE_SIZE];
    umbs_log_event(cache->log, UMB_LOG_WARN, event, "reason=%s",
                   umbs_log_quote(error->message, quoted));
}

/* Makes the folder and checks that no other user can change it. */
static enum umb_status open_folder(struct umbs_cache *cache, struct umb_error *error)
{
    char *resolved = NULL;
    const int made = mkdir(cache->path, S_IRWXU) == 0;
    if (!made && errno != EEXIST) {
        return umb_fail_errno(error, UMB_E_CANNOT_CREATE, errno, "cannot create '%.200s'",
                              cache->path);
    }
    enum umb_status status = umbs_private_folder(cache->path, &resolved, error);
    if (status == UMB_OK) {
        free(cache->path);
        cache->path = resolved;
    } else if (made) {
        (void)rmdir(cache->path);
    }
    return status;
}

/*
 * Reads the key. Fails: E_NO_INPUT (there is no key yet), E_CORRUPT (other users can change the
 * file, or it is not a key; a new key must be made), E_IO.
 */
static enum umb_status read_key(const char *path, uint8_t key[UMBS_KEY_BYTES],
                                struct umb_error *error)
{
    struct stat facts;
    uint8_t bytes[UMBS_KEY_BYTES + 1];
    const int fd = open(path, O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC);
    if (fd < 0) {
        return umb_fail_errno(error,
                              errno == ENOENT  ? UMB_E_NO_INPUT
                              : errno == ELOOP ? UMB_E_CORRUPT
                                               : UMB_E_IO,
                              errno, "cannot read '%.200s'", path);
    }
    const int is_key = fstat(fd, &facts) == 0 && umbs_private_file(&facts) &&
                       (facts.st_mode & (S_IRWXG | S_IRWXO)) == 0;
    const ssize_t count = is_key ? read(fd, bytes, sizeof bytes) : 0;
    const int cause = errno;
    (void)close(fd);
    if (count < 0) {
        return umb_fail_errno(error, UMB_E_IO, cause, "cannot read '%.200s'", path);
    }
    if (count != (ssize_t)UMBS_KEY_BYTES) {
        return umb_fail(error, UMB_E_CORRUPT,
                        "'%.200s' is not a key of %u bytes that only its owner may read", path,
                        UMBS_KEY_BYTES);
    }
    memcpy(key, bytes, UMBS_KEY_BYTES);
    return UMB_OK;
}

static enum umb_status make_key(const char *path, uint8_t key[UMBS_KEY_BYTES],
                                struct umb_error *error)
{
    if (getrandom(key, UMBS_KEY_BYTES, 0) != (ssize_t)UMBS_KEY_BYTES) {
        return umb_fail_errno(error, UMB_E_IO, errno, "no random bytes for a key");
    }
    if (unlink(path) != 0 && errno != ENOENT) {
        return umb_fail_errno(error, UMB_E_CANNOT_CREATE, errno, "cannot replace '%.200s'", path);
    }
    return umbu_output_replace(path, UMBU_OUTPUT_PRIVATE, key, UMBS_KEY_BYTES, error);
}

/* Reads the key. If there is no usable key, a daemon with write access makes a new one. */
static enum umb_status take_key(struct umbs_cache *cache, struct umb_error *error)
{
    char path[UMBS_PATH_SIZE];
    umbs__path(path, cache->path, UMBS_CACHE_KEY);
    const enum umb_status status = read_key(path, cache->key, error);
    if (status == UMB_E_CORRUPT) {
        warn(cache, "cache_key_renewed", error);
    }
    return (status == UMB_E_CORRUPT || status == UMB_E_NO_INPUT) && cache->lock.fd >= 0
               ? make_key(path, cache->key, error)
               : status;
}

static void read_records(struct umbs_cache *cache)
{
    struct umbs_records records;
    struct umb_error error;
    size_t refused = 0;
    char path[UMBS_PATH_SIZE];
    umbs__path(path, cache->path, "proven");
    const enum umb_status status = umbs__records_read(path, cache->key, &records, &refused, &error);
    if (status == UMB_OK && refused > 0) {
        (void)umb_fail(&error, UMB_E_CORRUPT, "%zu lines were not written under this key", refused);
    }
    if (status != UMB_OK || refused > 0) {
        warn(cache, "proven_forgotten", &error);
    }
    if (status == UMB_OK) {
        umbs__records_finish(&cache->records);
        cache->records = records;
    }
}

/* Takes the lock unless another daemon has it; without the lock this daemon only reads the cache.
 * On a file system without locks two daemons may write. That does no harm, because files appear
 * complete and their digests are checked. */
static enum umb_status take_lock(struct umbs_cache *cache, struct umb_error *error)
{
    char path[UMBS_PATH_SIZE];
    umbs__path(path, cache->path, "lock");
    const enum umb_status status =
        umbs__owner_lock_take(path, UMBS_REACH_LOCAL, 0, &cache->lock, error);
    if (status == UMB_E_BUSY && !cache->logged_shared) {
        cache->logged_shared = 1;
        warn(cache, "cache_shared", error);
    }
    return status == UMB_E_BUSY ? UMB_OK : status;
}

/* Checks that the folder has not been replaced since it was made ready. */
static enum umb_status look_again(struct umbs_cache *cache, struct umb_error *error)
{
    char *resolved = NULL;
    if (cache->lock.fd >= 0 && !umbs_owner_lock_is_there(&cache->lock)) {
        umbs_owner_lock_release(&cache->lock); /* the file was removed: there may be another */
        cache->ready = 0;
    }
    if (!cache->ready) {
        return UMB_OK;
    }
    enum umb_status status = umbs_private_folder(cache->path, &resolved, error);
    free(resolved);
    return status;
}

/* Makes the folder ready; called with the mutex held. */
static enum umb_status make_ready(struct umbs_cache *cache, struct umb_error *error)
{
    if (!cache->ready) {
        UMB__TRY(open_folder(cache, error));
    }
    UMB__TRY(take_lock(cache, error));
    UMB__TRY(take_key(cache, error));
    read_records(cache);
    cache->ready = 1;
    return UMB_OK;
}

enum umb_status umbs__cache_ready(struct umbs_cache *cache, int *writable, struct umb_error *error)
{
    pthread_mutex_lock(&cache->mutex);
    enum umb_status status = look_again(cache, error);
    if (status == UMB_OK && (!cache->ready || cache->lock.fd < 0)) {
        status = make_ready(cache, error);
        if (status != UMB_OK) {
            umbs_owner_lock_release(&cache->lock);
        }
    }
    if (writable != NULL) {
        *writable = cache->lock.fd >= 0;
    }
    pthread_mutex_unlock(&cache->mutex);
    return status;
}

int umbs__cache_find(struct umbs_cache *cache, const struct umbs_stamp *packed, const uint8_t *id,
                     struct umbs_record *record)
{
    pthread_mutex_lock(&cache->mutex);
    const struct umbs_record *found = packed != NULL ? umbs__records_find(&cache->records, packed)
                                                     : umbs__records_of_id(&cache->records, id);
    if (found != NULL) {
        *record = *found;
    }
    pthread_mutex_unlock(&cache->mutex);
    return found != NULL;
}

void umbs__cache_remember(struct umbs_cache *cache, const struct umbs_record *record)
{
    pthread_mutex_lock(&cache->mutex);
    if (umbs__records_find(&cache->records, &record->packed) == NULL) {
        /* Without memory the file is verified again at the next start. */
        (void)!umbs__records_add(&cache->records, record);
        cache->unwritten = 1;
    }
    pthread_mutex_unlock(&cache->mutex);
}

int umbs__cache_syncs(struct umbs_cache *cache)
{
    pthread_mutex_lock(&cache->mutex);
    const int syncs = cache->built++ < SYNC_EACH_MAX;
    pthread_mutex_unlock(&cache->mutex);
    return syncs;
}

void umbs__cache_made(struct umbs_cache *cache, int synced)
{
    pthread_mutex_lock(&cache->mutex);
    cache->unsynced += !synced;
    pthread_mutex_unlock(&cache->mutex);
}

/*
 * Makes the mapped files durable before a list names them; returns 1 if they are. The caller holds
 * the mutex, which is released during the sync: a sync may take seconds, and other threads ask for
 * paths and records. Files made meanwhile wait for the next sync.
 *
 * The duplicated descriptor shares the open file description of the lock, which is as old as the
 * cache. syncfs reports, once, write errors since a description was opened. After such an error the
 * kernel may have dropped bytes, so no list is written any more.
 */
static int sync_mapped(struct umbs_cache *cache)
{
    struct umb_error error;
    if (cache->unsafe || cache->unsynced == 0) {
        return !cache->unsafe;
    }
    const int fd = fcntl(cache->lock.fd, F_DUPFD_CLOEXEC, 0);
    int cause = errno;
    if (fd >= 0) {
        cache->unsynced = 0;
        pthread_mutex_unlock(&cache->mutex);
        cause = syncfs(fd) == 0 ? 0 : errno;
        (void)close(fd);
        pthread_mutex_lock(&cache->mutex);
        cache->unsafe = cause != 0;
    }
    if (cause != 0) {
        (void)umb_fail_errno(&error, UMB_E_IO, cause, "cannot sync '%.200s'", cache->path);
        warn(cache, "proven_not_kept", &error);
    }
    return cause == 0;
}

static int is_ours(const struct umbs_cache *cache)
{
    return cache->ready && cache->lock.fd >= 0;
}

void umbs__cache_keep(struct umbs_cache *cache, struct umbs_records *records)
{
    struct umb_error error;
    char path[UMBS_PATH_SIZE];
    pthread_mutex_lock(&cache->mutex);
    const int differ = cache->unwritten || !umbs__records_equal(records, &cache->records);
    cache->built = 0;
    /* The lock may be lost during the sync. */
    if (differ && is_ours(cache) && sync_mapped(cache) && is_ours(cache)) {
        umbs__path(path, cache->path, "proven");
        if (umbs__records_write(path, cache->key, records, &error) != UMB_OK) {
            warn(cache, "proven_not_kept", &error);
        }
        struct umbs_records old = cache->records;
        cache->records = *records;
        *records = old;
        cache->unwritten = 0;
    }
    pthread_mutex_unlock(&cache->mutex);
    umbs__records_finish(records);
}

void umbs__cache_file(struct umbs_cache *cache, const uint8_t id[UMB_ID_BYTES],
                      char path[UMBS_PATH_SIZE])
{
    char name[UMB_ID_TEXT_SIZE + 8];
    umb_id_to_text(id, name);
    memcpy(name + UMB_ID_TEXT_SIZE - 1, ".umbm", 6);
    pthread_mutex_lock(&cache->mutex);
    umbs__path(path, cache->path, name);
    pthread_mutex_unlock(&cache->mutex);
}

int umbs__cache_own_folder(struct umbs_cache *cache, char path[UMBS_PATH_SIZE])
{
    pthread_mutex_lock(&cache->mutex);
    const int own = cache->lock.fd >= 0;
    (void)snprintf(path, UMBS_PATH_SIZE, "%s", own ? cache->path : "");
    pthread_mutex_unlock(&cache->mutex);
    return own;
}

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Asset maps: a mapped file with reserved address space after its end, opened and read under the
 * guard.
 *
 * The mapped layout addresses nodes in words and bricks in units of 64 bytes, with 32-bit numbers.
 * They count from a start that is checked when the asset is opened (format/view.h). So no number
 * leads further than REACH_BYTES beyond the map's end. That range is reserved without access, which
 * costs only address space.
 *
 * Opening an asset reads hostile bytes too, so it runs under the guard. A fault would leak the
 * memory of the opening, so its allocator keeps a list of its blocks. Some readers of the open
 * asset also allocate (umb_calibrate), on any thread, so the list has a lock. No file byte is read
 * under that lock.
 */
#define _GNU_SOURCE /* MAP_ANONYMOUS, MAP_NORESERVE, madvise */
#include "store/asset_map.h"

#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/queue.h>
#include <unistd.h>

#include "base/open_status.h"
#include "store/fault_guard.h"
#include "base/try.h"
#include "common/file_system.h"
#include "common/private_folder.h"
#include "common/sha256.h"

/* 2^32 bricks, and a node's end. */
#define REACH_BYTES (((uint64_t)1 << 38) + ((uint64_t)1 << 20))

/* A block that an asset allocated while it was opened. */
struct block {
    LIST_ENTRY(block) link;
    max_align_t bytes[];
};

struct block_list {
    pthread_mutex_t lock;
    LIST_HEAD(, block) blocks;
};

struct umbs_asset_map {
    int fd; /* -1 = the bytes are a copy */
    void *base;
    size_t bytes;    /* size of the file in bytes */
    size_t reserved; /* reserved address space in bytes, from base on; includes the map */
    struct umbs_stamp stamp;
    uint8_t id[UMB_ID_BYTES];
    int has_digest;
    uint8_t digest[UMB_ID_BYTES]; /* SHA-256 of the file, where has_digest */
    struct block_list blocks;
    struct umb_alloc alloc;
    struct umb_asset *asset;
};

struct umbs_stamp umbs_stamp_of(const struct stat *status)
{
    return (struct umbs_stamp){
        .device = (uint64_t)status->st_dev,
        .inode = (uint64_t)status->st_ino,
        .size = (uint64_t)status->st_size,
        .modified = status->st_mtim,
        .changed = status->st_ctim,
    };
}

static int same_time(const struct timespec *a, const struct timespec *b)
{
    return a->tv_sec == b->tv_sec && a->tv_nsec == b->tv_nsec;
}

int umbs_stamp_equal(const struct umbs_stamp *a, const struct umbs_stamp *b)
{
    return a->device == b->device && a->inode == b->inode && a->size == b->size &&
           same_time(&a->modified, &b->modified) && same_time(&a->changed, &b->changed);
}

/* Resizes a block; called with the list's lock held. */
static void *block_renew(struct block_list *list, struct block *old, size_t size)
{
    if (old != NULL) {
        LIST_REMOVE(old, link);
    }
    if (size == 0) {
        free(old);
        return NULL;
    }
    struct block *block = realloc(old, sizeof *block + size);
    struct block *kept = block != NULL ? block : old;
    if (kept != NULL) {
        LIST_INSERT_HEAD(&list->blocks, kept, link);
    }
    return block != NULL ? block->bytes : NULL;
}

/* Resize callback of umb_alloc; user is the list. */
static void *block_resize(void *user, void *bytes, size_t size)
{
    struct block_list *list = user;
    struct block *old =
        bytes != NULL ? (void *)((char *)bytes - offsetof(struct block, bytes)) : NULL;
    if (size > SIZE_MAX - sizeof *old) {
        return NULL;
    }
    (void)pthread_mutex_lock(&list->lock);
    void *renewed = block_renew(list, old, size);
    (void)pthread_mutex_unlock(&list->lock);
    return renewed;
}

/* One attempt to open the bytes, run under the guard. */
struct opening {
    const void *bytes;
    size_t size;
    struct umb_open_options options;
    struct umb_asset *asset;
    struct umb_error error;
    enum umb_status status;
};

static void open_bytes(void *user)
{
    struct opening *opening = user;
    opening->status = umb_asset_open_bytes(opening->bytes, opening->size, &opening->options,
                                           &opening->asset, &opening->error);
}

static enum umb_status has_changed(struct umb_error *error)
{
    return umb_fail(error, UMB_E_CORRUPT, "the mapped file was cut or changed while in use");
}

/* Returns true if the file still has the size and the modification time that it had when it was
 * opened. Deleting or renaming a file changes neither, only its time of change. */
static int is_unchanged(const struct umbs_asset_map *map)
{
    struct stat now;
    return fstat(map->fd, &now) == 0 && (uint64_t)now.st_size == map->stamp.size &&
           same_time(&now.st_mtim, &map->stamp.modified);
}

enum umb_status umbs_asset_map_read_optimistic(const struct umbs_asset_map *map,
                                               void (*read)(void *user), void *user,
                                               struct umb_error *error)
{
    if (map->fd < 0) {
        read(user);
        return UMB_OK;
    }
    return umbs_fault_guarded(map->base, map->reserved, read, user) ? UMB_OK : has_changed(error);
}

enum umb_status umbs_asset_map_revalidate(const struct umbs_asset_map *map, struct umb_error *error)
{
    return map->fd < 0 || is_unchanged(map) ? UMB_OK : has_changed(error);
}

enum umb_status umbs_asset_map_read(const struct umbs_asset_map *map, void (*read)(void *user),
                                    void *user, struct umb_error *error)
{
    UMB__TRY(umbs_asset_map_read_optimistic(map, read, user, error));
    return umbs_asset_map_revalidate(map, error);
}

/* Opens the asset under the guard. In: alloc: an allocator that lists its blocks, so that the
 * caller can free them after a fault. */
static enum umb_status open_guarded(const struct umbs_asset_map *map, enum umb_trust trust,
                                    const struct umb_alloc *alloc, struct umb_asset **asset,
                                    struct umb_error *error)
{
    struct opening opening = {
        .bytes = map->base,
        .size = map->bytes,
        .options = {.trust = trust, .alloc = alloc},
    };
    struct umb_asset_info info;
    UMB__TRY(umbs_asset_map_read(map, open_bytes, &opening, error));
    if (opening.status != UMB_OK) {
        return umb_fail(error, opening.status, "%s", opening.error.message);
    }
    umb_asset_get_info(opening.asset, &info);
    if (info.encoding != UMB_ENCODING_MAPPED || memcmp(info.id, map->id, UMB_ID_BYTES) != 0) {
        return umb_fail(error, UMB_E_CORRUPT, "the mapped file is of another asset");
    }
    *asset = opening.asset;
    return UMB_OK;
}

static void free_blocks(struct block_list *list)
{
    struct block *block;
    while ((block = LIST_FIRST(&list->blocks)) != NULL) {
        LIST_REMOVE(block, link);
        free(block);
    }
}

/* Opens the file and records its stamp. */
static enum umb_status open_file(struct umbs_asset_map *map, const char *path, int ours,
                                 struct umb_error *error)
{
    struct stat facts;
    map->fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY | (ours ? O_NOFOLLOW : 0));
    if (map->fd < 0) {
        return umb_fail_errno(error, umb__open_status(errno), errno, "%.200s", path);
    }
    if (fstat(map->fd, &facts) != 0) {
        return umb_fail_errno(error, UMB_E_IO, errno, "%.200s", path);
    }
    if (!S_ISREG(facts.st_mode) || facts.st_size == 0 || (uint64_t)facts.st_size > SIZE_MAX / 2) {
        return umb_fail(error, UMB_E_CORRUPT, "%.200s: no file of a size that can be mapped", path);
    }
    if (ours && !umbs_private_file(&facts)) {
        return umb_fail(error, UMB_E_PERMISSION,
                        "other users may write to it, or it has a second name: '%.200s'", path);
    }
    map->bytes = (size_t)facts.st_size;
    map->stamp = umbs_stamp_of(&facts);
    return UMB_OK;
}

/*
 * Maps the file at the start of a reserved range. If that much address space is not available
 * (RLIMIT_AS, some sanitizers), the range is the map alone. The process then still survives every
 * fault inside the map, but numbers of a file that is being overwritten may lead out of the range.
 */
static enum umb_status map_file(struct umbs_asset_map *map, struct umb_error *error)
{
    size_t page = (size_t)sysconf(_SC_PAGESIZE);
    size_t whole = (map->bytes + page - 1) / page * page;
    size_t reserved = whole + (size_t)REACH_BYTES;
    void *base =
        mmap(NULL, reserved, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
    if (base != MAP_FAILED) {
        map->base = base;
        map->reserved = reserved;
        base = mmap(base, map->bytes, PROT_READ, MAP_SHARED | MAP_FIXED, map->fd, 0);
    } else {
        base = mmap(NULL, map->bytes, PROT_READ, MAP_SHARED, map->fd, 0);
        map->reserved = whole;
    }
    if (base == MAP_FAILED) {
        return umb_fail_errno(error, UMB_E_IO, errno, "cannot map %zu bytes", map->bytes);
    }
    map->base = base;
    return UMB_OK;
}

/* Reads the file into memory of this process, closes the file and write-protects the memory. */
static enum umb_status copy_file(struct umbs_asset_map *map, struct umb_error *error)
{
    void *base = mmap(NULL, map->bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (base == MAP_FAILED) {
        return umb_fail_errno(error, UMB_E_NO_MEMORY, errno, "no memory for a copy of %zu bytes",
                              map->bytes);
    }
    map->base = base;
    map->reserved = map->bytes;
    (void)madvise(base, map->bytes, MADV_HUGEPAGE); /* a hint: huge pages give fewer TLB misses */
    const ssize_t count = umbs_read_full(map->fd, base, map->bytes);
    if (count != (ssize_t)map->bytes) {
        return count < 0
                   ? umb_fail_errno(error, UMB_E_IO, errno, "cannot copy %zu bytes", map->bytes)
                   : has_changed(error);
    }
    if (mprotect(base, map->bytes, PROT_READ) != 0) {
        return umb_fail_errno(error, UMB_E_IO, errno, "cannot protect a copy");
    }
    umbs_hang_up(&map->fd);
    return UMB_OK;
}

/* Advises the kernel of random access, so that read-ahead does not push out pages that are needed.
 * For an asset four times as large as memory, this halves the slowest calls
 * (tests/system/larger_than_memory.py). A copy in memory needs no advice. */
static void advise(const struct umbs_asset_map *map, int advice)
{
    if (map->fd >= 0) {
        (void)posix_madvise(map->base, map->bytes, advice);
    }
}

#define PIECE_BYTES ((size_t)1 << 20) /* bytes read at a time for the hash */

/* Computes the SHA-256 of the file, or of the copy. It reads the file and not the map, so a file
 * that is cut short gives an error and no fault. */
static enum umb_status hash_file(const struct umbs_asset_map *map, uint8_t digest[UMB_ID_BYTES],
                                 struct umb_error *error)
{
    struct umbs_sha256_run run;
    uint8_t *piece = malloc(PIECE_BYTES);
    size_t have = 0;
    ssize_t count = 1;
    if (piece == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory to check a mapped file");
    }
    umbs_sha256_begin(&run);
    while (have < map->bytes && count > 0) {
        const size_t part = map->bytes - have < PIECE_BYTES ? map->bytes - have : PIECE_BYTES;
        count = pread(map->fd, piece, part, (off_t)have);
        if (count < 0 && errno == EINTR) {
            count = 1;
            continue;
        }
        umbs_sha256_add(&run, piece, count > 0 ? (size_t)count : 0);
        have += count > 0 ? (size_t)count : 0;
    }
    const int cause = errno;
    free(piece);
    umbs_sha256_end(&run, digest);
    return count > 0    ? UMB_OK
           : count == 0 ? has_changed(error)
                        : umb_fail_errno(error, UMB_E_IO, cause, "cannot read a mapped file");
}

/* Compares the bytes with the expected digest, if there is one. */
static enum umb_status check_digest(const struct umbs_asset_map *map, struct umb_error *error)
{
    uint8_t digest[UMB_ID_BYTES];
    if (!map->has_digest) {
        return UMB_OK;
    }
    if (map->fd < 0) {
        umbs_sha256_bytes(map->base, map->bytes, digest);
    } else {
        UMB__TRY(hash_file(map, digest, error));
    }
    if (!umbs_digest_equal(digest, map->digest)) {
        return umb_fail(error, UMB_E_CORRUPT,
                        "the mapped file is not the one that was made for this asset");
    }
    return UMB_OK;
}

/* Opens the file and its asset. Checks all bytes, or only the head if the file has a known
 * stamp. */
static enum umb_status open_checked(struct umbs_asset_map *map, const char *path,
                                    const struct umbs_asset_map_options *options,
                                    struct umb_error *error)
{
    UMB__TRY(open_file(map, path, options->ours, error));
    UMB__TRY(options->copy ? copy_file(map, error) : map_file(map, error));
    const int known =
        options->known != NULL && !options->copy && umbs_stamp_equal(options->known, &map->stamp);
    if (!known) {
        UMB__TRY(check_digest(map, error));
    }
    return open_guarded(map, known ? UMB_TRUST_VALIDATED : UMB_TRUST_NOTHING, &map->alloc,
                        &map->asset, error);
}

enum umb_status umbs_asset_map_open(const char *path, const struct umbs_asset_map_options *options,
                                    struct umbs_asset_map **out, struct umb_error *error)
{
    *out = NULL;
    struct umbs_asset_map *map = calloc(1, sizeof *map);
    if (map == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a mapping");
    }
    map->blocks = (struct block_list){.lock = PTHREAD_MUTEX_INITIALIZER};
    map->alloc = (struct umb_alloc){.resize = block_resize, .user = &map->blocks};
    memcpy(map->id, options->id, UMB_ID_BYTES);
    map->has_digest = options->digest != NULL;
    if (map->has_digest) {
        memcpy(map->digest, options->digest, UMB_ID_BYTES);
    }
    umbs_fault_guard_install();
    const enum umb_status status = open_checked(map, path, options, error);
    if (status != UMB_OK) {
        umbs_asset_map_close(map);
        return status;
    }
    advise(map, options->warm ? POSIX_MADV_WILLNEED : POSIX_MADV_RANDOM);
    *out = map;
    return UMB_OK;
}

void umbs_asset_map_close(struct umbs_asset_map *map)
{
    if (map == NULL) {
        return;
    }
    umb_asset_close(map->asset);
    free_blocks(&map->blocks);
    (void)pthread_mutex_destroy(&map->blocks.lock);
    if (map->base != NULL) {
        munmap(map->base, map->reserved);
    }
    umbs_hang_up(&map->fd);
    free(map);
}

const struct umb_asset *umbs_asset_map_asset(const struct umbs_asset_map *map)
{
    return map->asset;
}

int umbs_asset_map_is_copy(const struct umbs_asset_map *map)
{
    return map->fd < 0;
}

const struct umbs_stamp *umbs_asset_map_stamp(const struct umbs_asset_map *map)
{
    return &map->stamp;
}

const uint8_t *umbs_asset_map_digest(const struct umbs_asset_map *map)
{
    return map->has_digest ? map->digest : NULL;
}

enum umb_status umbs_asset_map_check(const struct umbs_asset_map *map, struct umb_error *error)
{
    if (map->has_digest) {
        UMB__TRY(check_digest(map, error));
        return umbs_asset_map_revalidate(map, error);
    }
    struct block_list blocks = {.lock = PTHREAD_MUTEX_INITIALIZER};
    struct umb_alloc alloc = {.resize = block_resize, .user = &blocks};
    struct umb_asset *asset = NULL;
    advise(map, POSIX_MADV_SEQUENTIAL);
    enum umb_status status = open_guarded(map, UMB_TRUST_NOTHING, &alloc, &asset, error);
    advise(map, POSIX_MADV_RANDOM);
    free_blocks(&blocks); /* every allocation of the asset */
    return status;
}

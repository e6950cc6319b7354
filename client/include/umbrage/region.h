/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_REGION_H
#define UMBRAGE_REGION_H
/*
 * libumbrage: regions. A program fetches the part of an asset that it needs, and answers queries
 * from it locally.
 *
 *     struct umb_region *region;
 *     enum umb_status status = umb_region_open(&source, NULL, &region, &error);  // reads 16 KiB
 *     if (status == UMB_OK) {
 *         status = umb_region_update(region, &request, &error);  // fetches what a camera sees
 *     }
 *     if (status == UMB_OK) {
 *         status = umb_region_query(region, &settings, &points, 0, &answers, &error);
 *     }
 *     umb_region_close(region);
 *
 * A source gives ranges of a packed file: a local file, a web server, a daemon. Coarse pages come
 * first, then those of the greatest benefit a byte, each proven against the id. umbrage/partial.h
 * explains answers and their bounds. No page is fetched twice unless the memory budget dropped it.
 *
 * Ownership: a region copies its arguments. The source behind `user` must outlive it.
 * Threads: one at a time; between two updates any number may query (with want = 0).
 * Blocking: open and update wait for the source.
 * Trust: a hostile source can fail calls and waste time, but not crash the program or change
 * answers: every page is proven against options.id. Without an id the source chooses the asset.
 * Stability: stable; umbrage/version.h says what that means.
 */
#include <stddef.h>
#include <stdint.h>
#include "umbrage/partial.h"

#ifdef __cplusplus
extern "C" {
#endif

struct umb_client;       /* umbrage/client.h */
struct umb_client_async; /* umbrage/client.h */
struct umb_region;       /* opaque */

/* A byte range of the packed file. */
struct umb_range {
    uint64_t offset, length;
};

/*
 * Called with the bytes of one range.
 *
 * In:    index: position in the requested ranges. bytes: uint8[size], borrowed; shorter than
 *        requested only at the end of the file.
 * Returns UMB_OK to go on; any other status makes the source stop and return that status.
 */
typedef enum umb_status (*umb_range_fn)(void *user, size_t index, const void *bytes, size_t size);

/* Fill in `read` or `read_at`. */
struct umb_region_source {
    /*
     * Reads ranges, in any order or several at once, and calls `got` exactly once for each range. A
     * read that fails may first call `got` for complete ranges, which are not requested again.
     *
     * Fails: E_UNAVAILABLE, E_NO_INPUT, E_IO, E_PROTOCOL, E_DEADLINE, or the status that got
     *        returned.
     */
    enum umb_status (*read)(void *user, const struct umb_range *ranges, size_t count,
                            umb_range_fn got, void *got_user, struct umb_error *error);
    void *user; /* First argument of `read` and `read_at` */
    /*
     * Called if `read` is NULL: reads 1 to `size` bytes of the file at `offset`, and sets *got to
     * their number, 0 at the end of the file. The region asks again for the rest of a range.
     *
     * Fails: as `read`.
     */
    enum umb_status (*read_at)(void *user, uint64_t offset, void *bytes, size_t size, size_t *got,
                               struct umb_error *error);
    uint64_t reserved[3]; /* Zero: room for later versions (umbrage/version.h) */
};

struct umb_region_options {
    const uint8_t *id;         /* uint8[UMB_ID_BYTES], the id to require; NULL: any */
    uint64_t max_memory_bytes; /* Memory budget of the whole region; 0 = 1 GiB */
    uint64_t first_bytes;      /* Length of the first read; 0 = 16 KiB */
    uint64_t reserved[4];      /* Zero: room for later versions (umbrage/version.h) */
};

/* Counts since the region was opened. */
struct umb_region_stats {
    struct umb_partial_stats partial;
    uint64_t received_bytes; /* Bytes from the source, head included */
    uint64_t requests;       /* Ranges requested */
    uint64_t rounds;         /* Reads of the source that the region waited for */
    uint64_t pages_received;
    uint64_t reserved[4]; /* Zero: room for later versions (umbrage/version.h) */
};

/*
 * Called after new pages have been laid out; it may query the region.
 * Returns UMB_OK to go on; any other status stops the update, which returns it.
 */
typedef enum umb_status (*umb_region_fn)(void *user, struct umb_region *region);

struct umb_region_request {
    const struct umb_partial_view *views; /* [view_count], the views to fetch, all of them */
    size_t view_count;
    uint64_t max_bytes;     /* Bytes to receive before the update stops; 0 = no limit */
    uint64_t round_bytes;   /* Bytes to receive until pages are laid out, approximately; 0 = a
                               quarter of the bytes held, at least 512 KiB */
    umb_region_fn progress; /* Called after each round; may be NULL */
    void *progress_user;    /* First argument of `progress` */
    uint64_t reserved[4];   /* Zero: room for later versions (umbrage/version.h) */
};

/*
 * Opens the asset of a source: reads its head, and the coarse pages behind it as far as the first
 * read reaches.
 *
 * In:    options: NULL for the defaults.
 * Out:   out: the region, which answers every point with bounds; NULL on failure.
 * Owns:  the caller closes it with umb_region_close.
 * Fails: as the source, umb_partial_open and umb_partial_add.
 * Cost:  one read, two if the head is longer than first_bytes.
 */
UMB_API UMB_CHECKED enum umb_status umb_region_open(const struct umb_region_source *source,
                                                    const struct umb_region_options *options,
                                                    struct umb_region **out,
                                                    struct umb_error *error);

/*
 * Opens a region from a partial file that umb_partial_save wrote. The first umb_region_update reads
 * 128 bytes of the source to compare the asset; another asset is E_CORRUPT there.
 *
 * In:    bytes: uint8[size]. The rest as umb_region_open.
 * Fails: as umb_partial_open_saved.
 */
UMB_API UMB_CHECKED enum umb_status umb_region_resume(const void *bytes, size_t size,
                                                      const struct umb_region_source *source,
                                                      const struct umb_region_options *options,
                                                      struct umb_region **out,
                                                      struct umb_error *error);

/* Frees a region. NULL is allowed. */
UMB_API void umb_region_close(struct umb_region *region);

/*
 * Fetches missing pages that the views need. Stops when none is missing, when max_bytes is reached,
 * or when the missing pages do not fit the memory budget.
 *
 * In:    request: NULL fetches the whole asset. view_count 0 fetches the pages that queries with
 *        want = 1 missed since the last update.
 * Fails: E_ARGUMENT (views), as the source or progress, E_CORRUPT (the page is named). Pages
 *        received before stay and are laid out.
 */
UMB_API UMB_CHECKED enum umb_status umb_region_update(struct umb_region *region,
                                                      const struct umb_region_request *request,
                                                      struct umb_error *error);

/*
 * Moves a region to another version of its asset. Pages whose hash the new version names are not
 * read again: see umb_partial_inherit. Those of the first block of the directory answer when the
 * call returns, the others as later updates read their blocks.
 *
 * In:    source: source of the new version, which the region uses from now on; NULL: the region's
 *        own, which gives the new version now.
 *        options: NULL for the defaults. id: version to require. max_memory_bytes: 0 = as before.
 *        first_bytes: 0 = as many as the head and the first block of the old version have.
 * Fails: as umb_region_open and umb_partial_inherit; the region is then unchanged. E_NO_MEMORY of
 *        the layout: the region has the new version, and the next update lays it out.
 * Cost:  as umb_region_open, and linear in the pages of the first block that the region holds. The
 *        head and the first pages of the new version take memory beside the old version until the
 *        call returns: each of the two stays within max_memory_bytes.
 */
UMB_API UMB_CHECKED enum umb_status umb_region_retarget(struct umb_region *region,
                                                        const struct umb_region_source *source,
                                                        const struct umb_region_options *options,
                                                        struct umb_error *error);

/* Answers points from the held pages; see umb_partial_query. */
UMB_API UMB_CHECKED enum umb_status umb_region_query(struct umb_region *region,
                                                     const struct umb_query_settings *settings,
                                                     const struct umb_points *points, int want,
                                                     struct umb_partial_answers *answers,
                                                     struct umb_error *error);

/* Fills in stats. Never fails. */
UMB_API void umb_region_get_stats(const struct umb_region *region, struct umb_region_stats *stats);

/* Returns the region's partial asset, to save it; borrowed until close. */
UMB_API struct umb_partial *umb_region_partial(struct umb_region *region);

/* Returns a SHA-256 by OpenSSL, for umbrage/partial.h and umbrage/file.h. It has no state: any
 * number of threads may use it. */
UMB_API const struct umb_sha256 *umb_sha256_openssl(void);

/* Reads bytes of a source's file into `bytes`, by whichever of its functions it has. Out: got:
 * number of bytes read; fewer than `size` only at the end of the file. Fails: as the source. */
UMB_API UMB_CHECKED enum umb_status umb_region_source_read(const struct umb_region_source *source,
                                                           uint64_t offset, void *bytes,
                                                           size_t size, size_t *got,
                                                           struct umb_error *error);

/* Reads the id of the asset that a source gives now: 128 bytes of its file. A program that polls a
 * file or a web server sees by it that there is a new version. Fails: as the source and
 * umb_file_read_head. */
UMB_API UMB_CHECKED enum umb_status umb_region_source_id(const struct umb_region_source *source,
                                                         uint8_t id[UMB_ID_BYTES],
                                                         struct umb_error *error);

/*
 * Opens a source that reads a local packed file.
 *
 * Owns:  the caller closes it with umb_region_file_close, after the regions that use it.
 * Fails: E_NO_INPUT, E_PERMISSION, E_NO_MEMORY.
 */
UMB_API UMB_CHECKED enum umb_status
umb_region_file_open(const char *path, struct umb_region_source *source, struct umb_error *error);
UMB_API void umb_region_file_close(struct umb_region_source *source);

/*
 * Opens a source that reads from a daemon (Regions.Stream). A round of pages takes one round trip.
 *
 * In:    client: borrowed until close.
 *        asset: name or id, copied. A name stands for the asset that answers the first read: when
 *        the daemon replaces that asset, later reads fail with E_STATE.
 * Owns:  the caller closes it with umb_region_daemon_close, after the regions that use it.
 * Fails: E_ARGUMENT, E_NO_MEMORY. Reads of the source fail as umb_client_query does.
 */
UMB_API UMB_CHECKED enum umb_status umb_region_daemon_open(struct umb_client *client,
                                                           const char *asset,
                                                           struct umb_region_source *source,
                                                           struct umb_error *error);
UMB_API void umb_region_daemon_close(struct umb_region_source *source);

/* Called with a version of a watched asset, on the client's thread. In: file_bytes: length of its
 * packed file. The callback returns 0 to stop watching, else nonzero. */
typedef int (*umb_version_fn)(void *user, const uint8_t id[UMB_ID_BYTES], uint64_t file_bytes);

/*
 * Watches which version of an asset a daemon has: calls on_version at once, and then for each new
 * version, about a second after the daemon has loaded it. A program that is told of another version
 * than its region's opens a source of it and calls umb_region_retarget, on another thread.
 *
 * In:    asset: name. timeout_ms: time after which the call ends; 0: 49 days.
 *        async: NULL to wait; umb_client_async as for other calls.
 * Fails: E_NOT_FOUND (no such asset, or no more), E_CORRUPT (the new file is damaged),
 *        E_CANCELLED (on_version returned 0), E_DEADLINE, E_UNAVAILABLE (the daemon shuts down).
 */
UMB_API UMB_CHECKED enum umb_status umb_client_watch_asset(struct umb_client *client,
                                                           const char *asset, uint32_t timeout_ms,
                                                           umb_version_fn on_version, void *user,
                                                           struct umb_client_async *async,
                                                           struct umb_error *error);

#ifdef __cplusplus
}
#endif
#endif

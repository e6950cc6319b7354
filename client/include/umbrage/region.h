/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_REGION_H
#define UMBRAGE_REGION_H
/*
 * libumbrage: streaming the part of an asset that one needs, and evaluating it here.
 *
 *     struct umb_region *region;
 *     enum umb_status status = umb_region_open(&source, NULL, &region, &error);  // reads 32 KiB
 *     if (status == UMB_OK) {
 *         status = umb_region_update(region, &request, &error);  // fetches what a camera sees
 *     }
 *     if (status == UMB_OK) {
 *         status = umb_region_query(region, &settings, &points, 0, &answers, &error);
 *     }
 *     umb_region_close(region);
 *
 * A source gives ranges of a packed file: a local file, a web server, a daemon. Pages come coarse
 * first, the greatest benefit a byte first, each proven against the id (umbrage/partial.h says how
 * answers and bounds come about). No page is fetched twice unless the memory budget dropped it.
 *
 * Ownership: a region copies what it is given, but for the source, which must live as long.
 * Threads: one at a time; between two updates any number may query (with want = 0).
 * Blocking: open and update wait for the source.
 * Trust: a hostile source can fail calls and waste time, not crash or lie: what it sends is proven
 * against options.id; without an id only against what it says of itself.
 * Stability: stable; umbrage/version.h says what that means.
 */
#include <stddef.h>
#include <stdint.h>
#include "umbrage/partial.h"

#ifdef __cplusplus
extern "C" {
#endif

struct umb_client; /* umbrage/client.h */
struct umb_region; /* opaque */

/* A byte range of the packed file. */
struct umb_range {
    uint64_t offset, length;
};

/*
 * Takes one range that came.
 *
 * In:    index: into the ranges that were asked for. bytes: uint8[size], borrowed; shorter than
 *        asked only where the file ends.
 * Returns UMB_OK to go on, else the source stops and hands it back.
 */
typedef enum umb_status (*umb_range_fn)(void *user, size_t index, const void *bytes, size_t size);

struct umb_region_source {
    /*
     * Reads ranges, in their order or any other, several at once if it likes, and gives each to
     * `got` exactly once; on failure those that came whole, which are then not asked for again.
     *
     * Fails: E_UNAVAILABLE, E_NO_INPUT, E_IO, E_PROTOCOL, E_DEADLINE, or what got returned.
     */
    enum umb_status (*read)(void *user, const struct umb_range *ranges, size_t count,
                            umb_range_fn got, void *got_user, struct umb_error *error);
    void *user;
    uint64_t reserved[4]; /* Zero: room for later versions (umbrage/version.h) */
};

struct umb_region_options {
    const uint8_t *id;         /* uint8[UMB_ID_BYTES] to insist on; NULL: any */
    uint64_t max_memory_bytes; /* of everything the region keeps; 0 = 1 GiB */
    uint64_t first_bytes;      /* how much to read at first; 0 = 32 KiB */
    uint64_t reserved[4]; /* Zero: room for later versions (umbrage/version.h) */
};

/* What has come so far; see umb_region_request. */
struct umb_region_stats {
    struct umb_partial_stats partial;
    uint64_t received_bytes; /* from the source, head included */
    uint64_t requests;       /* ranges asked for */
    uint64_t rounds;         /* times the source was asked and waited for */
    uint64_t pages_received;
    uint64_t reserved[4]; /* Zero: room for later versions (umbrage/version.h) */
};

/*
 * Called whenever new pages have been laid out; the region may be queried in it.
 * Returns UMB_OK to go on, anything else to stop the update, which returns it.
 */
typedef enum umb_status (*umb_region_fn)(void *user, struct umb_region *region);

struct umb_region_request {
    const struct umb_partial_view *views; /* [view_count] all of which are wanted */
    size_t view_count;
    uint64_t max_bytes;   /* stop after receiving as many; 0 = no limit */
    uint64_t round_bytes; /* at most about as many before pages are laid out; 0 = chosen: a quarter
                             of what is here, at least 512 KiB */
    umb_region_fn progress; /* may be NULL */
    void *progress_user;
    uint64_t reserved[4]; /* Zero: room for later versions (umbrage/version.h) */
};

/*
 * Opens the asset of a source: reads its head, and the coarse pages behind it as far as the first
 * read reaches.
 *
 * Out:   out: the region, laid out: it answers every point, with bounds; NULL on failure.
 * Fails: what the source fails with, as umb_partial_open and umb_partial_add.
 * Cost:  one read, two if the head is longer than first_bytes.
 */
UMB_API UMB_CHECKED enum umb_status umb_region_open(const struct umb_region_source *source,
                                                    const struct umb_region_options *options,
                                                    struct umb_region **out,
                                                    struct umb_error *error);

/*
 * Opens a partial file that umb_partial_save wrote, to go on from; nothing is read from the source
 * until umb_region_update, whose first read (128 bytes) finds out whether it is the same asset's:
 * else E_CORRUPT. bytes: uint8[size], copied.
 */
UMB_API UMB_CHECKED enum umb_status umb_region_resume(const void *bytes, size_t size,
                                                      const struct umb_region_source *source,
                                                      const struct umb_region_options *options,
                                                      struct umb_region **out,
                                                      struct umb_error *error);

/* Frees a region. NULL is allowed. */
UMB_API void umb_region_close(struct umb_region *region);

/*
 * Fetches what the views need and is not here, until nothing is missing, the limit is reached or
 * what is missing does not fit the memory budget.
 *
 * In:    view_count 0: what queries with want = 1 have missed since the last update.
 * Fails: E_ARGUMENT (views), what the source or progress fails with, E_CORRUPT (the page is named).
 *        What came before stays, laid out.
 */
UMB_API UMB_CHECKED enum umb_status umb_region_update(struct umb_region *region,
                                                      const struct umb_region_request *request,
                                                      struct umb_error *error);

/* Answers points from what is here; see umb_partial_query. */
UMB_API UMB_CHECKED enum umb_status umb_region_query(struct umb_region *region,
                                                     const struct umb_query_settings *settings,
                                                     const struct umb_points *points, int want,
                                                     struct umb_partial_answers *answers,
                                                     struct umb_error *error);

UMB_API void umb_region_get_stats(const struct umb_region *region, struct umb_region_stats *stats);

/* The partial asset inside, borrowed until close: for saving. */
UMB_API struct umb_partial *umb_region_partial(struct umb_region *region);

/* A SHA-256 without state, by OpenSSL, for umbrage/partial.h and umbrage/file.h. Threads: any. */
UMB_API const struct umb_sha256 *umb_sha256_openssl(void);

/* A source that reads a local packed file. Fails: E_NO_INPUT, E_PERMISSION, E_NO_MEMORY. Close it
 * after the regions that use it. */
UMB_API UMB_CHECKED enum umb_status
umb_region_file_open(const char *path, struct umb_region_source *source, struct umb_error *error);
UMB_API void umb_region_file_close(struct umb_region_source *source);

/*
 * A source that asks a daemon (Regions.Stream). A round of pages takes one round trip.
 *
 * In:    client: borrowed until close. asset: name or id, copied; by name, the version that answers
 *        first is the one that must answer then: E_STATE if it was replaced.
 * Fails: E_ARGUMENT, E_NO_MEMORY. Its reads fail as umb_client_query does.
 */
UMB_API UMB_CHECKED enum umb_status umb_region_daemon_open(struct umb_client *client,
                                                           const char *asset,
                                                           struct umb_region_source *source,
                                                           struct umb_error *error);
UMB_API void umb_region_daemon_close(struct umb_region_source *source);

#ifdef __cplusplus
}
#endif
#endif

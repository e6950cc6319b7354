/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CLI_CLI_VOLUME_ASSET_H
#define UMBRAGE_CLI_CLI_VOLUME_ASSET_H
/*
 * The asset that answers segments, columns and boxes: a file, which answers in this process, or a
 * daemon's asset, in calls of the size that the daemon takes.
 *
 *     open;  segments, columns or boxes, batch by batch;  close.
 */
#include "cli_query_options.h"
#include "cli_record_progress.h"
#include "umbrage/client.h"
#include "umbrage/volume.h"

struct umbc_volume_asset {
    const struct umbc_query_options *options; /* borrowed */
    size_t batch_size;                        /* records of a batch */
    struct umb_asset *file;                   /* the file's asset; NULL: a daemon's */
    bool bad_file;                            /* true: the file could not be opened */
    struct umb_volume volume;
    struct umb_frustum_info frustum; /* frustum of the light, for boxes */
    double origin[3];                /* origin of the asset */
    struct umb_box *boxes;           /* [batch_size] */
    struct umb_client *client;       /* connection to the daemon; NULL: a file */
    struct umb_client_limits limits; /* limits of the daemon */
    bool has_id;                     /* true: the daemon has answered once */
    uint8_t id[UMB_ID_BYTES];
    bool ignores_translucent;
};

/* Opens the file or the daemon's asset. Close it also after a failure. */
UMB_CHECKED enum umb_status umbc_volume_open(const struct umbc_query_options *options,
                                             struct umbc_volume_asset *asset,
                                             struct umb_error *error);
void umbc_volume_close(struct umbc_volume_asset *asset);

/*
 * Answers a batch.
 *
 * In:    progress: gets the number of answered records of a file; may be NULL.
 * Out:   answers: the caller's arrays; the batch's counts are added to the sums in answers.
 * Fails: E_ARGUMENT (bad numbers, of a file); E_CANCELLED (the daemon replaced its asset since the
 *        batch before); else as the client does.
 */
UMB_CHECKED enum umb_status umbc_volume_segments(struct umbc_volume_asset *asset,
                                                 const struct umb_segments *segments,
                                                 struct umbc_record_progress *progress,
                                                 struct umb_segment_answers *answers,
                                                 struct umb_error *error);
UMB_CHECKED enum umb_status umbc_volume_columns(struct umbc_volume_asset *asset,
                                                const struct umb_points *points,
                                                struct umbc_record_progress *progress,
                                                struct umb_column_answers *answers,
                                                struct umb_error *error);
UMB_CHECKED enum umb_status umbc_volume_boxes(struct umbc_volume_asset *asset,
                                              const struct umb_segments *corners,
                                              struct umbc_record_progress *progress,
                                              struct umb_box_answers *answers,
                                              struct umb_error *error);

#define UMBC_INTERVALS_KEPT 16 /* lit intervals that a batch keeps of each segment */

/*
 * Segments of a batch with more lit intervals than it keeps. They are asked again with room for all
 * intervals, many in one call.
 *
 *     {.segments = batch, .answers = answers of the batch}; next for each long segment; finish.
 */
struct umbc_long_segments {
    const struct umb_segments *segments;       /* segments of the batch, borrowed */
    const struct umb_segment_answers *answers; /* their answers, borrowed */
    /* The segments of the present call; zero at first. */
    uint8_t *ends;
    struct umb_segment_answers again;
    size_t count, next; /* number of them; number of the first that was not given out */
};

/*
 * Gives the whole answer of segment i, which has more than UMBC_INTERVALS_KEPT intervals and
 * follows those of earlier calls.
 *
 * Out:   answer, intervals: borrowed until the next call.
 * Fails: as umbc_volume_segments; E_NO_MEMORY; E_PROTOCOL (a daemon sends more intervals than it
 *        announced).
 */
UMB_CHECKED enum umb_status umbc_longs_next(struct umbc_long_segments *longs,
                                            struct umbc_volume_asset *asset, size_t i,
                                            const struct umb_segment_answer **answer,
                                            const struct umb_interval **intervals,
                                            struct umb_error *error);
void umbc_longs_finish(struct umbc_long_segments *longs);

#endif

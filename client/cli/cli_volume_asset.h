/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CLI_CLI_VOLUME_ASSET_H
#define UMBRAGE_CLI_CLI_VOLUME_ASSET_H
/*
 * The asset that segments, columns and boxes are asked of: one of a file, here and now, or one of a
 * daemon, in calls of as much as it takes.
 *
 *     open;  segments, columns or boxes, batch by batch;  close.
 */
#include "cli_query_options.h"
#include "cli_record_progress.h"
#include "umbrage/client.h"
#include "umbrage/volume.h"

struct umbc_volume_asset {
    const struct umbc_query_options *options; /* borrowed */
    size_t batch_size;                        /* records asked together */
    struct umb_asset *file;                   /* of a file ... */
    bool bad_file;                            /* ... that could not be opened, */
    struct umb_volume volume;
    struct umb_frustum_info frustum; /* the light's, for boxes */
    double origin[3];                /* the asset's */
    struct umb_box *boxes;           /* [batch_size] */
    struct umb_client *client;       /* or of a daemon, */
    struct umb_client_limits limits; /* which takes so much */
    bool has_id;                     /* the daemon has answered once */
    uint8_t id[UMB_ID_BYTES];
    bool ignores_translucent;
};

/* Opens what the options name. On failure `asset` is still to be closed. */
UMB_CHECKED enum umb_status umbc_volume_open(const struct umbc_query_options *options,
                                             struct umbc_volume_asset *asset,
                                             struct umb_error *error);
void umbc_volume_close(struct umbc_volume_asset *asset);

/*
 * Answers a batch.
 *
 * In:    progress: told what of a file's batch is done; NULL: nothing is.
 * Out:   answers: with memory of the caller; what they add up is added to.
 * Fails: E_ARGUMENT (bad numbers in a file's batch); E_CANCELLED (the daemon's asset is another one
 *        than that of the batch before); else as the client does.
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

#endif

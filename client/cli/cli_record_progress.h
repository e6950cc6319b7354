/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CLI_CLI_RECORD_PROGRESS_H
#define UMBRAGE_CLI_CLI_RECORD_PROGRESS_H
/*
 * The progress line of segments, columns and boxes, of which one alone may take long: the share
 * that is done counts the one under way in parts.
 *
 *     begin;  after each read: batch;  while it is answered: show, as often as you like;  end.
 */
#include "cli_points.h"
#include "tool/progress.h"
#include "umbrage/asset.h"
#include "umbrage/volume.h"

struct umbc_record_progress {
    struct umbu_progress line;
    const struct umbc_points *source; /* borrowed */
    uint64_t done;                    /* records of earlier batches */
    uint64_t begin;                   /* bytes of the source that these took */
    size_t count;                     /* records of this batch */
};

/* In: unit: what records are called, many of them; source: borrowed until the end. */
void umbc_records_begin(struct umbc_record_progress *progress, const char *unit, bool quiet,
                        const struct umbc_points *source);
/* The source has given `count` more records. */
void umbc_records_batch(struct umbc_record_progress *progress, size_t count);
/* So many records of the batch are answered, the one under way as a part of one. */
void umbc_records_show(struct umbc_record_progress *progress, double answered);
void umbc_records_end(struct umbc_record_progress *progress);

/*
 * About how many voxels of a directional light's frustum a box holds, to some percent: what is
 * counted so far is a share of that.
 *
 * In: origin: the asset's.
 */
double umbc_box_voxels(const struct umb_frustum_info *frustum, const double origin[3],
                       const struct umb_box *box);

#endif

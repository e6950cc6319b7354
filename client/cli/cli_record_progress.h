/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CLI_CLI_RECORD_PROGRESS_H
#define UMBRAGE_CLI_CLI_RECORD_PROGRESS_H
/*
 * The progress line of segments, columns and boxes. One record alone may take long, so the answered
 * share counts the part of the current record that is done.
 *
 * Order of the calls: begin; then, for each batch read, `batch`, and `show` as often as wanted
 * while it is answered; last, end.
 */
#include "cli/shared/cli_points.h"
#include "tool/progress.h"
#include "umbrage/asset.h"
#include "umbrage/volume.h"

struct umbc_record_progress {
    struct umbu_progress line;
    const struct umbc_points *source; /* borrowed */
    uint64_t done;                    /* number of records of earlier batches */
    uint64_t begin;                   /* bytes of the source that they took */
    size_t count;                     /* number of records of this batch */
};

/* Begins. In: unit: plural name of the records; source: borrowed until the end. */
void umbc_records_begin(struct umbc_record_progress *progress, const char *unit, bool quiet,
                        const struct umbc_points *source);
/* Begins a batch of `count` records, just read from the source. */
void umbc_records_batch(struct umbc_record_progress *progress, size_t count);
/* Shows that `answered` records of the batch are done. The record being answered counts by the part
 * of it that is done. */
void umbc_records_show(struct umbc_record_progress *progress, double answered);
void umbc_records_end(struct umbc_record_progress *progress);

/*
 * Estimates the number of voxels of a directional light's frustum in a box, to some percent.
 *
 * In: origin: origin of the asset.
 */
double umbc_box_voxels(const struct umb_frustum_info *frustum, const double origin[3],
                       const struct umb_box *box);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CLI_CLI_LONG_SEGMENTS_H
#define UMBRAGE_CLI_CLI_LONG_SEGMENTS_H
/*
 * Segments of more lit intervals than were kept of each: they are asked again with room for all, as
 * many together as is worth while.
 *
 *     {.segments = batch, .answers = what is said of it};  next, for each long one in order;
 *     finish.
 */
#include "cli_volume_asset.h"

#define UMBC_INTERVALS_KEPT 16 /* of each segment at first */

struct umbc_long_segments {
    const struct umb_segments *segments;       /* the batch, borrowed ... */
    const struct umb_segment_answers *answers; /* ... and what is said of it */
    /* the rest zero at first: those that are asked together */
    uint8_t *ends;
    struct umb_segment_answers again;
    size_t count, next; /* next: the first that is not given out */
};

/*
 * Gives segment i whole, which has more intervals than are kept and comes after those asked for
 * before.
 *
 * Out:   answer, intervals: borrowed until the next call.
 * Fails: as umbc_volume_segments; E_NO_MEMORY; E_PROTOCOL (a daemon tells more intervals than it
 *        said there were).
 */
UMB_CHECKED enum umb_status umbc_longs_next(struct umbc_long_segments *longs,
                                            struct umbc_volume_asset *asset, size_t i,
                                            const struct umb_segment_answer **answer,
                                            const struct umb_interval **intervals,
                                            struct umb_error *error);
void umbc_longs_finish(struct umbc_long_segments *longs);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
/* See cli_long_segments.h. */
#include "cli_long_segments.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

#include "tool/tool_try.h"

#define FEW 64 /* a daemon counts segments of fewer intervals as of so many */
/* Stretches that such segments may have together, unless one has more. */
#define LONG_INTERVALS ((size_t)1 << 18)

/* 1 if one more segment fits: each has room for the most intervals of any, of which half at least
 * is used, and a daemon counts it as so many points. */
static bool has_room(const struct umbc_volume_asset *asset, size_t count, size_t most, size_t used)
{
    const size_t room = count * most;
    return count == 1 || (room <= LONG_INTERVALS && room / 2 <= used &&
                          (asset->client == NULL || room <= asset->limits.max_points));
}

/* Counts the long segments from i on that are asked together, and the intervals of the longest. */
static void choose(struct umbc_long_segments *longs, const struct umbc_volume_asset *asset,
                   size_t i)
{
    size_t used = 0, most = FEW;
    longs->count = 0;
    for (; i < longs->segments->count; i++) {
        const size_t intervals = (size_t)longs->answers->segments[i].interval_count;
        const size_t longest = intervals > most ? intervals : most;
        if (intervals > UMBC_INTERVALS_KEPT) {
            used += intervals > FEW ? intervals : FEW;
            if (!has_room(asset, longs->count + 1, longest, used)) {
                break;
            }
            most = longest;
            longs->count++;
        }
    }
    longs->again.interval_max = most;
}

/* What was asked with room for all intervals must have no more now, whatever a server says. */
static enum umb_status check(const struct umbc_long_segments *longs, struct umb_error *error)
{
    for (size_t i = 0; i < longs->count; i++) {
        const uint64_t intervals = longs->again.segments[i].interval_count;
        if (intervals > longs->again.interval_max) {
            return umb_fail(error, UMB_E_PROTOCOL,
                            "the daemon told %zu stretches at most, and then %" PRIu64,
                            longs->again.interval_max, intervals);
        }
    }
    return UMB_OK;
}

/* Asks the long segments from i on once more, as many as go together. */
static enum umb_status ask(struct umbc_long_segments *longs, struct umbc_volume_asset *asset,
                           size_t i, struct umb_error *error)
{
    const struct umb_segments *segments = longs->segments;
    const size_t record = 6 * (segments->format == UMB_POINT_F32 ? sizeof(float) : sizeof(double));
    umbc_longs_finish(longs);
    choose(longs, asset, i);
    const size_t room = longs->count * longs->again.interval_max;
    longs->ends = malloc(longs->count * record);
    longs->again.segments = calloc(longs->count, sizeof *longs->again.segments);
    longs->again.intervals = calloc(room, sizeof *longs->again.intervals);
    if (longs->ends == NULL || longs->again.segments == NULL || longs->again.intervals == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for %zu stretches", room);
    }
    for (size_t found = 0; found < longs->count; i++) {
        if (longs->answers->segments[i].interval_count > UMBC_INTERVALS_KEPT) {
            memcpy(longs->ends + found++ * record, (const uint8_t *)segments->ends + i * record,
                   record);
        }
    }
    struct umb_segments again = *segments;
    again.ends = longs->ends;
    again.count = longs->count;
    const enum umb_status status = umbc_volume_segments(asset, &again, NULL, &longs->again, error);
    return status == UMB_OK ? check(longs, error) : status;
}

void umbc_longs_finish(struct umbc_long_segments *longs)
{
    free(longs->ends);
    free(longs->again.segments);
    free(longs->again.intervals);
    longs->ends = NULL;
    memset(&longs->again, 0, sizeof longs->again);
    longs->count = longs->next = 0;
}

enum umb_status umbc_longs_next(struct umbc_long_segments *longs, struct umbc_volume_asset *asset,
                                size_t i, const struct umb_segment_answer **answer,
                                const struct umb_interval **intervals, struct umb_error *error)
{
    if (longs->next == longs->count) {
        UMB__TRY(ask(longs, asset, i, error));
    }
    *answer = &longs->again.segments[longs->next];
    *intervals = longs->again.intervals + longs->next * longs->again.interval_max;
    longs->next++;
    return UMB_OK;
}

/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_ROW_TIMER_H
#define UMBRAGE_CORE_ROW_TIMER_H
/*
 * Times the rows of a light's curve on given points. A run asks a few intervals of consecutive
 * points that are spread over all of them, so that each run sees points of all kinds, in the order
 * in which they will be asked; the next run and the next row ask others, so that what a row needs
 * is not in the cache because the row before it needed the same. Runs of the rows are interleaved,
 * the median of a row's runs counts.
 */
#include "umbrage/curve.h"

struct umb__row_timer {
    const struct umb_asset *asset;
    uint32_t light;
    const struct umb_curve_row *rows;
    size_t count;                    /* of rows */
    const struct umb_points *points; /* at least one; finite */
    double (*now_s)(void);
};

/* Out: ns: nanoseconds a point, for each row. Fails: as umb_query_prepare, E_NO_MEMORY. */
UMB_CHECKED enum umb_status umb__time_rows(const struct umb__row_timer *timer,
                                           double ns[UMB_CURVE_ROWS_MAX], struct umb_error *error);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_TRADE_PROBE_H
#define UMBRAGE_SERVER_STUDY_TRADE_PROBE_H
/* Settings of a study on their way (trade_measure.c), and their times (trade_times.c). */
#include "study/traced_shadow.h"
#include "study/trade.h"

/* One setting on its way. */
struct umbt_probe {
    struct umbt_trade *trade;
    struct umbt_trade_result *result;
    const struct umbt_trade_bake *bake;
    struct umbt_truth truth;
    struct umb_query query;
    float *answers;     /* [points] */
    float *area;        /* [points of view and border] */
    uint8_t *undefined; /* likewise */
};

/* All samples of the study as points of a query; borrowed. */
struct umb_points umbt_trade_points_all(const struct umbt_trade *trade);

/* Asks a setting about some of the samples. stats: may be NULL. */
void umbt_trade_ask(const struct umbt_probe *probe, size_t first, size_t count,
                    struct umb_query_stats *stats);

/* A sample's unit normal; zero for free points. */
void umbt_trade_normal(const struct umbt_trade_points *points, size_t i, double normal[3]);

/* Takes the times of all results and of the rays. probes: [result_count], prepared. Fails:
 * E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbt_trade_times(struct umbt_trade *trade, struct umbt_probe *probes,
                                             struct umb_error *error);

#endif

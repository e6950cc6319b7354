/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CLI_CLI_ANSWERS_H
#define UMBRAGE_CLI_CLI_ANSWERS_H
/*
 * Writes answers in order: text, raw bytes, JSON or explanations. Write errors stay in the stream
 * until umbc_answers_end reports them.
 */
#include "tool/json.h"
#include "tool/output.h"
#include "cli_query_options.h"

/* Settings and sums over all batches of a query. */
struct umbc_query_total {
    struct umb_query_stats stats;
    uint8_t asset_id[UMB_ID_BYTES];
    uint64_t server_ns; /* CPU time of the daemon in nanoseconds; 0 for a file */
    double here_s;      /* CPU time of the look-ups in a file in seconds; 0 with a daemon */
    double seconds;     /* time from the first batch to the last */
    uint64_t points;
    const uint32_t *lights; /* [light_count] */
    size_t light_count;
    uint32_t taps, level;     /* settings of the first light */
    double bound_m;           /* bound of the first light's answers; 0: not known */
    struct umb_curve_row row; /* row of the accuracy curve for these settings, or zero */
    double expected_ns;       /* nanoseconds a point by calibration for a budget; else 0 */
    /* Of a partial file. */
    bool is_partial;
    uint32_t pages_held, page_count;
    uint64_t exact;       /* number of answers whose two bounds are equal */
    double worst_error_m; /* widest edge of a missing cube that an answer depends on */
};

/* Returns the CPU time in nanoseconds for one point and one light; 0 without points. */
double umbc_query_ns(const struct umbc_query_total *total);

struct umbc_answers {
    const struct umbc_query_options *options;
    struct umbu_output output;
    struct umbu_json json;
    uint8_t begun;       /* bits of the last byte of a batch, the first one lowest */
    unsigned begun_bits; /* number of bits in begun; the next batch adds to them */
};

UMB_CHECKED enum umb_status umbc_answers_begin(const struct umbc_query_options *options,
                                               struct umbc_answers *answers,
                                               struct umb_error *error);

/*
 * Writes the answers of `count` points.
 *
 * The answers of several lights for one point stand side by side: on a line, in a JSON array, or
 * one after the other in raw bytes (not as bits). A partial file gives three numbers a light: the
 * answer, its lower bound and its upper bound.
 *
 * In:  values: [light_count] arrays of `count` values in the encoding's format, float for text.
 * Returns false if a write failed.
 */
bool umbc_answers_put(struct umbc_answers *answers, const void *const *values, size_t light_count,
                      size_t count);

/* Writes the explanation of point `number`. */
void umbc_answers_explain(struct umbc_answers *answers, uint64_t number, float value,
                          const struct umb_explanation *explanation);

/* Ends the output and makes it visible. */
UMB_CHECKED enum umb_status umbc_answers_end(struct umbc_answers *answers,
                                             const struct umbc_query_total *total,
                                             struct umb_error *error);
/* Ends the answers after an error: removes the output file and closes the brackets of JSON on
 * stdout. Does nothing after umbc_answers_end. */
void umbc_answers_abandon(struct umbc_answers *answers);

#endif

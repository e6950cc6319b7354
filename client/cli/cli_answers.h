/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CLI_CLI_ANSWERS_H
#define UMBRAGE_CLI_CLI_ANSWERS_H
/*
 * Writes answers in order: text, raw bytes, JSON or explanations. Write errors stay in the stream
 * until umbc_answers_end looks.
 */
#include "tool/json.h"
#include "tool/output.h"
#include "cli_query_options.h"

/* What a whole query added up to. */
struct umbc_query_total {
    struct umb_query_stats stats;
    uint8_t asset_id[UMB_ID_BYTES];
    uint64_t server_ns; /* CPU time of the daemon, 0 for a file */
    double here_s;      /* CPU time of the look-ups in a file, 0 with a daemon */
    double seconds;     /* from the first batch to the last */
    uint64_t points;
    const uint32_t *lights; /* [light_count] */
    size_t light_count;
    uint32_t taps, level;     /* of the first light */
    double bound_m;           /* of the first light; 0: not known here */
    struct umb_curve_row row; /* of the curve, if the asset has one for these settings */
    double expected_ns;       /* a point, calibrated for a budget; else 0 */
};

/* Nanoseconds that a point and light took of one core; 0 without points. */
double umbc_query_ns(const struct umbc_query_total *total);

struct umbc_answers {
    const struct umbc_query_options *options;
    struct umbu_output output;
    struct umbu_json json;
    uint8_t begun;       /* bits of a byte that batches share, the first one lowest ... */
    unsigned begun_bits; /* ... and how many there are */
};

UMB_CHECKED enum umb_status umbc_answers_begin(const struct umbc_query_options *options,
                                               struct umbc_answers *answers,
                                               struct umb_error *error);

/*
 * Writes the answers of `count` points.
 *
 * In: values: [light_count], for each light `count` values in the encoding's format, float for
 * text. Several lights stand side by side: on a line, in an array of JSON, one after the other in
 * raw bytes (not as bits). Returns false if it cannot write.
 */
bool umbc_answers_put(struct umbc_answers *answers, const void *const *values, size_t light_count,
                      size_t count);

/* Writes how point `number` was answered. */
void umbc_answers_explain(struct umbc_answers *answers, uint64_t number, float value,
                          const struct umb_explanation *explanation);

/* Ends the output and makes it visible. */
UMB_CHECKED enum umb_status umbc_answers_end(struct umbc_answers *answers,
                                             const struct umbc_query_total *total,
                                             struct umb_error *error);
/* Gives up: no file appears; what stdout has of JSON is closed. Harmless after the end. */
void umbc_answers_abandon(struct umbc_answers *answers);

#endif

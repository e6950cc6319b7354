/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CLI_CLI_QUERY_OPTIONS_H
#define UMBRAGE_CLI_CLI_QUERY_OPTIONS_H
/* The options of `umbrage query`, read and checked. */
#include "cli/shared/cli_common.h"
#include "cli/shared/cli_points.h"
#include "umbrage/curve.h"

enum umbc_encoding {
    UMBC_ENCODING_TEXT, /* "%.9g" a line */
    UMBC_ENCODING_F32,
    UMBC_ENCODING_U8,
    UMBC_ENCODING_BIT,
};

/* Kind of the input's records. */
enum umbc_ask_kind {
    UMBC_ASK_POINTS,
    UMBC_ASK_SEGMENTS, /* two ends */
    UMBC_ASK_COLUMNS,  /* a point of the column */
    UMBC_ASK_BOXES,    /* two corners */
    UMBC_ASK_COUNT,
};

#define UMBC_QUERY_LIGHTS_MAX 256

struct umbc_query_options {
    const char *target; /* File or daemon's asset */
    struct umbu_session session;
    const char *records[UMBC_ASK_COUNT]; /* File or "-"; one is set */
    enum umbc_ask_kind volume_query;
    const char *points; /* File of volume_query's kind */
    enum umbc_points_format format;
    bool with_normals;
    const char *footprints;             /* File, one f32 a point, or NULL */
    struct umb_query_settings settings; /* Settings of the first light */
    struct umb_dial dial;               /* Requirements that choose taps and level; used if has_dial
                                           is set */
    bool has_dial;
    uint32_t lights[UMBC_QUERY_LIGHTS_MAX];
    size_t light_count;
    bool all_lights; /* true: all of the asset, and light_count is 0 */
    double origin[3];
    size_t batch; /* Number of points in a call */
    const char *out;
    enum umbc_encoding encoding;
    bool explain, json, quiet;
};

/* Reads arguments. Returns -1 to go on, else the exit code. */
int umbc_query_options_parse(int argc, char **argv, struct umbc_query_options *options);

extern const struct umbu_command umbc_query_command;

/*
 * Chooses the number of records in a call: --batch, or less where the server takes less.
 *
 * In:    limits: the server's limits. 0 in max_points or max_message_bytes means no known limit; 0
 *        in max_segments, max_columns or max_boxes means that the server takes no such records.
 * Out:   count: at least 1; 0 after a failure.
 * Fails: E_UNSUPPORTED (the server takes no records of this kind).
 */
UMB_CHECKED enum umb_status umbc_call_size(const struct umbc_query_options *options,
                                           const struct umb_client_limits *limits, size_t *count,
                                           struct umb_error *error);

/* Prints an error as umbc_complain does, with option names in place of field names. */
int umbc_complain_query(const struct umb_error *error);

/* Answers --segments, --columns or --boxes from a file or a daemon: for each record, in order, a
 * line of text or a JSON object. Returns the exit code. */
int umbc_query_volume(const struct umbc_query_options *options);

#endif

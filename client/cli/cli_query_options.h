/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CLI_CLI_QUERY_OPTIONS_H
#define UMBRAGE_CLI_CLI_QUERY_OPTIONS_H
/* The options of `umbrage query`, read and checked. */
#include "cli_common.h"
#include "cli_points.h"
#include "umbrage/curve.h"

enum umbc_encoding {
    UMBC_ENCODING_TEXT, /* "%.9g" a line */
    UMBC_ENCODING_F32,
    UMBC_ENCODING_U8,
    UMBC_ENCODING_BIT,
};

/* What the input's records are. */
enum umbc_ask_kind {
    UMBC_ASK_POINTS,
    UMBC_ASK_SEGMENTS, /* two ends */
    UMBC_ASK_COLUMNS,  /* a point of the column */
    UMBC_ASK_BOXES,    /* two corners */
    UMBC_ASK_COUNT,
};

#define UMBC_QUERY_LIGHTS_MAX 256

struct umbc_query_options {
    const char *target; /* FILE or ASSET */
    struct umbu_session session;
    const char *records[UMBC_ASK_COUNT]; /* File or "-" of the one kind that is asked */
    enum umbc_ask_kind volume_query;
    const char *points; /* That of `question` */
    enum umbc_points_format format;
    bool with_normals;
    const char *footprints;             /* file, one f32 a point, or NULL */
    struct umb_query_settings settings; /* of the first light */
    struct umb_dial dial;               /* chooses level and taps if has_dial */
    bool has_dial;
    uint32_t lights[UMBC_QUERY_LIGHTS_MAX];
    size_t light_count;
    bool all_lights; /* of the asset; then light_count is 0 */
    double origin[3];
    size_t batch; /* points */
    const char *out;
    enum umbc_encoding encoding;
    bool explain, json, quiet;
};

/* Reads arguments. Returns -1 to go on, else the exit code. */
int umbc_query_options_parse(int argc, char **argv, struct umbc_query_options *options);

extern const struct umbu_command umbc_query_command;

/* umbc_complain, with the names of options in place of the library's fields. */
int umbc_complain_query(const struct umb_error *error);

/* Answers --segments, --columns or --boxes of a file or a daemon: a line of text or an object of
 * JSON for each record, in order. Returns the exit code. */
int umbc_query_volume(const struct umbc_query_options *options);

#endif

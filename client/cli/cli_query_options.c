/* SPDX-License-Identifier: Apache-2.0 */
/* The options of `umbrage query`, see cli_query_options.h. */
#include "cli_query_options.h"

#include <inttypes.h>
#include <math.h>
#include <string.h>

#define BATCH_MAX (16U << 20) /* points; 384 MiB as doubles */
#define AT(field) UMBU_AT(struct umbc_query_options, field)
#define CHOSEN    "level|taps|footprint|filter" /* options that --max-error and --budget replace */

/* Reads "all", or numbers of lights with commas between them. */
static enum umb_status read_lights(const struct umbu_option *option, const char *text, void *field,
                                   struct umb_error *error)
{
    struct umbc_query_options *options = field;
    options->all_lights = strcmp(text, "all") == 0;
    options->light_count = 0;
    for (const char *at = text; !options->all_lights; at++) {
        uint64_t value;
        if (!umbu_read_count(&at, &value) || value > UINT32_MAX || (*at != ',' && *at != '\0')) {
            return umbu_refuse(option, text, error);
        }
        if (options->light_count == UMBC_QUERY_LIGHTS_MAX) {
            return umb_fail(error, UMB_E_ARGUMENT,
                            "--light: more than %d lights; give fewer, or all",
                            UMBC_QUERY_LIGHTS_MAX);
        }
        options->lights[options->light_count++] = (uint32_t)value;
        if (*at == '\0') {
            break;
        }
    }
    options->settings.light = options->lights[0];
    return UMB_OK;
}

/* Reads a number above 0: metres, or visibility with "vis". */
static enum umb_status read_max_error(const struct umbu_option *option, const char *text,
                                      void *field, struct umb_error *error)
{
    struct umb_dial *dial = field;
    const char *at = text;
    double value;
    if (!umbu_read_number(&at, &value) || !(value > 0) ||
        (*at != '\0' && strcmp(at, "m") != 0 && strcmp(at, "vis") != 0)) {
        return umbu_refuse(option, text, error);
    }
    *(*at == 'v' ? &dial->max_visibility : &dial->max_error_m) = value;
    return UMB_OK;
}

static const struct umbu_option OPTIONS[] = {
    {UMBC_TARGET_ROW(struct umbc_query_options, "FILE|ASSET",
                     "asset file, or asset of the daemon")},
    {"points", "FILE|-", "file of points to answer, x y z each; - is stdin", UMBU_TEXT,
     AT(records[UMBC_ASK_POINTS]), .excludes = "segments|columns|boxes"},
    {"segments", "FILE|-",
     "file of segments x0 y0 z0 x1 y1 z1; answers: lit share, then begin and end of each lit "
     "interval",
     UMBU_TEXT, AT(records[UMBC_ASK_SEGMENTS]), .excludes = "columns|boxes"},
    {"columns", "FILE|-",
     "file of points; answers: metres along the light from each to its column's first occluder",
     UMBU_TEXT, AT(records[UMBC_ASK_COLUMNS]), .excludes = "boxes"},
    {"boxes", "FILE|-", "file of boxes x0 y0 z0 x1 y1 z1; answers: lit share of the voxels inside",
     UMBU_TEXT, AT(records[UMBC_ASK_BOXES])},
    {"format", NULL, "format of the input: text, or raw little-endian numbers",
     UMBU_CHOICE("text|f32|f64"), AT(format), .standard = "text"},
    {"normals", NULL, "raw points have six numbers, x y z nx ny nz", UMBU_FLAG, AT(with_normals),
     .needs = "points format=f32|f64"},
    {"origin", "X,Y,Z", "metres to add to every point", UMBU_NUMBERS(3), AT(origin)},
    {"light", "N,...|all",
     "number of the light; of a FILE also several, whose answers stand side by side",
     UMBU_READ(read_lights, "the number of a light, several with commas, or all"), .standard = "0",
     .fields = "light"},
    {.setting = "taps", AT(settings.taps), .standard = "1", .needs = "points"},
    {"footprint", "M",
     "FILE only: width of the filter in metres instead of --taps; with --filter footprint: side "
     "in metres of the square of surface around each point",
     .setting = "footprint_m", AT(settings.footprint_m), .needs = "points",
     .excludes = "footprints|eye", .fields = "footprint|footprint_m"},
    {"footprints", "FILE",
     "file of footprints for --filter footprint: raw little-endian f32, metres, one a point",
     UMBU_TEXT, AT(footprints), .needs = "filter=footprint", .excludes = "eye"},
    {"eye", "X,Y,Z", "position of the camera in metres, for --filter footprint with --pixel",
     .setting = "eye", AT(settings.eye), .needs = "filter=footprint pixel"},
    {"pixel", "RAD", "angle of a pixel seen from --eye in radians, above 0 to 1",
     .setting = "pixel_rad", AT(settings.pixel_rad), .needs = "eye"},
    {.setting = "filter", AT(settings.filter), .standard = "box", .needs = "points"},
    {UMBU_LIGHT_SIZE_ROW(struct umbc_query_options, settings.light_extent),
     .needs = "filter=penumbra"},
    {"opaque-only", NULL,
     "ignores translucent casters; segments, columns and boxes always do, and the option leaves "
     "out the note about it",
     .setting = "opaque_only", AT(settings.opaque_only)},
    {.setting = "level", AT(settings.level), .max = UMB_LEVEL_MAX, .needs = "points"},
    {"max-error", "E",
     "largest error in metres (0.05, 0.05m) or visibility (0.1vis); chooses the cheapest setting "
     "instead of --taps",
     UMBU_READ(read_max_error, "a number above 0, metres as 0.05 or 0.05m, visibility as 0.1vis"),
     AT(dial), .needs = "points", .excludes = CHOSEN, .fields = "max_error|max_visibility"},
    {"budget", "NS",
     "nanoseconds of one core for a point; chooses the most accurate setting instead of --taps",
     UMBU_ABOVE(0, HUGE_VAL), .unit = "ns", AT(dial.budget_ns), .needs = "points",
     .excludes = CHOSEN, .fields = "budget"},
    {UMBU_BIAS_ROW(struct umbc_query_options, settings), .needs = "points"},
    {UMBU_OTHER_SETTINGS(struct umbc_query_options, settings, NULL), .needs = "points"},
    {"batch", "N", "points in a call, 1 to 16777216; fewer where a daemon takes fewer",
     UMBU_COUNT(1, BATCH_MAX), AT(batch), .standard = "65536"},
    {"output", "FILE|-", "file of the answers, replaced as a whole; - is stdout", UMBU_TEXT,
     AT(out), .standard = "-", .letter = 'o'},
    {"encoding", "NAME", "encoding of the answers: text, or raw f32, u8 or bit",
     UMBU_CHOICE("text|f32|u8|bit"), AT(encoding), .standard = "text", .needs = "points",
     .fields = "format"},
    {"explain", NULL, "FILE only: explains each answer", UMBU_FLAG, AT(explain),
     .needs = "points encoding=text"},
    {"json", NULL,
     "print one JSON object: asset, points, statistics, and the answers if they are text",
     UMBU_FLAG, AT(json)},
    {UMBU_QUIET_ROW(struct umbc_query_options, "no summary and no progress on stderr")},
};

const struct umbu_command umbc_query_command = {
    .name = "umbrage query",
    .usage = "umbrage query FILE|ASSET --points FILE|- [options]\n"
             "       umbrage query FILE|ASSET --segments|--columns|--boxes FILE|- [options]",
    .summary = "Prints the share of a light that reaches each point: one answer a line, from 0\n"
               "(shadowed) to 1 (lit), in the order of the points. An existing file, a path\n"
               "as ./NAME or /DIR/NAME, or one ending in .umb or .umbm is answered here; NAME and\n"
               "FOLDER/NAME are assets of the daemon, with the same bits. Text points are lines\n"
               "`x y z` or `x y z nx ny nz`; '#' starts a comment. Segments, columns and boxes are "
               "answered\n"
               "exactly, voxel by voxel, for opaque casters alone: translucent ones do not\n"
               "count, and a note says so where there are any.",
    .sections = {{"options", UMBU_ROWS(OPTIONS)}, UMBU_SESSION(struct umbc_query_options, session)},
};

/* Checks --light: several lights need a file, and answers of at least a byte each. */
static int check_lights(const struct umbc_query_options *options)
{
    if (!options->all_lights && options->light_count == 1) {
        return -1;
    }
    if (options->volume_query != UMBC_ASK_POINTS) {
        return umbc_usage_error("query", "--light: segments, columns and boxes take one light");
    }
    if (!umbc_is_file(options->target)) {
        return umbc_usage_error("query", "--light: several work on files only, '%.80s' is an asset",
                                options->target);
    }
    if (options->explain || options->encoding == UMBC_ENCODING_BIT) {
        return umbc_usage_error("query", "--light: several go with neither --explain nor "
                                         "--encoding bit");
    }
    return -1;
}

/* Checks the width of the filter: --taps, or an option in its place. */
static int check_window(const struct umbu_parsed *parsed, struct umbc_query_options *options)
{
    struct umb_query_settings *settings = &options->settings;
    const bool footprint = umbu_given(parsed, "footprint");
    options->has_dial = umbu_given(parsed, "max-error") || umbu_given(parsed, "budget");
    if (umb_filter_get_info(settings->filter)->has_footprints) {
        return footprint || options->footprints != NULL || settings->pixel_rad > 0
                   ? -1
                   : umbc_usage_error("query", "--filter: footprint needs --footprint M, "
                                               "--footprints FILE, or --eye X,Y,Z and --pixel RAD");
    }
    if (footprint && umbu_given(parsed, "taps")) {
        return umbc_usage_error("query", "--taps: does not go with --footprint; give one");
    }
    if (footprint && !umbc_is_file(options->target)) {
        return umbc_usage_error("query", "--footprint: works on files only, '%.80s' is an asset",
                                options->target);
    }
    settings->taps = footprint || options->has_dial ? 0 : settings->taps;
    return -1;
}

/* Checks combinations of options. */
static int check_together(const struct umbu_parsed *parsed, struct umbc_query_options *options)
{
    static const enum umb_answer_format answers[] = {UMB_ANSWER_F32, UMB_ANSWER_F32, UMB_ANSWER_U8,
                                                     UMB_ANSWER_BIT};
    while (options->volume_query <= UMBC_ASK_BOXES && !options->records[options->volume_query]) {
        options->volume_query++;
    }
    if (options->volume_query > UMBC_ASK_BOXES) {
        return umbc_usage_error("query", "--points FILE or --points - is needed, or --segments, "
                                         "--columns or --boxes");
    }
    options->points = options->records[options->volume_query];
    options->settings.format = answers[options->encoding];
    if (options->json && options->encoding != UMBC_ENCODING_TEXT &&
        strcmp(options->out, "-") == 0) {
        return umbc_usage_error("query", "--json: raw answers need --output FILE beside it");
    }
    if (options->explain && !umbc_is_file(options->target)) {
        return umbc_usage_error("query", "--explain: works on files only, '%.80s' is an asset",
                                options->target);
    }
    const int code = check_window(parsed, options);
    return code < 0 ? check_lights(options) : code;
}

int umbc_query_options_parse(int argc, char **argv, struct umbc_query_options *options)
{
    struct umbu_parsed parsed;
    memset(options, 0, sizeof *options);
    const int code = umbu_start(&parsed, &umbc_query_command, argc, argv, options);
    return code < 0 ? check_together(&parsed, options) : code;
}

/* Most bytes of a request beside its records: the asset's name, the origin and the settings. */
#define HEAD_BYTES 512

/* Most bytes of a record in a request. */
static size_t record_bytes(const struct umbc_query_options *options)
{
    const size_t scalar = options->format == UMBC_POINTS_F32 ? sizeof(float) : sizeof(double);
    switch (options->volume_query) {
    case UMBC_ASK_POINTS: /* any line of text may have a normal */
        return 3 * scalar +
               (options->with_normals || options->format == UMBC_POINTS_TEXT ? 3 * sizeof(float)
                                                                             : 0) +
               (options->footprints != NULL ? sizeof(float) : 0);
    case UMBC_ASK_COLUMNS:
        return 3 * scalar;
    default:
        return 6 * scalar;
    }
}

/* Number of records that the server takes in a call, and their name. */
static uint64_t taken(enum umbc_ask_kind volume_query, const struct umb_client_limits *limits,
                      const char **name)
{
    switch (volume_query) {
    case UMBC_ASK_POINTS:
        *name = "points";
        return limits->max_points > 0 ? limits->max_points : UINT64_MAX;
    case UMBC_ASK_SEGMENTS:
        *name = "segments";
        return limits->max_segments;
    case UMBC_ASK_COLUMNS:
        *name = "columns";
        return limits->max_columns;
    default:
        *name = "boxes";
        return limits->max_boxes;
    }
}

enum umb_status umbc_call_size(const struct umbc_query_options *options,
                               const struct umb_client_limits *limits, size_t *count,
                               struct umb_error *error)
{
    const char *name;
    const uint64_t takes = taken(options->volume_query, limits, &name);
    const uint64_t bytes = limits->max_message_bytes;
    const size_t record = record_bytes(options);
    if (takes == 0) {
        *count = 0;
        return umb_fail(error, UMB_E_UNSUPPORTED,
                        "the server takes no %s: max_%s is 0 (max_points is %" PRIu64 ")", name,
                        name, limits->max_points);
    }
    size_t most = takes < options->batch ? (size_t)takes : options->batch;
    if (bytes >= HEAD_BYTES + record && (bytes - HEAD_BYTES) / record < most) {
        most = (size_t)((bytes - HEAD_BYTES) / record);
    }
    *count = most;
    return UMB_OK;
}

int umbc_complain_query(const struct umb_error *error)
{
    struct umb_error named = *error;
    umbu_name_options(&umbc_query_command, &named);
    return umbc_complain(&named);
}

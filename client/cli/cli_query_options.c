/* SPDX-License-Identifier: Apache-2.0 */
/* The options of `umbrage query`, see cli_query_options.h. */
#include "cli_query_options.h"

#include <stdlib.h>
#include <string.h>
#include "cli_query_values.h"

#define BATCH_DEFAULT 65536
#define BATCH_MAX     (16U << 20) /* points; 384 MiB as doubles */

enum query_option {
    OPTION_POINTS,
    OPTION_SEGMENTS,
    OPTION_COLUMNS,
    OPTION_BOXES,
    OPTION_FORMAT,
    OPTION_NORMALS,
    OPTION_ORIGIN,
    OPTION_LIGHT,
    OPTION_TAPS,
    OPTION_FOOTPRINT,
    OPTION_FOOTPRINTS,
    OPTION_EYE,
    OPTION_PIXEL,
    OPTION_FILTER,
    OPTION_LIGHT_SIZE,
    OPTION_OPAQUE_ONLY,
    OPTION_LEVEL,
    OPTION_MAX_ERROR,
    OPTION_BUDGET,
    OPTION_BIAS,
    OPTION_BATCH,
    OPTION_OUTPUT,
    OPTION_ENCODING,
    OPTION_EXPLAIN,
    OPTION_JSON,
    OPTION_QUIET,
    OPTION_COUNT,
};

static const struct umbc_option OPTIONS[OPTION_COUNT] = {
    [OPTION_POINTS] = {"points", "FILE|-", "points to ask for; - is stdin", 0},
    [OPTION_SEGMENTS] = {"segments", "FILE|-",
                         "segments x0 y0 z0 x1 y1 z1: lit share, then its lit stretches", 0},
    [OPTION_COLUMNS] = {"columns", "FILE|-",
                        "points: metres from each along the light to its column's first occluder",
                        0},
    [OPTION_BOXES] = {"boxes", "FILE|-",
                      "boxes x0 y0 z0 x1 y1 z1: the lit share of the voxels inside", 0},
    [OPTION_FORMAT] = {"format", "FORMAT", "text (default), f32 or f64: raw little-endian x y z",
                       0},
    [OPTION_NORMALS] = {"normals", NULL, "raw formats: six numbers a point, x y z nx ny nz", 0},
    [OPTION_ORIGIN] = {"origin", "X,Y,Z", "metres, added to every point", 0},
    [OPTION_LIGHT] =
        {"light", "N,...|all",
         "index of the light, default 0; several, of a FILE only: an answer each, side by side", 0},
    [OPTION_TAPS] = {"taps", "N", "width of the filter window: odd, 1 (default) to 17", 0},
    [OPTION_FOOTPRINT] = {"footprint", "M",
                          "FILE only: width of the window in metres instead of --taps; of --filter "
                          "footprint: side of the square of surface around each point",
                          0},
    [OPTION_FOOTPRINTS] = {"footprints", "FILE",
                           "for --filter footprint: raw little-endian f32, metres, one a point", 0},
    [OPTION_EYE] = {"eye", "X,Y,Z", "for --filter footprint: what a pixel seen from here covers",
                    0},
    [OPTION_PIXEL] = {"pixel", "RAD", "with --eye: the angle of a pixel in radians", 0},
    [OPTION_FILTER] = {"filter", "NAME",
                       "box (default), tent, penumbra (half shadows of a light with an extent) or "
                       "footprint (the surface that a pixel covers); of these two --taps is the "
                       "least width",
                       0},
    [OPTION_LIGHT_SIZE] = {"light-size", "DEG",
                           "for penumbras: the light's angular diameter, default the asset's", 0},
    [OPTION_OPAQUE_ONLY] = {"opaque-only", NULL,
                            "translucent casters take no light (of segments, columns and boxes "
                            "they never do: it leaves out the note)",
                            0},
    [OPTION_LEVEL] = {"level", "N", "stop at cells of 2^N voxels: 3, 5, 7 ...; cheaper and coarser",
                      0},
    [OPTION_MAX_ERROR] = {"max-error", "E",
                          "instead of --taps: the cheapest setting within E metres "
                          "(0.05, 0.05m) or visibility (0.1vis)",
                          0},
    [OPTION_BUDGET] = {"budget", "NS",
                       "instead of --taps: the least error for NS nanoseconds a point of one core",
                       0},
    [OPTION_BIAS] = {"bias", "BIAS", "auto (default), none, or a length: 1.5vox, 0.02m", 0},
    [OPTION_BATCH] = {"batch", "N",
                      "points a call, default 65536; fewer where a daemon takes fewer", 0},
    [OPTION_OUTPUT] = {"output", "FILE|-", "where the answers go, default - (stdout); atomic", 'o'},
    [OPTION_ENCODING] = {"encoding", "NAME", "text (default), or raw f32, u8, bit", 0},
    [OPTION_EXPLAIN] = {"explain", NULL, "FILE only: how each point was answered", 0},
    [OPTION_JSON] = {"json", NULL,
                     "one object: asset, points, stats, and the answers if they are text", 0},
    [OPTION_QUIET] = {"quiet", NULL, "no summary and no progress on stderr", 'q'},
};

static const struct umbc_command COMMAND = {
    .usage = "umbrage query FILE|ASSET --points FILE|- [options]\n"
             "       umbrage query FILE|ASSET --segments|--columns|--boxes FILE|- [options]",
    .summary =
        "Asks how much of a light reaches each point: one answer a line, 0 (shadowed) to 1 (lit),\n"
        "in the order of the points. An existing file, a name with '/' or one ending in .umb or\n"
        ".umbm is answered here; anything else is an asset of the daemon, with the same bits.\n"
        "Text points are lines `x y z` or `x y z nx ny nz`; '#' starts a comment.\n"
        "Segments, columns and boxes are answered exactly, voxel by voxel, of opaque casters "
        "alone:\n"
        "translucent ones take no part, and a note says so where there are any.",
    .options = OPTIONS,
    .option_count = OPTION_COUNT,
    .connects = true,
    .min_words = 1,
    .max_words = 1,
};

static int take_formats(const struct umbc_parsed *parsed, struct umbc_query_options *options)
{
    static const char *const formats[] = {"text", "f32", "f64"};
    static const char *const encodings[] = {"text", "f32", "u8", "bit"};
    static const enum umb_answer_format answers[] = {UMB_ANSWER_F32, UMB_ANSWER_F32, UMB_ANSWER_U8,
                                                     UMB_ANSWER_BIT};
    const char *format = parsed->values[OPTION_FORMAT];
    const char *encoding = parsed->values[OPTION_ENCODING];
    int found = format == NULL ? 0 : umbc_find_word(format, formats, 3);
    if (found < 0) {
        return umbc_usage_error("query: --format '%s' is not text, f32 or f64", format);
    }
    options->format = (enum umbc_points_format)found;
    found = encoding == NULL ? 0 : umbc_find_word(encoding, encodings, 4);
    if (found < 0) {
        return umbc_usage_error("query: --encoding '%s' is not text, f32, u8 or bit", encoding);
    }
    options->encoding = (enum umbc_encoding)found;
    options->settings.format = answers[found];
    options->with_normals = parsed->values[OPTION_NORMALS] != NULL;
    if (options->with_normals && options->format == UMBC_POINTS_TEXT) {
        return umbc_usage_error("query: --normals belongs to --format f32 or f64; text lines with "
                                "six numbers have normals");
    }
    return -1;
}

/* "all", or indices between commas. */
static int take_lights(const char *text, struct umbc_query_options *options)
{
    if (strcmp(text, "all") == 0) {
        options->all_lights = true;
        return -1;
    }
    for (const char *at = text;; at++) {
        char number[16];
        unsigned long long value;
        size_t length = strcspn(at, ",");
        if (length >= sizeof number) {
            break;
        }
        memcpy(number, at, length);
        number[length] = '\0';
        if (!umbc_parse_count(number, UINT32_MAX, &value)) {
            break;
        }
        if (options->light_count == UMBC_QUERY_LIGHTS_MAX) {
            return umbc_usage_error("query: --light takes at most %d lights",
                                    UMBC_QUERY_LIGHTS_MAX);
        }
        options->lights[options->light_count++] = (uint32_t)value;
        at += length;
        if (*at == '\0') {
            options->settings.light = options->lights[0];
            return -1;
        }
    }
    return umbc_usage_error("query: --light '%s' is not the index of a light, a list of them, or "
                            "all",
                            text);
}

/* --taps, or --footprint instead, and --filter. */
static int take_filter(const struct umbc_parsed *parsed, struct umb_query_settings *settings)
{
    const char *taps = parsed->values[OPTION_TAPS];
    const char *footprint = parsed->values[OPTION_FOOTPRINT];
    const char *filter = parsed->values[OPTION_FILTER];
    unsigned long long value = 1;
    while (filter != NULL && settings->filter < UMB_FILTERS &&
           strcmp(filter, umb_filter_name(settings->filter)) != 0) {
        settings->filter++;
    }
    if (settings->filter == UMB_FILTERS) {
        return umbc_usage_error("query: --filter '%s' is not box, tent, penumbra or footprint",
                                filter);
    }
    const bool patches = settings->filter == UMB_FILTER_FOOTPRINT;
    if (taps != NULL && footprint != NULL && !patches) {
        return umbc_usage_error("query: --taps and --footprint exclude each other");
    }
    if (taps != NULL && (!umbc_parse_count(taps, UMB_TAPS_MAX, &value) || value % 2 == 0)) {
        return umbc_usage_error("query: --taps '%s' is not odd and within 1..%d", taps,
                                UMB_TAPS_MAX);
    }
    settings->taps = footprint == NULL || patches ? (uint32_t)value : 0;
    if (footprint != NULL &&
        !(umbc_parse_number(footprint, &settings->footprint_m) && settings->footprint_m > 0)) {
        return umbc_usage_error("query: --footprint '%s' is not a length above 0", footprint);
    }
    return -1;
}

/* --footprints, or --eye and --pixel: where --filter footprint takes them from. */
static int take_footprints(const struct umbc_parsed *parsed, struct umbc_query_options *options)
{
    struct umb_query_settings *settings = &options->settings;
    const char *eye = parsed->values[OPTION_EYE], *pixel = parsed->values[OPTION_PIXEL];
    options->footprints = parsed->values[OPTION_FOOTPRINTS];
    const int sources = (settings->footprint_m > 0) + (options->footprints != NULL) +
                        (eye != NULL || pixel != NULL);
    if (settings->filter != UMB_FILTER_FOOTPRINT) {
        return options->footprints == NULL && eye == NULL && pixel == NULL
                   ? -1
                   : umbc_usage_error("query: --footprints, --eye and --pixel belong to --filter "
                                      "footprint");
    }
    if (sources != 1 || (eye == NULL) != (pixel == NULL)) {
        return umbc_usage_error("query: --filter footprint takes --footprint M, --footprints FILE, "
                                "or --eye X,Y,Z with --pixel RAD");
    }
    if (pixel != NULL && !(umbc_parse_number(pixel, &settings->pixel_rad) &&
                           settings->pixel_rad > 0 && settings->pixel_rad <= 1)) {
        return umbc_usage_error("query: --pixel '%s' is not above 0 and at most 1 radian", pixel);
    }
    return eye != NULL ? umbc_take_vector("eye", eye, settings->eye) : -1;
}

/* --light-size: degrees, kept in radians. */
static int take_light_size(const char *text, struct umb_query_settings *settings)
{
    static const char *const units[2] = {"deg", "deg"};
    const double rad_a_deg = 0.017453292519943295;
    double degrees = 0;
    int ending;
    if (text == NULL) {
        return -1;
    }
    if (settings->filter != UMB_FILTER_PENUMBRA) {
        return umbc_usage_error("query: --light-size belongs to --filter penumbra");
    }
    if (!umbc_take_amount(text, units, &degrees, &ending) || degrees * rad_a_deg > UMB_EXTENT_MAX) {
        return umbc_usage_error("query: --light-size '%s' is not above 0 and at most %.4g degrees",
                                text, UMB_EXTENT_MAX / rad_a_deg);
    }
    settings->light_extent = degrees * rad_a_deg;
    return -1;
}

/* --level, or --max-error and --budget, which choose level and taps. */
static int take_dial(const struct umbc_parsed *parsed, struct umbc_query_options *options)
{
    static const char *const errors[2] = {"vis", "m"}, *const times[2] = {"ns", "ns"};
    const char *level = parsed->values[OPTION_LEVEL];
    const char *error = parsed->values[OPTION_MAX_ERROR];
    const char *budget = parsed->values[OPTION_BUDGET];
    unsigned long long number = 0;
    double value;
    int ending;
    if (level != NULL && !umbc_parse_count(level, UMB_LEVEL_MAX, &number)) {
        return umbc_usage_error("query: --level '%s' is not within 0..%d", level, UMB_LEVEL_MAX);
    }
    options->settings.level = (uint32_t)number;
    if (error != NULL) {
        if (!umbc_take_amount(error, errors, &value, &ending)) {
            return umbc_usage_error("query: --max-error '%s' is not above 0, in metres as 0.05 or "
                                    "0.05m or in visibility as 0.1vis",
                                    error);
        }
        *(ending == 1 ? &options->dial.max_visibility : &options->dial.max_error_m) = value;
    }
    if (budget != NULL && !umbc_take_amount(budget, times, &options->dial.budget_ns, &ending)) {
        return umbc_usage_error("query: --budget '%s' is not above 0 nanoseconds", budget);
    }
    options->has_dial = error != NULL || budget != NULL;
    if (options->has_dial &&
        (level != NULL || parsed->values[OPTION_TAPS] != NULL ||
         parsed->values[OPTION_FOOTPRINT] != NULL || parsed->values[OPTION_FILTER] != NULL)) {
        return umbc_usage_error("query: --max-error and --budget choose the setting; --taps, "
                                "--footprint, --filter and --level do not go with them");
    }
    if (options->has_dial) {
        options->settings.taps = 0;
    }
    return -1;
}

static int take_counts(const struct umbc_parsed *parsed, struct umbc_query_options *options)
{
    unsigned long long value;
    options->batch = BATCH_DEFAULT;
    const char *text = parsed->values[OPTION_BATCH];
    if (text != NULL) {
        if (!umbc_parse_count(text, BATCH_MAX, &value) || value == 0) {
            return umbc_usage_error("query: --batch '%s' is not within 1..%u", text, BATCH_MAX);
        }
        options->batch = (size_t)value;
    }
    return -1;
}

/* Several lights: here and now, and as text or whole numbers of bytes. */
static int check_lights(const struct umbc_query_options *options)
{
    if (!options->all_lights && options->light_count == 1) {
        return -1;
    }
    if (options->volume_query != UMBC_ASK_POINTS) {
        return umbc_usage_error("query: segments, columns and boxes take one --light");
    }
    if (!umbc_is_file(options->target)) {
        return umbc_usage_error("query: several lights work on files only, '%s' is an asset",
                                options->target);
    }
    if (options->explain || options->encoding == UMBC_ENCODING_BIT) {
        return umbc_usage_error("query: several lights go with neither --explain nor --encoding "
                                "bit");
    }
    return -1;
}

/* Segments, columns and boxes have no filter, no bias, and answers of more than one number. */
static int check_volume_query(const struct umbc_parsed *parsed,
                              const struct umbc_query_options *options)
{
    static const enum query_option refused[] = {
        OPTION_NORMALS, OPTION_TAPS,      OPTION_FOOTPRINT, OPTION_FOOTPRINTS, OPTION_EYE,
        OPTION_PIXEL,   OPTION_FILTER,    OPTION_BIAS,      OPTION_ENCODING,   OPTION_LEVEL,
        OPTION_BUDGET,  OPTION_MAX_ERROR, OPTION_EXPLAIN};
    static const char *const names[] = {"points", "segments", "columns", "boxes"};
    if (options->volume_query == UMBC_ASK_POINTS) {
        return -1;
    }
    for (size_t i = 0; i < sizeof refused / sizeof refused[0]; i++) {
        if (parsed->values[refused[i]] != NULL) {
            return umbc_usage_error("query: --%s does not go with --%s", OPTIONS[refused[i]].name,
                                    names[options->volume_query]);
        }
    }
    return -1;
}

/* Exactly one of --points, --segments, --columns and --boxes. */
static int take_volume_query(const struct umbc_parsed *parsed, struct umbc_query_options *options)
{
    for (int i = OPTION_POINTS; i <= OPTION_BOXES; i++) {
        const char *file = parsed->values[i];
        if (file != NULL && options->points != NULL) {
            return umbc_usage_error("query: one of --points, --segments, --columns and --boxes");
        }
        if (file != NULL) {
            options->points = file;
            options->volume_query = (enum umbc_ask_kind)(i - OPTION_POINTS);
        }
    }
    if (options->points == NULL) {
        return umbc_usage_error("query: --points FILE or --points - is needed, or --segments, "
                                "--columns or --boxes");
    }
    return -1;
}

static int check_together(const struct umbc_query_options *options)
{
    if (options->json && options->encoding != UMBC_ENCODING_TEXT &&
        strcmp(options->out, "-") == 0) {
        return umbc_usage_error("query: --json with raw answers needs --output FILE for them");
    }
    if (options->explain && options->encoding != UMBC_ENCODING_TEXT) {
        return umbc_usage_error("query: --explain needs --encoding text");
    }
    if (options->settings.footprint_m > 0 && !umbc_is_file(options->target) &&
        options->settings.filter != UMB_FILTER_FOOTPRINT) {
        return umbc_usage_error("query: --footprint works on files only, '%s' is an asset",
                                options->target);
    }
    if (options->explain && !umbc_is_file(options->target)) {
        return umbc_usage_error("query: --explain works on files only, '%s' is an asset",
                                options->target);
    }
    return -1;
}

int umbc_query_options_parse(int argc, char **argv, struct umbc_query_options *options)
{
    struct umbc_parsed parsed;
    memset(options, 0, sizeof *options);
    int code = umbc_parse(&COMMAND, argc, argv, &parsed);
    if (code >= 0) {
        return code;
    }
    options->target = parsed.words[0];
    memcpy(options->session, parsed.session, sizeof options->session);
    options->out = parsed.values[OPTION_OUTPUT] != NULL ? parsed.values[OPTION_OUTPUT] : "-";
    options->explain = parsed.values[OPTION_EXPLAIN] != NULL;
    options->json = parsed.values[OPTION_JSON] != NULL;
    options->quiet = parsed.values[OPTION_QUIET] != NULL;
    options->settings.opaque_only = parsed.values[OPTION_OPAQUE_ONLY] != NULL;
    code = take_volume_query(&parsed, options);
    if (code < 0) {
        code = take_formats(&parsed, options);
    }
    if (code < 0 && parsed.values[OPTION_ORIGIN] != NULL) {
        code = umbc_take_vector("origin", parsed.values[OPTION_ORIGIN], options->origin);
    }
    if (code < 0 && parsed.values[OPTION_BIAS] != NULL) {
        code = umbc_take_bias(parsed.values[OPTION_BIAS], &options->settings);
    }
    if (code < 0) {
        code = take_filter(&parsed, &options->settings);
    }
    if (code < 0) {
        code = take_footprints(&parsed, options);
    }
    if (code < 0) {
        code = take_light_size(parsed.values[OPTION_LIGHT_SIZE], &options->settings);
    }
    if (code < 0) {
        code = take_dial(&parsed, options);
    }
    if (code < 0) {
        code = take_counts(&parsed, options);
    }
    if (code < 0) {
        const char *lights = parsed.values[OPTION_LIGHT];
        code = take_lights(lights != NULL ? lights : "0", options);
    }
    if (code < 0) {
        code = check_volume_query(&parsed, options);
    }
    if (code < 0) {
        code = check_lights(options);
    }
    return code < 0 ? check_together(options) : code;
}

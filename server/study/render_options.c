/* SPDX-License-Identifier: Apache-2.0 */
/* The command line of `render`. */
#include "study/render_options.h"
#include "tool/exit_code.h"

#include <stdio.h>
#include <string.h>
#include "tool/output.h"
#include "tool/threads.h"
#include "study/shadow_source.h"
#include "study/view_options.h"

#define FOG_MAX   100.0 /* 1/m: the view ends after some centimetres */
#define RAD_A_DEG 0.017453292519943295
#define AT(field) UMBU_AT(struct umbt_render_options, field)

static const struct umbu_option OPTIONS[] = {
    {"SCENE", NULL, "the scene file", UMBU_TEXT, AT(scene), .needed = true},
    {"asset", "FILE|ASSET", "asset file, or the name or id of a daemon's asset", UMBU_TEXT,
     AT(asset), .needed = true},
    {"output", "FILE", "the picture, PNG; - is stdout", UMBU_TEXT, AT(output), .letter = 'o'},
    {UMBT_CAMERA_ROW(struct umbt_render_options, camera)},
    {UMBT_UP_ROW(struct umbt_render_options, up)},
    {UMBT_SIZE_ROW(struct umbt_render_options, size, 16384, "1280x720")},
    {"aa", "N", "N x N samples a pixel, 1 to 3", UMBU_COUNT(1, 3), AT(aa),
     .otherwise = "2; 1 with traced windows"},
    {"light", "N", "the asset's light", UMBU_COUNT(0, UMB_LIGHTS_MAX - 1), AT(settings.light),
     .standard = "0"},
    {"taps", "N", "filter width in texels", UMBU_ODD(1, UMB_TAPS_MAX), AT(settings.taps),
     .otherwise = "9; of penumbras and footprints 1"},
    {"filter", "NAME",
     "box, tent, gaussian, penumbra (half shadows of a light with an extent), or footprint (what "
     "each pixel covers of a surface)",
     UMBU_CHOICE(UMB_FILTER_NAMES), AT(settings.filter), .standard = "box"},
    {"light-size", "DEG", "for penumbras: the light's angular diameter",
     UMBU_ABOVE(0, UMB_EXTENT_MAX / RAD_A_DEG), .unit = "deg", .scale = RAD_A_DEG,
     AT(settings.light_extent), .otherwise = "the asset's"},
    {"bias", "B", "auto, none, 1.5vox or 0.02m", UMBU_BIAS, AT(settings), .otherwise = "auto"},
    {"fog", "D", "sunlit fog of extinction D per metre: light shafts, by segment queries",
     UMBU_ABOVE(0, FOG_MAX), AT(fog), .excludes = "traced|compare"},
    {"threads", "N", "threads that work", UMBU_COUNT(1, 256), AT(threads),
     .otherwise = "all processors"},
    {"force", NULL, "even if the asset was baked from another scene", UMBU_FLAG, AT(force)},
    {UMBU_JSON_ROW(struct umbt_render_options)},
    {UMBU_QUIET_ROW(struct umbt_render_options, "no progress, no summary")},
};

static const struct umbu_option TRACED[] = {
    {"traced", NULL,
     "shadows by rays instead of the asset: the reference; rays pass through translucent casters "
     "if the asset knows of any",
     UMBU_FLAG, AT(traced), .excludes = "compare"},
    {"compare", NULL,
     "both; prints how they differ where the surface faces the light (of opaque casters)",
     UMBU_FLAG, AT(compare)},
    {"difference", "FILE", "a picture, red where the asset is lighter, blue darker", UMBU_TEXT,
     AT(difference), .needs = "compare"},
    {"reference", "FILE", "the traced picture", UMBU_TEXT, AT(reference), .needs = "compare"},
    {"truth", "KIND",
     "what is traced: texels: a ray from each texel centre of the filter's window, at the moved "
     "point's depth; area: --samples N squared rays over the window's area around the moved point; "
     "surface: one ray from the surface; disc: as many rays over the light's disc",
     UMBU_CHOICE("texels|area|surface|disc"), AT(truth),
     .otherwise = "texels; one tap: surface; penumbras: disc; with --samples: area"},
    {"samples", "N", "rays a side for --truth area and disc, 1 to 64", UMBU_COUNT(1, 64),
     AT(samples), .otherwise = "16"},
};

static const struct umbu_command COMMAND = {
    .name = "umbrage render",
    .usage = "umbrage render SCENE --asset FILE|ASSET -o OUT.png [options]",
    .summary = "Makes a picture of a scene with the shadows of an asset that was baked from it.",
    .notes = "Exit codes: 0 ok, 2 usage, 65 bad data, 66 no input, 69 unavailable, 73 cannot\n"
             "create, 74 I/O, 75 temporary.",
    .sections = {{"options", UMBU_ROWS(OPTIONS)},
                 {"rays", UMBU_ROWS(TRACED)},
                 UMBU_SESSION(struct umbt_render_options, daemon)},
};

/* Fills in what depends on other options. */
static enum umb_status options_complete(const struct umbu_parsed *parsed,
                                        struct umbt_render_options *options,
                                        struct umb_error *error)
{
    struct umb_query_settings *settings = &options->settings;
    const struct umb_filter_info *filter = umb_filter_get_info(settings->filter);
    settings->format = UMB_ANSWER_F32;
    if (settings->taps == 0) {
        settings->taps = filter->is_window ? 9 : 1; /* the least width of other filters */
    }
    if (!umbu_given(parsed, "truth")) {
        options->truth = filter->has_extent     ? UMBT_TRUTH_DISC
                         : options->samples > 0 ? UMBT_TRUTH_AREA
                         : settings->taps > 1   ? UMBT_TRUTH_TEXELS
                                                : UMBT_TRUTH_SURFACE;
    }
    if (options->samples > 0 && options->truth != UMBT_TRUTH_AREA &&
        options->truth != UMBT_TRUTH_DISC) {
        return umb_fail(error, UMB_E_ARGUMENT, "--samples: only --truth area and disc take it");
    }
    const int windows =
        (options->traced || options->compare) && options->truth != UMBT_TRUTH_SURFACE;
    options->samples = options->samples > 0 ? options->samples : 16;
    options->aa = options->aa > 0 ? options->aa : windows ? 1 : 2;
    return UMB_OK;
}

/* Refuses a second output to stdout. */
static enum umb_status stdout_check(struct umbt_render_options *options, struct umb_error *error)
{
    const int pictures = umbu_output_is_stdout(options->output) +
                         umbu_output_is_stdout(options->reference) +
                         umbu_output_is_stdout(options->difference);
    options->to_stdout = pictures > 0;
    return pictures > 0 && pictures + options->json > 1
               ? umb_fail(error, UMB_E_ARGUMENT,
                          "-o, --reference, --difference, --json: only one of them can have stdout")
               : UMB_OK;
}

/* Checks combinations of options. */
static enum umb_status options_check(const struct umbt_render_options *options,
                                     struct umb_error *error)
{
    if (options->output == NULL && !options->compare) {
        return umb_fail(error, UMB_E_ARGUMENT, "-o: is needed; see --help");
    }
    if (options->fog > 0.0 && !umbt_source_is_file(options->asset)) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "--fog: segments are asked from files, %.80s is a daemon's asset",
                        options->asset);
    }
    if ((options->traced || options->compare) && options->truth != UMBT_TRUTH_SURFACE &&
        options->truth != UMBT_TRUTH_DISC && !umbt_source_is_file(options->asset)) {
        return umb_fail(
            error, UMB_E_ARGUMENT,
            "--truth: a window's rays need the asset as a file, %.80s is a daemon's; give "
            "--truth surface",
            options->asset);
    }
    return UMB_OK;
}

int umbt_render_options_parse(int argc, char **argv, struct umbt_render_options *options)
{
    struct umbu_parsed parsed;
    struct umb_error error;
    memset(options, 0, sizeof *options);
    options->threads = umbu_processor_count();
    const int code = umbu_start(&parsed, &COMMAND, argc, argv, options);
    if (code >= 0) {
        return code;
    }
    enum umb_status status = stdout_check(options, &error);
    if (status == UMB_OK) {
        status = options_complete(&parsed, options, &error);
    }
    if (status == UMB_OK) {
        status = options_check(options, &error);
    }
    if (status != UMB_OK) {
        (void)fprintf(stderr, "umbrage render: %s\n", error.message);
    }
    return status == UMB_OK ? -1 : umbu_exit_code(status);
}

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * `render`: a picture of a scene with its shadows, and its difference from a ray-traced one.
 *
 * Outputs are written only after everything was rendered; each replaces its file atomically.
 */
#include "study/study_command.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>
#include "base/try.h"
#include "tool/json.h"
#include "tool/clock.h"
#include "tool/output.h"
#include "tool/session.h"
#include "tool/threads.h"
#include "study/setup.h"
#include "study/study_picture.h"
#include "study/study_math.h"

struct options {
    const char *scene, *asset;
    struct umbu_session daemon;
    const char *output, *reference, *difference; /* Names of PNG files, or NULL */
    struct umbt_camera_request camera;
    struct umb_query_settings settings; /* format UMB_ANSWER_F32 */
    uint32_t size[2];                   /* Pixels */
    uint32_t aa;                        /* Sub-samples a side of a pixel */
    uint64_t threads;
    int traced, compare;
    enum umbt_truth_kind truth;
    uint32_t samples;
    double fog;  /* Extinction, 1/m; 0: clear air */
    unsigned up; /* 0 by the scene's format, 1 y, 2 z */
    int force, json, quiet;
    int to_stdout; /* 1: one of the pictures goes to stdout */
};

struct render {
    struct options options;
    struct umbt_scene scene;
    struct umbt_shadow_source source;
    struct umbt_setup setup;
    struct umbt_truth truth;
    struct umbt_fog fog;
    struct umbt_picture asset, traced, difference;
    struct umbt_picture_result result;
    double load_s;
};

#define AT(field) UMBU_AT(struct options, field)
#define FOG_MAX   100.0 /* 1/m: the view ends after some centimetres */
#define RAD_A_DEG 0.017453292519943295

static const struct umbu_option OPTIONS[] = {
    {UMBT_SCENE_ROW(struct options, scene)},
    {"asset", "FILE|ASSET", "asset file, or name or id of a daemon's asset", UMBU_TEXT, AT(asset),
     .needed = true},
    {"output", "FILE", "PNG file of the picture; - is stdout", UMBU_TEXT, AT(output),
     .letter = 'o'},
    {UMBT_CAMERA_ROW(struct options, camera)},
    {UMBT_UP_ROW(struct options, up)},
    {UMBT_SIZE_ROW(struct options, size, 16384, "1280x720")},
    {"aa", "N", "sub-samples a side of a pixel, 1 to 3: N x N samples", UMBU_COUNT(1, 3), AT(aa),
     .otherwise = "2; 1 with traced windows"},
    {"light", "N", "number of the asset's light", UMBU_COUNT(0, UMB_LIGHTS_MAX - 1),
     AT(settings.light), .standard = "0"},
    {"taps", "N", "width of the filter in texels", UMBU_ODD(1, UMB_TAPS_MAX), AT(settings.taps),
     .otherwise = "9; 1 with --filter penumbra or footprint"},
    {"filter", "NAME",
     "filter of the shadows: box, tent, gaussian, penumbra (half shadows of a light with an "
     "extent), or "
     "footprint (the part of a surface that each pixel covers)",
     UMBU_CHOICE(UMB_FILTER_NAMES), AT(settings.filter), .standard = "box"},
    {"light-size", "DEG", "angular diameter of the light in degrees, for --filter penumbra",
     UMBU_ABOVE(0, UMB_EXTENT_MAX / RAD_A_DEG), .unit = "deg", .scale = RAD_A_DEG,
     AT(settings.light_extent), .otherwise = "the asset's"},
    {"bias", "B", "distance that points move off their surface: auto, none, 1.5vox or 0.02m",
     UMBU_BIAS, AT(settings), .otherwise = "auto"},
    {"fog", "D", "extinction of sunlit fog per metre, above 0 to 100: shows light shafts",
     UMBU_ABOVE(0, FOG_MAX), AT(fog), .excludes = "traced|compare"},
    {UMBT_THREADS_ROW(struct options)},
    {"force", NULL, "goes on even if the asset was baked from another scene", UMBU_FLAG, AT(force)},
    {UMBU_JSON_ROW(struct options)},
    {UMBU_QUIET_ROW(struct options, "no progress, no summary")},
};

static const struct umbu_option TRACED[] = {
    {"traced", NULL,
     "takes the shadows from rays instead of the asset; rays pass through translucent casters if "
     "the asset knows of any",
     UMBU_FLAG, AT(traced), .excludes = "compare"},
    {"compare", NULL,
     "draws both, and prints how they differ where the surface faces the light; opaque casters "
     "only",
     UMBU_FLAG, AT(compare)},
    {"difference", "FILE",
     "PNG file of the difference: red where the asset is lighter, blue where it is darker",
     UMBU_TEXT, AT(difference), .needs = "compare"},
    {"reference", "FILE", "PNG file of the traced picture", UMBU_TEXT, AT(reference),
     .needs = "compare"},
    {"truth", "KIND",
     "start of the rays. texels: the texel centres of the filter's window, at the moved point's "
     "depth; area: --samples x --samples places in the window's area around the moved point; "
     "surface: the surface, one ray; disc: the surface, --samples x --samples rays over the "
     "light's disc",
     UMBU_CHOICE("texels|area|surface|disc"), AT(truth),
     .otherwise = "texels; surface with one tap, disc with penumbras, area with --samples"},
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
                 UMBU_SESSION(struct options, daemon)},
};

/* Fills in what depends on other options. */
static enum umb_status options_complete(const struct umbu_parsed *parsed, struct options *options,
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

/* Checks combinations of options. */
static enum umb_status options_check(struct options *options, struct umb_error *error)
{
    const int pictures = umbu_output_is_stdout(options->output) +
                         umbu_output_is_stdout(options->reference) +
                         umbu_output_is_stdout(options->difference);
    const int traced = options->traced || options->compare;
    options->to_stdout = pictures > 0;
    if (pictures > 0 && pictures + options->json > 1) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "-o, --reference, --difference, --json: only one of them can have stdout");
    }
    if (options->output == NULL && !options->compare) {
        return umb_fail(error, UMB_E_ARGUMENT, "-o: is needed; see --help");
    }
    if (options->fog > 0.0 && !umbt_shadow_source_is_file(options->asset)) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "--fog: needs the asset as a file, and %.80s is a daemon's asset",
                        options->asset);
    }
    if (traced && options->truth != UMBT_TRUTH_SURFACE && options->truth != UMBT_TRUTH_DISC &&
        !umbt_shadow_source_is_file(options->asset)) {
        return umb_fail(
            error, UMB_E_ARGUMENT,
            "--truth: a window's rays need the asset as a file, %.80s is a daemon's; give "
            "--truth surface",
            options->asset);
    }
    return UMB_OK;
}

static const char *truth_name(enum umbt_truth_kind kind)
{
    static const char *const names[] = {"texels", "area", "surface", "disc"};
    return names[kind];
}

/* Checks the outputs before the work, so that an unwritable one is found early. */
static enum umb_status outputs_check(const struct options *options, struct umb_error *error)
{
    const char *const paths[] = {options->output, options->reference, options->difference};
    for (size_t i = 0; i < sizeof paths / sizeof paths[0]; i++) {
        UMB__TRY(paths[i] != NULL ? umbu_output_check(paths[i], UMBU_OUTPUT_COMMAND, error)
                                  : UMB_OK);
    }
    return UMB_OK;
}

static enum umb_status inputs_open(struct render *render, struct umb_error *error)
{
    struct options *options = &render->options;
    const double start = umbu_clock_s();
    options->settings.opaque_only = options->compare; /* rays know only opaque and open */
    UMB__TRY(umbt_shadow_source_open(&render->source, options->asset, &options->daemon,
                                     &options->settings, error));
    UMB__TRY((render->source.translucent ? umbt_scene_init_opaque
                                         : umbt_scene_init)(&render->scene, options->scene, error));
    if (!options->force) {
        UMB__TRY(
            umbt_scene_match(&render->scene, options->asset, render->source.scene_hash, error));
    }
    render->load_s = umbu_clock_s() - start;
    return UMB_OK;
}

/* Fails for a lamp with the truth of a light's disc, which is traced for parallel light only. */
static enum umb_status truth_check(const struct render *render, struct umb_error *error)
{
    const struct options *options = &render->options;
    const struct umbt_truth *truth = &render->truth;
    if ((options->traced || options->compare) && truth->kind == UMBT_TRUTH_DISC &&
        (truth->lamp != NULL || !(truth->extent > 0))) {
        return umb_fail(error, UMB_E_UNSUPPORTED, "--truth disc: light %u is %s",
                        options->settings.light,
                        truth->lamp != NULL ? "not directional" : "a point; give --light-size");
    }
    return UMB_OK;
}

static enum umb_status view_make(struct render *render, struct umb_error *error)
{
    struct options *options = &render->options;
    struct umbt_setup *setup = &render->setup;
    struct umbt_truth *truth = &render->truth;
    setup->scene = &render->scene;
    setup->z_up = options->up > 0 ? options->up == 2 : render->scene.scene->view.z_up;
    *truth = (struct umbt_truth){
        .rays = render->scene.rays,
        .kind = options->truth,
        .settings = options->settings,
        .samples = options->samples,
        .extent = options->settings.light_extent > 0 ? options->settings.light_extent
                                                     : render->source.light.extent,
        .diagonal_m = render->scene.diagonal_m,
        .frustum = render->source.frustum,
        .closed = render->source.frustum.closed ? render->scene.parts.closed : NULL,
    };
    memcpy(truth->origin, render->source.origin, sizeof truth->origin);
    const struct umb_light_info *light = &render->source.light;
    if (light->kind != UMB_LIGHT_DIRECTIONAL) {
        truth->lamp = light;
        truth->frusta = render->source.frusta;
        truth->frustum_count = light->frustum_count;
    }
    /* A point light has no direction: the scene is shown as if lit from above. */
    for (int k = 0; k < 3; k++) {
        truth->to_light[k] =
            light->kind == UMB_LIGHT_POINT ? k == (setup->z_up ? 2 : 1) : -light->direction[k];
    }
    memcpy(setup->to_light, truth->to_light, sizeof setup->to_light);
    UMB__TRY(truth_check(render, error));
    UMB__TRY(umbt_setup_camera(setup, &options->camera, options->size, error));
    const double rows = (double)options->size[1] * options->aa;
    return umb_filter_get_info(options->settings.filter)->has_footprints
               ? umbt_shadow_source_look(&render->source, setup->camera.eye,
                                         2.0 * setup->camera.tan_y / rows, error)
               : UMB_OK;
}

/* Makes a picture, if it is wanted. */
static enum umb_status picture_make(const struct options *options, int wanted,
                                    struct umbt_picture *picture, struct umb_error *error)
{
    return wanted ? umbt_picture_init(picture, options->size[0], options->size[1], error) : UMB_OK;
}

static enum umb_status frame_make(struct render *render, struct umb_error *error)
{
    const struct options *options = &render->options;
    const int from_asset = !options->traced;
    const int from_rays = options->traced || options->compare;
    UMB__TRY(picture_make(options, from_asset, &render->asset, error));
    UMB__TRY(picture_make(options, from_rays, &render->traced, error));
    UMB__TRY(picture_make(options, options->difference != NULL, &render->difference, error));
    if (options->fog > 0.0) {
        UMB__TRY(umbt_fog_make(render->source.asset, options->settings.light, options->fog,
                               &render->fog, error));
    }
    const struct umbt_picture_request request = {
        .setup = &render->setup,
        .source = from_asset ? &render->source : NULL,
        .truth = from_rays ? &render->truth : NULL,
        .fog = options->fog > 0.0 ? &render->fog : NULL,
        .lamp = render->truth.lamp,
        .aa = options->aa,
        .threads = (unsigned)options->threads,
        .asset = from_asset ? &render->asset : NULL,
        .traced = from_rays ? &render->traced : NULL,
        .difference = options->difference != NULL ? &render->difference : NULL,
        .quiet = options->quiet,
    };
    return umbt_picture_render(&request, &render->result, error);
}

static enum umb_status pictures_write(const struct render *render, struct umb_error *error)
{
    const struct options *options = &render->options;
    const struct {
        const char *path;
        const struct umbt_picture *picture;
    } outputs[] = {{options->output, options->traced ? &render->traced : &render->asset},
                   {options->reference, &render->traced},
                   {options->difference, &render->difference}};
    for (size_t i = 0; i < sizeof outputs / sizeof outputs[0]; i++) {
        if (outputs[i].path != NULL) {
            UMB__TRY(umbt_picture_write(outputs[i].picture, outputs[i].path, error));
        }
    }
    return UMB_OK;
}

/* Returns 1 if windows into closed solids can be found: a daemon gives too little data. */
static int undefined_is_known(const struct render *render)
{
    return render->source.asset != NULL;
}

static void compare_text(FILE *to, const struct render *render)
{
    const struct umbt_picture_result *result = &render->result;
    fprintf(to,
            "asset against rays (%s) on %" PRIu64 " samples that face the light:\n"
            "  mean absolute difference %.5f (asset lighter %.5f, darker %.5f)\n"
            "  differing by more than 0.5: %.4f %%\n",
            truth_name(render->options.truth), result->facing, result->mean_difference,
            result->mean_lighter, result->mean_darker, 100.0 * result->over_half);
    if (render->source.translucent) {
        fprintf(to, "  translucent casters: not traced, %s\n",
                render->source.asset != NULL ? "nor asked for" : "but in the daemon's answers");
    }
    if (undefined_is_known(render)) {
        fprintf(to, "  without %" PRIu64 " windows that reach into closed solids: %.5f, %.4f %%\n",
                result->undefined, result->mean_defined, 100.0 * result->over_half_defined);
    }
    fprintf(to,
            "  facing it by more than %g, %" PRIu64 " samples: false shadow %.4f %%, false light "
            "%.4f %%\n",
            UMBT_JUDGED_FACING, result->judged, 100.0 * result->false_shadow,
            100.0 * result->false_light);
    fprintf(to, "  pictures: mean absolute difference %.5f of full scale\n",
            result->picture_difference);
}

static void put_compared(struct umbu_json *json, const struct render *render)
{
    const struct umbt_picture_result *result = &render->result;
    umbu_json_text(json, "truth", truth_name(render->options.truth));
    umbu_json_integer(json, "judged", result->judged);
    UMBU_JSON_VALUES(json, 9, {"mean_difference", result->mean_difference},
                     {"mean_lighter", result->mean_lighter}, {"mean_darker", result->mean_darker},
                     {"over_half", result->over_half},
                     {"picture_difference", result->picture_difference},
                     {"false_shadow", result->false_shadow}, {"false_light", result->false_light});
    if (undefined_is_known(render)) {
        umbu_json_integer(json, "undefined", result->undefined);
        UMBU_JSON_VALUES(json, 9, {"mean_defined", result->mean_defined},
                         {"over_half_defined", result->over_half_defined});
    }
}

static void report_text(FILE *to, const struct render *render)
{
    const struct options *options = &render->options;
    const struct umbt_picture_result *result = &render->result;
    const struct umbt_camera *camera = &render->setup.camera;
    fprintf(to, "%zu triangles, %ux%u pixels, %" PRIu64 " samples, %" PRIu64 " on the scene\n",
            render->scene.count, options->size[0], options->size[1], result->samples,
            result->receivers);
    fprintf(to, "camera eye=%.9g,%.9g,%.9g,target=%.9g,%.9g,%.9g,fov=%.6g\n", camera->eye[0],
            camera->eye[1], camera->eye[2], camera->eye[0] + camera->forward[0],
            camera->eye[1] + camera->forward[1], camera->eye[2] + camera->forward[2],
            umbt_camera_fov_deg(camera));
    fprintf(to, "load %.2f s, surfaces %.2f s", render->load_s, result->gbuffer_s);
    if (!options->traced) {
        fprintf(to, ", asset %.2f s (%.2f Mpoints/s)", result->query_s,
                result->query_s > 0.0 ? 1e-6 * (double)result->receivers / result->query_s : 0.0);
    }
    if (options->traced || options->compare) {
        fprintf(to, ", rays %.2f s", result->trace_s);
    }
    fprintf(to, "\n");
    if (options->compare) {
        compare_text(to, render);
    }
}

static void report_json(const struct render *render)
{
    const struct options *options = &render->options;
    const struct umbt_picture_result *result = &render->result;
    struct umbu_json json = {.file = stdout};
    char id[UMB_ID_TEXT_SIZE];
    umb_id_to_text(render->source.id, id);
    umbu_json_begin(&json, NULL, '{');
    umbu_json_text(&json, "asset", id);
    umbu_json_text(&json, "scene", options->scene);
    if (options->output != NULL) {
        umbu_json_text(&json, "picture", options->output);
    }
    UMBU_JSON_COUNTS(&json, {"triangles", render->scene.count}, {"width", options->size[0]},
                     {"height", options->size[1]}, {"samples", result->samples},
                     {"receivers", result->receivers}, {"facing", result->facing},
                     {"taps", options->settings.taps}, {"outside", result->stats.outside},
                     {"before", result->stats.before}, {"behind", result->stats.behind},
                     {"facing_away", result->stats.facing_away}, {"nodes", result->stats.nodes},
                     {"bricks", result->stats.bricks});
    UMBU_JSON_VALUES(&json, 6, {"load_s", render->load_s}, {"surface_s", result->gbuffer_s},
                     {"query_s", result->query_s}, {"trace_s", result->trace_s});
    if (options->compare) {
        put_compared(&json, render);
    }
    umbu_json_close(&json);
}

static enum umb_status render_run(const struct umbu_parsed *parsed, struct render *render,
                                  struct umb_error *error)
{
    const struct options *options = &render->options;
    UMB__TRY(options_complete(parsed, &render->options, error));
    UMB__TRY(options_check(&render->options, error));
    UMB__TRY(outputs_check(options, error));
    UMB__TRY(inputs_open(render, error));
    UMB__TRY(view_make(render, error));
    UMB__TRY(frame_make(render, error));
    UMB__TRY(pictures_write(render, error));
    if (options->json) {
        report_json(render);
    } else if (!options->quiet || options->compare) {
        report_text(options->to_stdout ? stderr : stdout, render);
    }
    return UMB_OK;
}

int umbt_render_command(int argc, char **argv)
{
    struct render render;
    struct umb_error error = {0};
    struct umbu_parsed parsed;
    memset(&render, 0, sizeof render);
    render.options.threads = umbu_processor_count();
    const int code = umbu_start(&parsed, &COMMAND, argc, argv, &render.options);
    if (code >= 0) {
        return code;
    }
    const enum umb_status status = render_run(&parsed, &render, &error);
    umbt_picture_finish(&render.asset);
    umbt_picture_finish(&render.traced);
    umbt_picture_finish(&render.difference);
    umbt_scene_finish(&render.scene);
    umbt_shadow_source_close(&render.source);
    return umbu_end(&COMMAND, status, &error);
}

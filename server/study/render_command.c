/* SPDX-License-Identifier: Apache-2.0 */
/*
 * `render`: a picture of a scene with its shadows, and its difference from a ray-traced one.
 *
 * Outputs are written only after everything was rendered; each replaces its file atomically.
 */
#include "study/setup.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>
#include "base/try.h"
#include "tool/clock.h"
#include "tool/output.h"
#include "tool/session.h"
#include "study/render_lights.h"
#include "study/study_picture.h"
#include "study/surface.h"

struct render {
    struct umbt_common common;
    const char *asset_name;
    struct umbu_session daemon;
    const char *reference, *difference; /* Names of PNG files, or NULL */
    struct umb_query_settings settings; /* format UMB_ANSWER_F32 */
    uint32_t aa;                        /* Sub-samples a side of a pixel */
    int is_traced, compare;
    enum umbt_truth_kind kind;
    uint32_t samples;
    double fog_density;            /* Extinction, 1/m; 0: clear air */
    int with_ground;               /* 1: draws a plane below the scene */
    struct umbt_light_list wanted; /* Lights of --light */
    struct umbt_render_lights lights;
    struct umbt_setup setup;
    struct umbt_ground ground;
    struct umbt_fog fog;
    struct umbt_pictures pictures;
    struct umbt_picture_result result;
    double load_s;
    int to_stdout; /* 1: one of the pictures goes to stdout */
};

static const char *const TRUTHS[] = {"texels", "area", "surface", "disc", "footprint"};

#define AT(field) UMBU_AT(struct render, field)
#define FOG_MAX   100.0 /* 1/m: the view ends after some centimetres */

static const struct umbu_option OPTIONS[] = {
    {UMBT_SCENE_ROW},
    {"asset", "FILE|ASSET", "asset file, or name or id of a daemon's asset", UMBU_TEXT,
     AT(asset_name), .needed = true},
    {"output", "FILE", "PNG file of the picture; - is stdout", UMBU_TEXT, UMBT_AT(output),
     .letter = 'o'},
    {UMBT_CAMERA_ROW},
    {UMBT_UP_ROW},
    {UMBT_SIZE_ROW(16384, "1280x720")},
    {"aa", "N", "sub-samples a side of a pixel, 1 to 3: N x N samples", UMBU_COUNT(1, 3), AT(aa),
     .otherwise = "2; 1 with traced windows"},
    {"light", "N", "number of a light to draw; may be repeated, and the lights add up",
     UMBT_READ_LIGHT, AT(wanted), .otherwise = "all, with --fog or more than 16 the first",
     .fields = "light"},
    {.setting = "taps", AT(settings.taps), .otherwise = "9; 1 with --filter penumbra or footprint"},
    {.setting = "filter", AT(settings.filter), .standard = "footprint"},
    {UMBU_LIGHT_SIZE_ROW(struct render, settings.light_extent)},
    {UMBU_BIAS_ROW(struct render, settings)},
    {UMBU_OTHER_SETTINGS(struct render, settings,
                         "format|footprint_m|eye|pixel_rad|level|opaque_only")},
    {"ground", NULL,
     "draws a level opaque plane at the scene's foot, which receives shadows and casts none",
     UMBU_FLAG, AT(with_ground)},
    {"fog", "D", "extinction of sunlit fog per metre, above 0 to 100: shows light shafts",
     UMBU_ABOVE(0, FOG_MAX), AT(fog_density), .excludes = "traced|compare"},
    {UMBT_THREADS_ROW},
    {UMBT_FORCE_ROW},
    {UMBT_JSON_ROW},
    {UMBT_QUIET_ROW("no progress, no summary")},
};

static const struct umbu_option TRACED[] = {
    {"traced", NULL,
     "takes the shadows from rays instead of the asset; translucent casters take their share of "
     "a ray's light if the asset was baked with them",
     UMBU_FLAG, AT(is_traced), .excludes = "compare"},
    {"compare", NULL, "draws both, and prints how they differ where the surface faces the light",
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
     "light's disc; footprint: --samples x --samples places of the surface that a pixel covers",
     UMBU_CHOICE("texels|area|surface|disc|footprint"), AT(kind),
     .otherwise = "texels; surface with one tap, disc with penumbras; with --samples footprint, or "
                  "area with another filter"},
    {"samples", "N", "rays a side for --truth area, disc and footprint, 1 to 64", UMBU_COUNT(1, 64),
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
                 UMBU_SESSION(struct render, daemon)},
};

/* Fills in what depends on other options. */
static enum umb_status options_complete(const struct umbu_parsed *parsed, struct render *render,
                                        struct umb_error *error)
{
    struct umb_query_settings *settings = &render->settings;
    const struct umb_filter_info *filter = umb_filter_get_info(settings->filter);
    settings->format = UMB_ANSWER_F32;
    if (settings->taps == 0) {
        settings->taps = filter->is_window ? 9 : 1; /* the least width of other filters */
    }
    if (!umbu_given(parsed, "truth")) {
        const int spread = render->samples > 0;
        render->kind = filter->has_extent                 ? UMBT_TRUTH_DISC
                       : spread && filter->has_footprints ? UMBT_TRUTH_FOOTPRINT
                       : spread                           ? UMBT_TRUTH_AREA
                       : settings->taps > 1               ? UMBT_TRUTH_TEXELS
                                                          : UMBT_TRUTH_SURFACE;
    }
    if (render->samples > 0 &&
        (render->kind == UMBT_TRUTH_TEXELS || render->kind == UMBT_TRUTH_SURFACE)) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "--samples: only --truth area, disc and footprint take it");
    }
    const int windows =
        (render->is_traced || render->compare) && render->kind != UMBT_TRUTH_SURFACE;
    render->samples = render->samples > 0 ? render->samples : 16;
    render->aa = render->aa > 0 ? render->aa : windows ? 1 : 2;
    return UMB_OK;
}

enum {
    OUTPUTS = 3
};

/* A picture and the file that it goes to; NULL: none. */
struct output {
    const char *path;
    const struct umbt_picture *picture;
};

static void outputs_list(const struct render *render, struct output outputs[OUTPUTS])
{
    const struct umbt_pictures *pictures = &render->pictures;
    outputs[0] = (struct output){render->common.output,
                                 render->is_traced ? &pictures->traced : &pictures->asset};
    outputs[1] = (struct output){render->reference, &pictures->traced};
    outputs[2] = (struct output){render->difference, &pictures->difference};
}

static enum umb_status options_check(struct render *render, struct umb_error *error)
{
    struct output outputs[OUTPUTS];
    int pictures = 0;
    outputs_list(render, outputs);
    for (int i = 0; i < OUTPUTS; i++) {
        pictures += umbu_output_is_stdout(outputs[i].path);
    }
    const int traced = render->is_traced || render->compare;
    render->to_stdout = pictures > 0;
    if (pictures > 0 && pictures + render->common.json > 1) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "-o, --reference, --difference, --json: only one of them can have stdout");
    }
    if (render->common.output == NULL && !render->compare) {
        return umb_fail(error, UMB_E_ARGUMENT, "-o: is needed; see --help");
    }
    if (render->fog_density > 0.0 && !umbt_shadow_source_is_file(render->asset_name)) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "--fog: needs the asset as a file, and %.80s is a daemon's asset",
                        render->asset_name);
    }
    if (traced && (render->kind == UMBT_TRUTH_TEXELS || render->kind == UMBT_TRUTH_AREA) &&
        !umbt_shadow_source_is_file(render->asset_name)) {
        return umb_fail(
            error, UMB_E_ARGUMENT,
            "--truth: a window's rays need the asset as a file, %.80s is a daemon's; give "
            "--truth surface",
            render->asset_name);
    }
    for (int i = 0; i < OUTPUTS; i++) { /* finds an unwritable one early */
        UMB__TRY(outputs[i].path != NULL
                     ? umbu_output_check(outputs[i].path, UMBU_OUTPUT_COMMAND, error)
                     : UMB_OK);
    }
    return UMB_OK;
}

static enum umb_status inputs_open(struct render *render, struct umb_error *error)
{
    const double start = umbu_clock_s();
    const struct umbt_shadow_source *first = &render->lights.sources[0];
    UMB__TRY(umbt_render_lights_open(&render->lights, &render->wanted, render->fog_density > 0.0,
                                     render->asset_name, &render->daemon, &render->settings,
                                     error));
    if (render->fog_density > 0.0 && render->lights.count > 1) {
        return umb_fail(error, UMB_E_ARGUMENT, "--fog: of one light; --light is given %u times",
                        render->lights.count);
    }
    UMB__TRY(umbt_scene_init(&render->common.scene, render->common.scene_path,
                             first->scene_flags | UMBT_SCENE_SEEN | UMBT_SCENE_LOOK, error));
    UMB__TRY(umbt_common_match(&render->common, render->asset_name, first->info.scene_hash, error));
    render->load_s = umbu_clock_s() - start;
    return UMB_OK;
}

/* Fails if --truth disc is wanted for a light without an extent: it traces rays to the light's
 * points. */
static enum umb_status truths_check(const struct render *render, struct umb_error *error)
{
    for (uint32_t i = 0; i < render->lights.count; i++) {
        const struct umbt_truth *truth = &render->lights.truths[i];
        const double extent = truth->lamp != NULL ? truth->lamp->extent : truth->extent;
        if ((render->is_traced || render->compare) && truth->kind == UMBT_TRUTH_DISC &&
            !(extent > 0)) {
            return umb_fail(error, UMB_E_UNSUPPORTED, "--truth disc: light %u is a point; %s",
                            render->lights.numbers[i],
                            truth->lamp != NULL ? "bake it with --light-size or --area"
                                                : "give --light-size");
        }
    }
    return UMB_OK;
}

/* Makes the camera, and what depends on where it stands. */
static enum umb_status view_make(struct render *render, struct umb_error *error)
{
    struct umbt_setup *setup = &render->setup;
    struct umbt_render_lights *lights = &render->lights;
    setup->scene = &render->common.scene;
    setup->z_up = umbt_is_z_up(&render->common);
    setup->with_ground = render->with_ground;
    umbt_direction_to(&lights->sources[0].light, setup->z_up, setup->to_light);
    umbt_render_lights_set(lights, setup->scene, setup->z_up, render->kind, render->samples);
    UMB__TRY(truths_check(render, error));
    UMB__TRY(umbt_setup_camera(setup, &render->common.camera, render->common.size, error));
    if (render->with_ground) {
        render->ground = umbt_ground_below(setup->scene, &setup->camera, setup->z_up);
    }
    UMB__TRY(umbt_picture_lights_weigh(setup, &render->ground, lights->numbers,
                                       lights->sources[0].light_count, lights->lights,
                                       lights->count, error));
    const double pixel_rad =
        2.0 * setup->camera.tan_y / ((double)render->common.size[1] * render->aa);
    const int has_footprints = umb_filter_get_info(render->settings.filter)->has_footprints;
    for (uint32_t i = 0; i < lights->count; i++) {
        struct umb_query_settings *traced = &lights->truths[i].settings;
        memcpy(traced->eye, setup->camera.eye, sizeof traced->eye);
        traced->pixel_rad = pixel_rad;
        if (has_footprints) {
            UMB__TRY(
                umbt_shadow_source_look(&lights->sources[i], setup->camera.eye, pixel_rad, error));
        }
    }
    return UMB_OK;
}

static enum umb_status frame_make(struct render *render, struct umb_error *error)
{
    const int from_rays = render->is_traced || render->compare;
    struct umbt_render_lights *lights = &render->lights;
    if (render->fog_density > 0.0) {
        UMB__TRY(umbt_fog_make(lights->sources[0].asset, lights->numbers[0], render->fog_density,
                               &render->fog, error));
    }
    for (uint32_t i = 0; i < lights->count; i++) {
        lights->lights[i].source = render->is_traced ? NULL : lights->lights[i].source;
        lights->lights[i].truth = from_rays ? lights->lights[i].truth : NULL;
    }
    const struct umbt_picture_request request = {
        .setup = &render->setup,
        .size = {render->common.size[0], render->common.size[1]},
        .lights = lights->lights,
        .light_count = lights->count,
        .fog = render->fog_density > 0.0 ? &render->fog : NULL,
        .ground = render->ground,
        .aa = render->aa,
        .threads = render->common.threads,
        .difference = render->difference != NULL,
        .quiet = render->common.quiet,
    };
    return umbt_picture_render(&request, &render->pictures, &render->result, error);
}

static void compare_text(FILE *to, const struct render *render)
{
    const struct umbt_picture_result *result = &render->result;
    fprintf(to,
            "asset against rays (%s) on %" PRIu64 " samples that face the light:\n"
            "  mean absolute difference %.5f (asset lighter %.5f, darker %.5f)\n"
            "  differing by more than 0.5: %.4f %%\n",
            TRUTHS[render->kind], result->facing, result->mean_difference, result->mean_lighter,
            result->mean_darker, 100.0 * result->over_half);
    if (render->lights.sources[0].asset != NULL) { /* a daemon gives too little data */
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
    umbu_json_text(json, "truth", TRUTHS[render->kind]);
    umbu_json_integer(json, "judged", result->judged);
    UMBU_JSON_VALUES(json, 9, {"mean_difference", result->mean_difference},
                     {"mean_lighter", result->mean_lighter}, {"mean_darker", result->mean_darker},
                     {"over_half", result->over_half},
                     {"picture_difference", result->picture_difference},
                     {"false_shadow", result->false_shadow}, {"false_light", result->false_light});
    if (render->lights.sources[0].asset != NULL) {
        umbu_json_integer(json, "undefined", result->undefined);
        UMBU_JSON_VALUES(json, 9, {"mean_defined", result->mean_defined},
                         {"over_half_defined", result->over_half_defined});
    }
}

static void report_text(FILE *to, const void *state)
{
    const struct render *render = state;
    const struct umbt_picture_result *result = &render->result;
    const struct umbt_camera *camera = &render->setup.camera;
    to = render->to_stdout ? stderr : to;
    fprintf(to, "%zu triangles, %ux%u pixels, %" PRIu64 " samples, %" PRIu64 " on the scene\n",
            render->common.scene.count, render->common.size[0], render->common.size[1],
            result->samples, result->seen);
    if (result->translucent > 0) {
        fprintf(to, "%" PRIu64 " translucent surfaces before them\n", result->translucent);
    }
    if (render->lights.count > 1 || render->lights.left_out > 0) {
        fprintf(to, "%u light%s drawn, %u left out\n", render->lights.count,
                render->lights.count == 1 ? "" : "s", render->lights.left_out);
    }
    fprintf(to, "camera eye=%.9g,%.9g,%.9g,target=%.9g,%.9g,%.9g,fov=%.6g\n", camera->eye[0],
            camera->eye[1], camera->eye[2], camera->eye[0] + camera->forward[0],
            camera->eye[1] + camera->forward[1], camera->eye[2] + camera->forward[2],
            umbt_camera_fov_deg(camera));
    fprintf(to, "load %.2f s, surfaces %.2f s", render->load_s, result->gbuffer_s);
    if (!render->is_traced) {
        fprintf(to, ", asset %.2f s (%.2f Mpoints/s)", result->query_s,
                result->query_s > 0.0
                    ? 1e-6 * (double)result->receivers * render->lights.count / result->query_s
                    : 0.0);
    }
    if (render->is_traced || render->compare) {
        fprintf(to, ", rays %.2f s", result->trace_s);
    }
    fprintf(to, "\n");
    if (render->compare) {
        compare_text(to, render);
    }
}

static void report_json(struct umbu_json *json, const void *state)
{
    const struct render *render = state;
    const struct umbt_picture_result *result = &render->result;
    char id[UMB_ID_TEXT_SIZE];
    umb_id_to_text(render->lights.sources[0].info.id, id);
    umbu_json_text(json, "asset", id);
    umbu_json_text(json, "scene", render->common.scene_path);
    if (render->common.output != NULL) {
        umbu_json_text(json, "picture", render->common.output);
    }
    UMBU_JSON_COUNTS(json, {"triangles", render->common.scene.count},
                     {"width", render->common.size[0]}, {"height", render->common.size[1]},
                     {"samples", result->samples}, {"seen", result->seen},
                     {"receivers", result->receivers}, {"translucent", result->translucent},
                     {"lights", render->lights.count}, {"facing", result->facing},
                     {"taps", render->settings.taps}, {"outside", result->stats.outside},
                     {"before", result->stats.before}, {"behind", result->stats.behind},
                     {"facing_away", result->stats.facing_away}, {"nodes", result->stats.nodes},
                     {"bricks", result->stats.bricks});
    UMBU_JSON_VALUES(json, 6, {"load_s", render->load_s}, {"surface_s", result->gbuffer_s},
                     {"query_s", result->query_s}, {"trace_s", result->trace_s});
    if (render->compare) {
        put_compared(json, render);
    }
}

static enum umb_status render_run(void *state, const struct umbu_parsed *parsed,
                                  struct umb_error *error)
{
    struct render *render = state;
    struct output outputs[OUTPUTS];
    UMB__TRY(options_complete(parsed, render, error));
    UMB__TRY(options_check(render, error));
    UMB__TRY(inputs_open(render, error));
    UMB__TRY(view_make(render, error));
    UMB__TRY(frame_make(render, error));
    outputs_list(render, outputs);
    for (int i = 0; i < OUTPUTS; i++) {
        UMB__TRY(outputs[i].path != NULL
                     ? umbt_picture_write(outputs[i].picture, outputs[i].path, error)
                     : UMB_OK);
    }
    render->common.quiet &= !render->compare; /* --compare asks for the numbers */
    return UMB_OK;
}

static void finish(void *state)
{
    struct render *render = state;
    umbt_pictures_finish(&render->pictures);
    umbt_render_lights_close(&render->lights);
}

const struct umbt_command umbt_render = {&COMMAND,    sizeof(struct render), render_run,
                                         report_text, report_json,           finish};

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
#include "study/render_options.h"
#include "study/study_picture.h"
#include "study/study_vec.h"
#include "tool/exit_code.h"

struct render {
    struct umbt_render_options options;
    struct umbt_scene scene;
    struct umbt_source source;
    struct umbt_camera camera;
    struct umbt_truth truth;
    struct umbt_fog fog;
    struct umbt_picture asset, traced, difference;
    struct umbt_picture_result result;
    double load_s;
};

static const char *truth_name(enum umbt_truth_kind kind)
{
    static const char *const names[] = {"texels", "area", "surface", "disc"};
    return names[kind];
}

/* Checks the outputs before the work, so that an unwritable one is found early. */
static enum umb_status outputs_check(const struct umbt_render_options *options,
                                     struct umb_error *error)
{
    const char *const paths[] = {options->output, options->reference, options->difference};
    enum umb_status status = UMB_OK;
    for (size_t i = 0; i < sizeof paths / sizeof paths[0] && status == UMB_OK; i++) {
        status =
            paths[i] != NULL ? umbu_output_check(paths[i], UMBU_OUTPUT_COMMAND, error) : UMB_OK;
    }
    return status;
}

static enum umb_status inputs_open(struct render *render, struct umb_error *error)
{
    struct umbt_render_options *options = &render->options;
    const double start = umbu_clock_s();
    options->settings.opaque_only = options->compare; /* rays know only opaque and open */
    enum umb_status status = umbt_source_init(&render->source, options->asset, &options->daemon,
                                              &options->settings, error);
    if (status == UMB_OK) {
        status = render->source.translucent
                     ? umbt_scene_init_opaque(&render->scene, options->scene, error)
                     : umbt_scene_init(&render->scene, options->scene, error);
    }
    if (status == UMB_OK && !options->force) {
        status = umbt_scene_match(&render->scene, options->asset, render->source.scene_hash, error);
    }
    render->load_s = umbu_clock_s() - start;
    return status;
}

/* Refuses the disc of a lamp: the light's disc is traced for parallel light only. */
static enum umb_status truth_check(const struct render *render, struct umb_error *error)
{
    const struct umbt_render_options *options = &render->options;
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
    struct umbt_render_options *options = &render->options;
    options->z_up = options->up > 0 ? options->up == 2 : render->scene.scene->view.z_up;
    struct umbt_truth *truth = &render->truth;
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
            light->kind == UMB_LIGHT_POINT ? k == (options->z_up ? 2 : 1) : -light->direction[k];
    }
    struct umbt_camera_subject subject = {
        .points = (const double(*)[3])render->scene.corners,
        .count = 3 * render->scene.count,
        .box = render->scene.box,
        .z_up = options->z_up,
    };
    memcpy(subject.to_light, truth->to_light, sizeof subject.to_light);
    UMB__TRY(truth_check(render, error));
    enum umb_status status = umbt_camera_make(&options->camera, &subject, options->size[0],
                                              options->size[1], &render->camera, error);
    if (status == UMB_OK && umb_filter_get_info(options->settings.filter)->has_footprints) {
        const double rows = (double)options->size[1] * options->aa;
        status = umbt_source_look(&render->source, render->camera.eye,
                                  2.0 * render->camera.tan_y / rows, error);
    }
    return status;
}

static enum umb_status frame_make(struct render *render, struct umb_error *error)
{
    const struct umbt_render_options *options = &render->options;
    const int from_asset = !options->traced;
    const int from_rays = options->traced || options->compare;
    enum umb_status status = UMB_OK;
    if (from_asset) {
        status = umbt_picture_init(&render->asset, options->size[0], options->size[1], error);
    }
    if (status == UMB_OK && from_rays) {
        status = umbt_picture_init(&render->traced, options->size[0], options->size[1], error);
    }
    if (status == UMB_OK && options->difference != NULL) {
        status = umbt_picture_init(&render->difference, options->size[0], options->size[1], error);
    }
    if (status == UMB_OK && options->fog > 0.0) {
        status = umbt_fog_make(render->source.asset, options->settings.light, options->fog,
                               &render->fog, error);
    }
    if (status != UMB_OK) {
        return status;
    }
    struct umbt_picture_request request = {
        .scene = &render->scene,
        .camera = &render->camera,
        .source = from_asset ? &render->source : NULL,
        .truth = from_rays ? &render->truth : NULL,
        .fog = options->fog > 0.0 ? &render->fog : NULL,
        .z_up = options->z_up,
        .aa = options->aa,
        .threads = options->threads,
        .asset = from_asset ? &render->asset : NULL,
        .traced = from_rays ? &render->traced : NULL,
        .difference = options->difference != NULL ? &render->difference : NULL,
        .quiet = options->quiet,
    };
    memcpy(request.to_light, render->truth.to_light, sizeof request.to_light);
    request.lamp = render->truth.lamp;
    return umbt_picture_render(&request, &render->result, error);
}

static enum umb_status pictures_write(const struct render *render, struct umb_error *error)
{
    const struct umbt_render_options *options = &render->options;
    enum umb_status status = UMB_OK;
    if (options->output != NULL) {
        status = umbt_picture_write(options->traced ? &render->traced : &render->asset,
                                    options->output, error);
    }
    if (status == UMB_OK && options->reference != NULL) {
        status = umbt_picture_write(&render->traced, options->reference, error);
    }
    if (status == UMB_OK && options->difference != NULL) {
        status = umbt_picture_write(&render->difference, options->difference, error);
    }
    return status;
}

/* A daemon does not give enough data to find the windows that reach into closed solids. */
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
    umbu_json_rounded(json, "mean_difference", result->mean_difference, 9);
    umbu_json_rounded(json, "mean_lighter", result->mean_lighter, 9);
    umbu_json_rounded(json, "mean_darker", result->mean_darker, 9);
    umbu_json_rounded(json, "over_half", result->over_half, 9);
    umbu_json_rounded(json, "picture_difference", result->picture_difference, 9);
    umbu_json_integer(json, "judged", result->judged);
    umbu_json_rounded(json, "false_shadow", result->false_shadow, 9);
    umbu_json_rounded(json, "false_light", result->false_light, 9);
    if (undefined_is_known(render)) {
        umbu_json_integer(json, "undefined", result->undefined);
        umbu_json_rounded(json, "mean_defined", result->mean_defined, 9);
        umbu_json_rounded(json, "over_half_defined", result->over_half_defined, 9);
    }
}

static void report_text(FILE *to, const struct render *render)
{
    const struct umbt_render_options *options = &render->options;
    const struct umbt_picture_result *result = &render->result;
    const struct umbt_camera *camera = &render->camera;
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
    const struct umbt_render_options *options = &render->options;
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
    umbu_json_integer(&json, "triangles", render->scene.count);
    umbu_json_integer(&json, "width", options->size[0]);
    umbu_json_integer(&json, "height", options->size[1]);
    umbu_json_integer(&json, "samples", result->samples);
    umbu_json_integer(&json, "receivers", result->receivers);
    umbu_json_integer(&json, "facing", result->facing);
    umbu_json_integer(&json, "taps", options->settings.taps);
    umbu_json_rounded(&json, "load_s", render->load_s, 6);
    umbu_json_rounded(&json, "surface_s", result->gbuffer_s, 6);
    umbu_json_rounded(&json, "query_s", result->query_s, 6);
    umbu_json_rounded(&json, "trace_s", result->trace_s, 6);
    umbu_json_integer(&json, "outside", result->stats.outside);
    umbu_json_integer(&json, "before", result->stats.before);
    umbu_json_integer(&json, "behind", result->stats.behind);
    umbu_json_integer(&json, "facing_away", result->stats.facing_away);
    umbu_json_integer(&json, "nodes", result->stats.nodes);
    umbu_json_integer(&json, "bricks", result->stats.bricks);
    if (options->compare) {
        put_compared(&json, render);
    }
    umbu_json_close(&json);
}

static enum umb_status render_run(struct render *render, struct umb_error *error)
{
    enum umb_status status = outputs_check(&render->options, error);
    if (status == UMB_OK) {
        status = inputs_open(render, error);
    }
    if (status == UMB_OK) {
        status = view_make(render, error);
    }
    if (status == UMB_OK) {
        status = frame_make(render, error);
    }
    if (status == UMB_OK) {
        status = pictures_write(render, error);
    }
    if (status != UMB_OK) {
        return status;
    }
    if (render->options.json) {
        report_json(render);
    } else if (!render->options.quiet || render->options.compare) {
        report_text(render->options.to_stdout ? stderr : stdout, render);
    }
    return UMB_OK;
}

int umbt_render_command(int argc, char **argv)
{
    struct render render;
    struct umb_error error = {0};
    memset(&render, 0, sizeof render);
    const int code = umbt_render_options_parse(argc, argv, &render.options);
    if (code >= 0) {
        return code;
    }
    const enum umb_status status = render_run(&render, &error);
    umbt_picture_finish(&render.asset);
    umbt_picture_finish(&render.traced);
    umbt_picture_finish(&render.difference);
    umbt_scene_finish(&render.scene);
    umbt_source_finish(&render.source);
    if (status != UMB_OK) {
        fprintf(stderr, "umbrage render: %s\n", error.message);
    }
    return umbu_exit_code(status);
}

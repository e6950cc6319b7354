/* SPDX-License-Identifier: Apache-2.0 */
/* Shared parts of the sub-commands; see setup.h. */
#include "study/setup.h"

#include <stdlib.h>
#include <string.h>
#include "base/try.h"
#include "study/frame_casters.h"
#include "study/study_math.h"
#include "tool/bake_settings.h"
#include "tool/output.h"
#include "tool/threads.h"

static void report(const struct umbt_command *command, const struct umbt_common *common)
{
    if (common->json) {
        struct umbu_json json = {.file = stdout};
        umbu_json_begin(&json, NULL, '{');
        command->json(&json, common);
        umbu_json_close(&json);
    } else if (!common->quiet) {
        command->text(umbu_output_talk(common->output), common);
    }
}

int umbt_command_run(const struct umbt_command *command, int argc, char **argv)
{
    struct umb_error error = {0};
    struct umbu_parsed parsed;
    struct umbt_common *common = calloc(1, command->bytes);
    if (common == NULL) {
        return umbu_end(command->options, umb_fail(&error, UMB_E_NO_MEMORY, "out of memory"),
                        &error);
    }
    common->threads = umbu_processor_count();
    int code = umbu_start(&parsed, command->options, argc, argv, common);
    if (code < 0) {
        const enum umb_status status = command->run(common, &parsed, &error);
        if (status == UMB_OK && command->text != NULL) {
            report(command, common);
        }
        command->finish(common);
        umbt_scene_finish(&common->scene);
        code = status == UMB_OK ? common->code : umbu_end(command->options, status, &error);
    }
    free(common);
    return code;
}

static enum umb_status read_sun(const struct umbu_option *option, const char *text, void *field,
                                struct umb_error *error)
{
    double *sun = field;
    sun[2] = 1.0;
    return umbu_read_numbers(text, 2, sun) && sun[1] > 0.0 && sun[1] <= 90.0
               ? UMB_OK
               : umbu_refuse(option, text, error);
}

enum umb_status umbt_read_camera(const struct umbu_option *option, const char *text, void *field,
                                 struct umb_error *error)
{
    (void)option;
    return umbt_camera_parse(text, field, error);
}

const struct umbu_option UMBT_SETUP_OPTIONS[UMBT_SETUP_COUNT] = {
    {"sun", "AZ,EL", "azimuth and elevation of the sun in degrees",
     UMBU_READ(read_sun, "AZIMUTH,ELEVATION with elevation above 0 to 90"), UMBT_AT(sun),
     .otherwise = "the scene's first sun, else 135,45"},
    {UMBT_CAMERA_ROW},
    {UMBT_UP_ROW},
    {UMBT_THREADS_ROW},
    {UMBT_JSON_ROW, .excludes = "output=-"},
    {UMBT_QUIET_ROW("print nothing but errors")},
};

int umbt_is_z_up(const struct umbt_common *common)
{
    const struct umbs_scene_view *view = &common->scene.scene->view;
    const char *warning = umbs_scene_up_warning(view);
    if (common->up == 0 && warning != NULL && !common->quiet) {
        fprintf(stderr, "umbrage: warning: %s\n", warning);
    }
    return common->up > 0 ? common->up == 2 : view->z_up;
}

enum umb_status umbt_common_match(const struct umbt_common *common, const char *asset,
                                  const uint8_t asset_hash[UMB_ID_BYTES], struct umb_error *error)
{
    return common->force
               ? UMB_OK
               : umbu_scene_match(asset, asset_hash, common->scene_path, common->scene.hash, error);
}

int umbt_scene_sun(const struct umbt_scene *scene, int z_up, double to_light[3])
{
    const struct umbs_scene_view *file = &scene->scene->view;
    if (file->light_count == 0 || file->lights[0].kind != UMB_LIGHT_DIRECTIONAL) {
        umbt_compass_vector(135.0, 45.0, z_up, to_light);
        return 0;
    }
    for (int k = 0; k < 3; k++) {
        to_light[k] = -file->lights[0].direction[k];
    }
    return 1;
}

struct umbt_camera_subject umbt_subject(const struct umbt_scene *scene, const double to_light[3],
                                        int z_up)
{
    struct umbt_camera_subject subject = {
        .points = (const double(*)[3])scene->corners,
        .count = 3 * scene->count,
        .box = scene->box,
        .z_up = z_up,
    };
    memcpy(subject.to_light, to_light, sizeof subject.to_light);
    return subject;
}

enum umb_status umbt_setup_camera(struct umbt_setup *setup,
                                  const struct umbt_camera_request *request, const uint32_t size[2],
                                  struct umb_error *error)
{
    const struct umbt_camera_subject whole =
        umbt_subject(setup->scene, setup->to_light, setup->z_up);
    struct umbt_camera_subject subject;
    double(*points)[3];
    UMB__TRY(umbt_frame_casters(setup->scene, request, &whole, size, setup->with_ground, &subject,
                                &points, error));
    const enum umb_status status =
        umbt_camera_make(request, &subject, size[0], size[1], &setup->camera, error);
    free(points);
    return status;
}

enum umb_status umbt_setup_open(struct umbt_common *common, struct umbt_setup *setup,
                                struct umb_error *error)
{
    UMB__TRY(umbt_scene_init(&common->scene, common->scene_path, 0, error));
    setup->scene = &common->scene;
    setup->z_up = umbt_is_z_up(common);
    if (common->sun[2] > 0.0) {
        umbt_compass_vector(common->sun[0], common->sun[1], setup->z_up, setup->to_light);
    } else if (umbt_scene_sun(&common->scene, setup->z_up, setup->to_light)) {
        (void)umbt_normalize(setup->to_light);
    }
    return umbt_setup_camera(setup, &common->camera, common->size, error);
}

/* SPDX-License-Identifier: Apache-2.0 */
/* A scene, a sun and a camera; see setup.h. */
#include "study/setup.h"

#include <string.h>
#include "base/try.h"
#include "study/study_math.h"

const struct umbu_option UMBT_SETUP_OPTIONS[UMBT_SETUP_COUNT] = {
    {"sun", "AZ,EL", "azimuth and elevation of the sun in degrees",
     UMBU_READ(umbt_read_sun, "AZIMUTH,ELEVATION with elevation above 0 to 90"),
     UMBU_AT(struct umbt_setup_options, sun), .otherwise = "the scene's first sun, else 135,45"},
    {UMBT_CAMERA_ROW(struct umbt_setup_options, camera)},
    {UMBT_UP_ROW(struct umbt_setup_options, up)},
    {UMBT_THREADS_ROW(struct umbt_setup_options)},
    {UMBU_JSON_ROW(struct umbt_setup_options), .excludes = "output=-"},
    {UMBU_QUIET_ROW(struct umbt_setup_options, "print nothing but errors")},
};

enum umb_status umbt_read_sun(const struct umbu_option *option, const char *text, void *field,
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
    const struct umbt_camera_subject subject =
        umbt_subject(setup->scene, setup->to_light, setup->z_up);
    return umbt_camera_make(request, &subject, size[0], size[1], &setup->camera, error);
}

enum umb_status umbt_setup_open(const struct umbt_setup_options *options, struct umbt_scene *scene,
                                struct umbt_setup *setup, struct umb_error *error)
{
    UMB__TRY(umbt_scene_init(scene, options->scene, error));
    setup->scene = scene;
    setup->z_up = options->up > 0 ? options->up == 2 : scene->scene->view.z_up;
    if (options->sun[2] > 0.0) {
        umbt_compass_vector(options->sun[0], options->sun[1], setup->z_up, setup->to_light);
    } else if (umbt_scene_sun(scene, setup->z_up, setup->to_light)) {
        (void)umbt_normalize(setup->to_light);
    }
    return umbt_setup_camera(setup, &options->camera, options->size, error);
}

/* SPDX-License-Identifier: Apache-2.0 */
/* A scene, a sun and a camera; see view_options.h. */
#include "study/view_options.h"

#include <string.h>
#include "base/try.h"
#include "study/study_vec.h"

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

static void sun_choose(const struct umbt_view_options *options, struct umbt_view *view)
{
    const struct umbs_scene_view *scene = &view->scene.scene->view;
    const int given = options->sun[2] > 0.0;
    view->z_up = options->up > 0 ? options->up == 2 : scene->z_up;
    umbt_compass_vector(given ? options->sun[0] : 135.0, given ? options->sun[1] : 45.0, view->z_up,
                        view->to_light);
    if (!given && scene->light_count > 0 && scene->lights[0].kind == UMB_LIGHT_DIRECTIONAL) {
        for (int k = 0; k < 3; k++) {
            view->to_light[k] = -scene->lights[0].direction[k];
        }
        (void)umbt_normalize(view->to_light);
    }
}

enum umb_status umbt_view_open(const struct umbt_view_options *options, const char *scene,
                               struct umbt_view *view, struct umb_error *error)
{
    memset(view, 0, sizeof *view);
    UMB__TRY(umbt_scene_init(&view->scene, scene, error));
    sun_choose(options, view);
    struct umbt_camera_subject subject = {
        .points = (const double(*)[3])view->scene.corners,
        .count = 3 * view->scene.count,
        .box = view->scene.box,
        .z_up = view->z_up,
    };
    memcpy(subject.to_light, view->to_light, sizeof subject.to_light);
    return umbt_camera_make(&options->camera, &subject, options->size[0], options->size[1],
                            &view->camera, error);
}

void umbt_view_close(struct umbt_view *view)
{
    umbt_scene_finish(&view->scene);
}

/* SPDX-License-Identifier: Apache-2.0 */
/* A scene, a sun and a camera; see view_options.h. */
#include "study/view_options.h"

#include <string.h>
#include "study/study_args.h"
#include "study/study_vec.h"

static enum umb_status sun_choose(const struct umbt_view_options *options, struct umbt_view *view,
                                  struct umb_error *error)
{
    const struct umbs_scene_view *scene = &view->scene.scene->view;
    view->z_up = scene->z_up;
    if (options->up != NULL) {
        const enum umb_status status = umbt_up_parse(options->up, &view->z_up, error);
        if (status != UMB_OK) {
            return status;
        }
    }
    if (options->sun != NULL) {
        const char *at = options->sun;
        double azimuth = 0.0, elevation = 0.0;
        const int ok = umbt_number_read(&at, &azimuth) && *at++ == ',' &&
                       umbt_number_read(&at, &elevation) && *at == '\0';
        if (!ok || !(elevation > 0.0 && elevation <= 90.0)) {
            return umb_fail(error, UMB_E_ARGUMENT,
                            "--sun: '%.60s' is not AZIMUTH,ELEVATION with elevation above 0 to 90",
                            options->sun);
        }
        umbt_compass_vector(azimuth, elevation, view->z_up, view->to_light);
        return UMB_OK;
    }
    umbt_compass_vector(135.0, 45.0, view->z_up, view->to_light);
    if (scene->light_count > 0 && scene->lights[0].kind == UMB_LIGHT_DIRECTIONAL) {
        for (int k = 0; k < 3; k++) {
            view->to_light[k] = -scene->lights[0].direction[k];
        }
        (void)umbt_normalize(view->to_light);
    }
    return UMB_OK;
}

static enum umb_status texts_parse(struct umbt_view_options *options,
                                   struct umbt_camera_request *request, struct umb_error *error)
{
    enum umb_status status = UMB_OK;
    if (options->size != NULL) {
        status = umbt_size_parse(options->size, &options->width, &options->height, error);
    }
    if (status == UMB_OK &&
        (options->width > options->size_max || options->height > options->size_max)) {
        status = umb_fail(error, UMB_E_ARGUMENT, "--size: '%.60s' is above %u a side",
                          options->size, options->size_max);
    }
    if (status == UMB_OK && options->camera != NULL) {
        status = umbt_camera_parse(options->camera, request, error);
    }
    return status;
}

enum umb_status umbt_view_open(struct umbt_view_options *options, const char *scene,
                               struct umbt_view *view, struct umb_error *error)
{
    struct umbt_camera_request request = {0};
    memset(view, 0, sizeof *view);
    enum umb_status status = texts_parse(options, &request, error);
    if (status == UMB_OK) {
        status = umbt_scene_init(&view->scene, scene, error);
    }
    if (status == UMB_OK) {
        status = sun_choose(options, view, error);
    }
    if (status != UMB_OK) {
        return status;
    }
    struct umbt_camera_subject subject = {
        .points = (const double(*)[3])view->scene.corners,
        .count = 3 * view->scene.count,
        .box = view->scene.box,
        .z_up = view->z_up,
    };
    memcpy(subject.to_light, view->to_light, sizeof subject.to_light);
    return umbt_camera_make(&request, &subject, options->width, options->height, &view->camera,
                            error);
}

void umbt_view_close(struct umbt_view *view)
{
    umbt_scene_finish(&view->scene);
}

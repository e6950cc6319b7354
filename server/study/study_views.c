/* SPDX-License-Identifier: Apache-2.0 */
/* The pictures of a study (study.h): the same view, drawn from the asset of each resolution, and
 * its difference from rays. */
#include "study/study.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/try.h"
#include "study/study_picture.h"

#define WIDTH  640
#define HEIGHT 360

int umbt_study_has_picture(const struct umbt_study *study, const struct umbt_study_result *result)
{
    const struct umbt_study_bake *bake = &study->bakes[result->bake];
    if (result->bake > 0 && bake[-1].resolution == bake->resolution) {
        return 0; /* the open one beside a closed one */
    }
    return result->method == UMBT_STUDY_DAG && result->level == 0 &&
           (result->taps == 1 || result->taps == 9);
}

void umbt_study_picture_name(const struct umbt_study *study, const struct umbt_study_result *result,
                             int difference, char *name, size_t size)
{
    (void)snprintf(name, size, "pictures/%s-%u%s.png", study->bakes[result->bake].name,
                   result->taps, difference ? "-difference" : "");
}

static enum umb_status picture_save(const struct umbt_study *study,
                                    const struct umbt_picture *picture, const char *name,
                                    struct umb_error *error)
{
    char path[UMBT_STUDY_PATH];
    UMB__TRY(umbt_study_path(study, name, path, error));
    return umbt_picture_write(picture, path, error);
}

enum umb_status umbt_study_camera(const struct umbt_study *study, const uint32_t size[2],
                                  struct umbt_setup *setup, struct umb_error *error)
{
    const struct umbt_camera_request fitted = {0};
    setup->scene = &study->common.scene;
    setup->z_up = study->z_up;
    memcpy(setup->to_light, study->points.to_light, sizeof setup->to_light);
    return umbt_setup_camera(setup, &fitted, size, error);
}

static enum umb_status result_draw(const struct umbt_study *study,
                                   const struct umbt_study_result *result,
                                   const struct umbt_setup *setup, struct umbt_pictures *pictures,
                                   struct umb_error *error)
{
    const struct umbt_study_bake *bake = &study->bakes[result->bake];
    struct umbt_shadow_source source = {
        .name = bake->name, .asset = bake->asset, .settings.taps = result->taps};
    const uint32_t first_light = 0;
    struct umbt_picture_result ignored;
    char name[128];
    UMB__TRY(umb_query_prepare(bake->asset, &source.settings, &source.query, error));
    struct umbt_truth truth = umbt_truth_of(&study->common.scene, setup->to_light,
                                            bake->info.origin, umbt_study_frustum(bake));
    truth.kind = UMBT_TRUTH_SURFACE;
    truth.settings = source.settings;
    truth.lamp = study->points.lamp;
    truth.frusta = bake->frusta;
    truth.frustum_count = bake->light.frustum_count;
    truth.closed = NULL; /* its numbers are not used */
    struct umbt_picture_light light = umbt_picture_sun(setup);
    light.source = &source;
    light.truth = &truth;
    light.lamp = study->points.lamp;
    if (light.lamp != NULL) {
        UMB__TRY(umbt_picture_lights_weigh(setup, &(const struct umbt_ground){0}, &first_light,
                                           study->light_count, &light, 1, error));
    }
    const struct umbt_picture_request request = {
        .setup = setup,
        .size = {WIDTH, HEIGHT},
        .lights = &light,
        .light_count = 1,
        .aa = study->options.quick ? 1 : 2,
        .threads = study->common.threads,
        .difference = 1,
        .quiet = 1,
    };
    umbt_pictures_finish(pictures);
    UMB__TRY(umbt_picture_render(&request, pictures, &ignored, error));
    umbt_study_picture_name(study, result, 0, name, sizeof name);
    UMB__TRY(picture_save(study, &pictures->asset, name, error));
    umbt_study_picture_name(study, result, 1, name, sizeof name);
    return picture_save(study, &pictures->difference, name, error);
}

static enum umb_status pictures_draw(const struct umbt_study *study, struct umbt_pictures *pictures,
                                     struct umb_error *error)
{
    static const uint32_t size[2] = {WIDTH, HEIGHT};
    struct umbt_setup setup;
    UMB__TRY(umbt_study_camera(study, size, &setup, error));
    for (uint32_t i = 0; i < study->result_count; i++) {
        if (umbt_study_has_picture(study, &study->results[i])) {
            UMB__TRY(result_draw(study, &study->results[i], &setup, pictures, error));
        }
    }
    return picture_save(study, &pictures->traced, "pictures/traced.png", error);
}

enum umb_status umbt_study_pictures(struct umbt_study *study, struct umb_error *error)
{
    struct umbt_pictures pictures = {0};
    UMB__TRY(umbt_study_folder(study, "pictures", error));
    const enum umb_status status = pictures_draw(study, &pictures, error);
    umbt_pictures_finish(&pictures);
    return status;
}

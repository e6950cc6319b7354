/* SPDX-License-Identifier: Apache-2.0 */
/* The pictures of a study: one view by each resolution, and its difference from rays (study.h). */
#include "study/study.h"

#include <stdio.h>
#include <string.h>

#include "base/try.h"
#include "study/study_picture.h"

#define WIDTH  640
#define HEIGHT 360

int umbt_study_has_picture(const struct umbt_study_result *result)
{
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
    setup->scene = &study->scene;
    setup->z_up = study->z_up;
    memcpy(setup->to_light, study->points.to_light, sizeof setup->to_light);
    return umbt_setup_camera(setup, &fitted, size, error);
}

/* A resolution's asset in the form of the picture renderer. */
static enum umb_status source_make(const struct umbt_study *study,
                                   const struct umbt_study_result *result,
                                   struct umbt_shadow_source *source, struct umb_error *error)
{
    const struct umbt_study_bake *bake = &study->bakes[result->bake];
    memset(source, 0, sizeof *source);
    source->name = bake->name;
    source->asset = bake->asset;
    source->settings.taps = result->taps;
    source->light = bake->light;
    source->frustum = bake->frustum;
    memcpy(source->origin, bake->info.origin, sizeof source->origin);
    return umb_query_prepare(bake->asset, &source->settings, &source->query, error);
}

/* Pictures of one frame. */
struct pictures {
    struct umbt_picture asset, traced, difference;
};

static enum umb_status result_draw(const struct umbt_study *study,
                                   const struct umbt_study_result *result,
                                   const struct umbt_setup *setup, struct pictures *pictures,
                                   struct umb_error *error)
{
    struct umbt_shadow_source source;
    struct umbt_picture_result ignored;
    char name[128];
    UMB__TRY(source_make(study, result, &source, error));
    struct umbt_truth truth = {
        .rays = study->scene.rays,
        .kind = UMBT_TRUTH_SURFACE,
        .settings = source.settings,
        .diagonal_m = study->scene.diagonal_m,
        .frustum = source.frustum,
    };
    memcpy(truth.to_light, setup->to_light, sizeof truth.to_light);
    memcpy(truth.origin, source.origin, sizeof truth.origin);
    const struct umbt_picture_request request = {
        .setup = setup,
        .source = &source,
        .truth = &truth,
        .aa = study->options.quick ? 1 : 2,
        .threads = (unsigned)study->options.threads,
        .asset = &pictures->asset,
        .traced = &pictures->traced,
        .difference = &pictures->difference,
        .quiet = 1,
    };
    UMB__TRY(umbt_picture_render(&request, &ignored, error));
    umbt_study_picture_name(study, result, 0, name, sizeof name);
    UMB__TRY(picture_save(study, &pictures->asset, name, error));
    umbt_study_picture_name(study, result, 1, name, sizeof name);
    return picture_save(study, &pictures->difference, name, error);
}

static enum umb_status pictures_draw(const struct umbt_study *study, struct pictures *pictures,
                                     struct umb_error *error)
{
    static const uint32_t size[2] = {WIDTH, HEIGHT};
    struct umbt_setup setup;
    UMB__TRY(umbt_study_camera(study, size, &setup, error));
    UMB__TRY(umbt_picture_init(&pictures->asset, WIDTH, HEIGHT, error));
    UMB__TRY(umbt_picture_init(&pictures->traced, WIDTH, HEIGHT, error));
    UMB__TRY(umbt_picture_init(&pictures->difference, WIDTH, HEIGHT, error));
    for (uint32_t i = 0; i < study->result_count; i++) {
        if (umbt_study_has_picture(&study->results[i])) {
            UMB__TRY(result_draw(study, &study->results[i], &setup, pictures, error));
        }
    }
    return picture_save(study, &pictures->traced, "pictures/traced.png", error);
}

enum umb_status umbt_study_pictures(struct umbt_study *study, struct umb_error *error)
{
    struct pictures pictures;
    memset(&pictures, 0, sizeof pictures);
    UMB__TRY(umbt_study_folder(study, "pictures", error));
    const enum umb_status status = pictures_draw(study, &pictures, error);
    umbt_picture_finish(&pictures.asset);
    umbt_picture_finish(&pictures.traced);
    umbt_picture_finish(&pictures.difference);
    return status;
}

/* SPDX-License-Identifier: Apache-2.0 */
/* One view by every resolution (study_pictures.h). */
#include "study/study_pictures.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>

#include "study/study_picture.h"

#define PATH_BYTES 4096

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
    char path[PATH_BYTES];
    if (snprintf(path, sizeof path, "%s/%s", study->options.folder, name) >= (int)sizeof path) {
        return umb_fail(error, UMB_E_ARGUMENT, "-o: the path has more than %d bytes", PATH_BYTES);
    }
    return umbt_picture_write(picture, path, error);
}

enum umb_status umbt_study_camera(const struct umbt_study *study, uint32_t width, uint32_t height,
                                  struct umbt_camera *camera, int *z_up, struct umb_error *error)
{
    const struct umbt_camera_request fitted = {0};
    *z_up = study->options.up != NULL ? study->options.up[0] == 'z' : study->scene.scene->view.z_up;
    struct umbt_camera_subject subject = {
        .points = (const double(*)[3])study->scene.corners,
        .count = 3 * study->scene.count,
        .box = study->scene.box,
        .z_up = *z_up,
    };
    memcpy(subject.to_light, study->points.to_light, sizeof subject.to_light);
    return umbt_camera_make(&fitted, &subject, width, height, camera, error);
}

/* A resolution's asset in the form of the picture renderer. */
static enum umb_status source_make(const struct umbt_study *study,
                                   const struct umbt_study_result *result,
                                   struct umbt_source *source, struct umb_error *error)
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
                                   const struct umbt_camera *camera, int z_up,
                                   struct pictures *pictures, struct umb_error *error)
{
    struct umbt_source source;
    struct umbt_picture_result ignored;
    char name[128];
    enum umb_status status = source_make(study, result, &source, error);
    struct umbt_truth truth = {
        .rays = study->scene.rays,
        .kind = UMBT_TRUTH_SURFACE,
        .settings = source.settings,
        .diagonal_m = study->scene.diagonal_m,
        .frustum = source.frustum,
    };
    memcpy(truth.to_light, study->points.to_light, sizeof truth.to_light);
    memcpy(truth.origin, source.origin, sizeof truth.origin);
    struct umbt_picture_request request = {
        .scene = &study->scene,
        .camera = camera,
        .source = &source,
        .truth = &truth,
        .z_up = z_up,
        .aa = study->options.quick ? 1 : 2,
        .threads = (unsigned)study->options.threads,
        .asset = &pictures->asset,
        .traced = &pictures->traced,
        .difference = &pictures->difference,
        .quiet = 1,
    };
    memcpy(request.to_light, truth.to_light, sizeof request.to_light);
    if (status == UMB_OK) {
        status = umbt_picture_render(&request, &ignored, error);
    }
    for (int difference = 0; status == UMB_OK && difference < 2; difference++) {
        umbt_study_picture_name(study, result, difference, name, sizeof name);
        status =
            picture_save(study, difference ? &pictures->difference : &pictures->asset, name, error);
    }
    return status;
}

static enum umb_status pictures_draw(const struct umbt_study *study, struct pictures *pictures,
                                     struct umb_error *error)
{
    struct umbt_camera camera;
    int z_up;
    enum umb_status status = umbt_study_camera(study, UMBT_STUDY_PICTURE_WIDTH,
                                               UMBT_STUDY_PICTURE_HEIGHT, &camera, &z_up, error);
    struct umbt_picture *all[3] = {&pictures->asset, &pictures->traced, &pictures->difference};
    for (int i = 0; status == UMB_OK && i < 3; i++) {
        status =
            umbt_picture_init(all[i], UMBT_STUDY_PICTURE_WIDTH, UMBT_STUDY_PICTURE_HEIGHT, error);
    }
    for (uint32_t i = 0; status == UMB_OK && i < study->result_count; i++) {
        if (umbt_study_has_picture(&study->results[i])) {
            status = result_draw(study, &study->results[i], &camera, z_up, pictures, error);
        }
    }
    if (status == UMB_OK) {
        status = picture_save(study, &pictures->traced, "pictures/traced.png", error);
    }
    return status;
}

enum umb_status umbt_study_pictures(const struct umbt_study *study, struct umb_error *error)
{
    struct pictures pictures;
    char folder[PATH_BYTES];
    memset(&pictures, 0, sizeof pictures);
    (void)snprintf(folder, sizeof folder, "%.4000s/pictures", study->options.folder);
    if (mkdir(folder, 0777) != 0 && errno != EEXIST) {
        return umb_fail_errno(error, UMB_E_CANNOT_CREATE, errno, "-o: folder '%.200s'", folder);
    }
    const enum umb_status status = pictures_draw(study, &pictures, error);
    umbt_picture_finish(&pictures.asset);
    umbt_picture_finish(&pictures.traced);
    umbt_picture_finish(&pictures.difference);
    return status;
}

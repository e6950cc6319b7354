/* SPDX-License-Identifier: Apache-2.0 */
/* One view by every rung (trade_pictures.h). */
#include "study/trade_pictures.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>

#include "study/study_frame.h"

#define PATH_BYTES 4096

int umbt_trade_has_picture(const struct umbt_trade_result *result)
{
    return result->method == UMBT_TRADE_DAG && result->level == 0 &&
           (result->taps == 1 || result->taps == 9);
}

void umbt_trade_picture_name(const struct umbt_trade *trade, const struct umbt_trade_result *result,
                             int difference, char *name, size_t size)
{
    (void)snprintf(name, size, "pictures/%s-%u%s.png", trade->bakes[result->bake].name,
                   result->taps, difference ? "-difference" : "");
}

static enum umb_status picture_save(const struct umbt_trade *trade,
                                    const struct umbt_picture *picture, const char *name,
                                    struct umb_error *error)
{
    char path[PATH_BYTES];
    if (snprintf(path, sizeof path, "%s/%s", trade->options.folder, name) >= (int)sizeof path) {
        return umb_fail(error, UMB_E_ARGUMENT, "-o: the path has more than %d bytes", PATH_BYTES);
    }
    return umbt_picture_write(picture, path, error);
}

enum umb_status umbt_trade_camera(const struct umbt_trade *trade, uint32_t width, uint32_t height,
                                  struct umbt_camera *camera, int *z_up, struct umb_error *error)
{
    const struct umbt_camera_request fitted = {0};
    *z_up = trade->options.up != NULL ? trade->options.up[0] == 'z' : trade->scene.scene->view.z_up;
    struct umbt_camera_subject subject = {
        .points = (const double(*)[3])trade->scene.corners,
        .count = 3 * trade->scene.count,
        .box = trade->scene.box,
        .z_up = *z_up,
    };
    memcpy(subject.to_light, trade->points.to_light, sizeof subject.to_light);
    return umbt_camera_make(&fitted, &subject, width, height, camera, error);
}

/* A rung's asset as the frame renderer takes it. */
static enum umb_status source_make(const struct umbt_trade *trade,
                                   const struct umbt_trade_result *result,
                                   struct umbt_source *source, struct umb_error *error)
{
    const struct umbt_trade_bake *bake = &trade->bakes[result->bake];
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

static enum umb_status result_draw(const struct umbt_trade *trade,
                                   const struct umbt_trade_result *result,
                                   const struct umbt_camera *camera, int z_up,
                                   struct pictures *pictures, struct umb_error *error)
{
    struct umbt_source source;
    struct umbt_frame_result ignored;
    char name[128];
    enum umb_status status = source_make(trade, result, &source, error);
    struct umbt_truth truth = {
        .rays = trade->scene.rays,
        .kind = UMBT_TRUTH_SURFACE,
        .settings = source.settings,
        .diagonal_m = trade->scene.diagonal_m,
        .frustum = source.frustum,
    };
    memcpy(truth.to_light, trade->points.to_light, sizeof truth.to_light);
    memcpy(truth.origin, source.origin, sizeof truth.origin);
    struct umbt_frame_request request = {
        .scene = &trade->scene,
        .camera = camera,
        .source = &source,
        .truth = &truth,
        .z_up = z_up,
        .aa = trade->options.quick ? 1 : 2,
        .threads = (unsigned)trade->options.threads,
        .asset = &pictures->asset,
        .traced = &pictures->traced,
        .difference = &pictures->difference,
        .quiet = 1,
    };
    memcpy(request.to_light, truth.to_light, sizeof request.to_light);
    if (status == UMB_OK) {
        status = umbt_frame_render(&request, &ignored, error);
    }
    for (int difference = 0; status == UMB_OK && difference < 2; difference++) {
        umbt_trade_picture_name(trade, result, difference, name, sizeof name);
        status =
            picture_save(trade, difference ? &pictures->difference : &pictures->asset, name, error);
    }
    return status;
}

static enum umb_status pictures_draw(const struct umbt_trade *trade, struct pictures *pictures,
                                     struct umb_error *error)
{
    struct umbt_camera camera;
    int z_up;
    enum umb_status status = umbt_trade_camera(trade, UMBT_TRADE_PICTURE_WIDTH,
                                               UMBT_TRADE_PICTURE_HEIGHT, &camera, &z_up, error);
    struct umbt_picture *all[3] = {&pictures->asset, &pictures->traced, &pictures->difference};
    for (int i = 0; status == UMB_OK && i < 3; i++) {
        status =
            umbt_picture_init(all[i], UMBT_TRADE_PICTURE_WIDTH, UMBT_TRADE_PICTURE_HEIGHT, error);
    }
    for (uint32_t i = 0; status == UMB_OK && i < trade->result_count; i++) {
        if (umbt_trade_has_picture(&trade->results[i])) {
            status = result_draw(trade, &trade->results[i], &camera, z_up, pictures, error);
        }
    }
    if (status == UMB_OK) {
        status = picture_save(trade, &pictures->traced, "pictures/traced.png", error);
    }
    return status;
}

enum umb_status umbt_trade_pictures(const struct umbt_trade *trade, struct umb_error *error)
{
    struct pictures pictures;
    char folder[PATH_BYTES];
    memset(&pictures, 0, sizeof pictures);
    (void)snprintf(folder, sizeof folder, "%.4000s/pictures", trade->options.folder);
    if (mkdir(folder, 0777) != 0 && errno != EEXIST) {
        return umb_fail_errno(error, UMB_E_CANNOT_CREATE, errno, "-o: folder '%.200s'", folder);
    }
    const enum umb_status status = pictures_draw(trade, &pictures, error);
    umbt_picture_finish(&pictures.asset);
    umbt_picture_finish(&pictures.traced);
    umbt_picture_finish(&pictures.difference);
    return status;
}

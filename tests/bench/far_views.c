/* SPDX-License-Identifier: Apache-2.0 */
/*
 * far-views compares ways to filter a far view with the mean over each pixel.
 *
 *     far_views SCENE CAMERA FOLDER
 *
 * FOLDER has the assets 16384.umb, 8192.umb ... 512.umb of the scene's sun. A view of WIDTH pixels,
 * then of half as many and so on, is filtered by every way of far_modes.h, by one tap, by windows
 * and by footprints. The truth of a pixel is the mean of one tap, at 16384, over its sub-pixels, at
 * least SUBPIXELS a side. Prints a table: mean differences from the truth by view, whose name is
 * the median width of its pixels in texels; CPU nanoseconds a point, of all views; bytes.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "base/vec.h"
#include "bench_report.h"
#include "far_modes.h"
#include "study/gbuffer.h"
#include "tool/threads.h"

enum {
    VIEWS = 5,
    WIDTH = 512, /* Pixels of the first view */
    HEIGHT = 288,
    /* Sub-pixels of a pixel of the first view on each axis; in the next views 16, 16 ... */
    SUBPIXELS = 8,
    MOST = 16
};

enum mode {
    ONE_TAP,
    NINE_TAPS,
    BY_NORMAL,
    LONGER,
    WINDOW,
    MRAA_9,
    MRAA_17,
    VOAA,
    FOOTPRINT,
    MODES
};

static const char *const names[MODES] = {"one tap",
                                         "9 taps",
                                         "9 taps along the normal",
                                         "9 taps, lifts a quarter longer",
                                         "a window of that width in one depth, exact",
                                         "MRAA, 9 taps",
                                         "MRAA, 17 taps",
                                         "VOAA",
                                         "footprint"};

struct race {
    struct umbt_scene scene;
    struct umbt_camera_request request;
    struct far_assets assets;
    struct far_shares *shares;
    uint64_t bytes[FAR_LEVELS];
    double error[VIEWS][MODES], texels[VIEWS];
    double seconds[MODES];
    size_t points;
};

/* One view: its points, pixels and truths. */
struct view {
    struct far_points far;
    struct umbt_gbuffer centres;
    double eye[3], pixel_rad;
    double *truth; /* By point */
    double *answers;
    float *values;
};

static void assets_open(const char *folder, struct race *race)
{
    struct umb_frustum_info frustum;
    struct umb_error error;
    struct stat status;
    for (uint32_t k = 0; k < FAR_LEVELS; k++) {
        const char *path = bench_text("%s/%u.umb", folder, 16384U >> k);
        bench_must(umb_asset_open_file(path, NULL, &race->assets.level[k], &error), &error, path);
        race->bytes[k] = stat(path, &status) == 0 ? (uint64_t)status.st_size : 0;
    }
    bench_must(umb_asset_get_frustum(race->assets.level[0], 0, &frustum), NULL, "frustum");
    race->assets.texel_m =
        (umb__length(frustum.voxel_step[0]) + umb__length(frustum.voxel_step[1])) / 2;
    race->shares = far_shares_make(race->assets.level[0]);
}

static void *array_make(size_t count, size_t size)
{
    void *array = calloc(count + 1, size);
    if (array == NULL) {
        bench_fail("%zu points: out of memory", count);
    }
    return array;
}

static void camera_make(const struct race *race, uint32_t width, uint32_t height,
                        struct umbt_camera *camera)
{
    const struct umbt_camera_subject subject = {
        .points = (const double(*)[3])race->scene.corners,
        .count = 3 * race->scene.count,
        .box = race->scene.box,
        .z_up = 1,
        .to_light = {0, 0, 1},
    };
    struct umb_error error;
    bench_must(umbt_camera_make(&race->request, &subject, width, height, camera, &error), &error,
               "camera");
}

static void answer(const struct umb_asset *asset, const struct umb_query_settings *settings,
                   const struct umb_points *points, float *values)
{
    struct umb_answers answers = {.values = values};
    struct umb_query query;
    struct umb_error error;
    bench_must(umb_query_prepare(asset, settings, &query, &error), &error, "query");
    umb_query_run(&query, points, 0, points->count, &answers);
}

/* Computes the means of one tap over the sub-pixels of a row of pixels. */
static void row_truth(const struct race *race, const struct umbt_gbuffer *fine,
                      const struct view *view, uint32_t row)
{
    const struct umb_points points = {.positions = fine->positions,
                                      .normals = fine->normals,
                                      .format = UMB_POINT_F64,
                                      .count = fine->receiver_count};
    float *values = array_make(points.count, sizeof *values);
    const size_t each = (size_t)fine->aa * fine->aa;
    answer(race->assets.level[0], &(struct umb_query_settings){.taps = 1}, &points, values);
    for (uint32_t x = 0; x < fine->width; x++) {
        const uint32_t slot = view->centres.slots[row * fine->width + x];
        double sum = 0;
        size_t count = 0;
        for (size_t k = 0; k < each; k++) {
            const uint32_t sub = fine->slots[x * each + k];
            if (sub != UMBT_SKY) {
                sum += (double)values[sub];
                count++;
            }
        }
        if (slot != UMBT_SKY) {
            view->truth[slot] = count > 0 ? sum / (double)count : (double)NAN;
        }
    }
    free(values);
}

static void truth_make(const struct race *race, const struct umbt_camera *camera, uint32_t width,
                       uint32_t height, uint32_t aa, const struct view *view)
{
    struct umbt_gbuffer fine;
    struct umb_error error;
    bench_must(umbt_gbuffer_init(&fine, width, aa, 1, &error), &error, "sub-pixels");
    for (uint32_t row = 0; row < height; row++) {
        bench_must(umbt_gbuffer_fill(&fine, &race->scene, camera, height, row, 1,
                                     umbu_processor_count(), &error),
                   &error, "sub-pixels");
        row_truth(race, &fine, view, row);
    }
    umbt_gbuffer_finish(&fine);
}

static int compare_doubles(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Finds the widths of the pixels' patches of surface, from the explanations of queries. */
static double widths_make(const struct race *race, struct view *view)
{
    const struct umb_query_settings settings = {.filter = UMB_FILTER_FOOTPRINT,
                                                .eye = {view->eye[0], view->eye[1], view->eye[2]},
                                                .pixel_rad = view->pixel_rad};
    const size_t count = view->far.points.count;
    double *sorted = array_make(count, sizeof *sorted);
    struct umb_query query;
    struct umb_error error;
    bench_must(umb_query_prepare(race->assets.level[0], &settings, &query, &error), &error,
               "footprint");
    for (size_t i = 0; i < count; i++) {
        struct umb_explanation explanation;
        umb_query_explain(&query, &view->far.points, i, &explanation);
        sorted[i] = view->far.widths[i] = explanation.footprint_m;
    }
    qsort(sorted, count, sizeof *sorted, compare_doubles);
    const double median = count > 0 ? sorted[count / 2] / race->assets.texel_m : 0;
    free(sorted);
    return median;
}

static void widen(const struct view *view)
{
    for (size_t i = 0; i < view->far.points.count; i++) {
        view->answers[i] = (double)view->values[i];
    }
}

/* Runs one way over the view. */
static void mode_run(struct race *race, enum mode mode, struct view *view)
{
    const struct far_points *far = &view->far;
    const struct umb_asset *asset = race->assets.level[0];
    struct umb_query_settings settings = {.taps = mode == NINE_TAPS ? 9 : 1};
    switch (mode) {
    case BY_NORMAL:
    case LONGER:
        far_biased(asset, mode == LONGER ? FAR_LONGER : FAR_BY_NORMAL, far, view->values);
        widen(view);
        return;
    case WINDOW:
        far_window(&race->assets, far, view->answers);
        return;
    case MRAA_9:
    case MRAA_17:
        far_mraa(&race->assets, mode == MRAA_9 ? 9 : 17, far, view->answers);
        return;
    case VOAA:
        far_voaa(&race->assets, race->shares, far, view->answers);
        return;
    case FOOTPRINT:
        settings.filter = UMB_FILTER_FOOTPRINT;
        memcpy(settings.eye, view->eye, sizeof settings.eye);
        settings.pixel_rad = view->pixel_rad;
        break;
    default:
        break;
    }
    answer(asset, &settings, &far->points, view->values);
    widen(view);
}

/* Returns the mean difference from the truth, over the pixels that see the scene. */
static double mean_error(const struct view *view)
{
    double sum = 0;
    size_t count = 0;
    for (size_t i = 0; i < view->far.points.count; i++) {
        if (!isnan(view->truth[i])) {
            sum += fabs(view->answers[i] - view->truth[i]);
            count++;
        }
    }
    return count > 0 ? sum / (double)count : 0;
}

static void view_run(struct race *race, int number)
{
    const uint32_t width = WIDTH >> number, height = HEIGHT >> number;
    const uint32_t aa = number == 0 ? SUBPIXELS : MOST;
    struct umbt_camera camera;
    struct view view = {0};
    struct umb_error error;
    const uint32_t size[2] = {width, height};
    camera_make(race, width, height, &camera);
    bench_must(umbt_gbuffer_view(&view.centres, &race->scene, &camera, size, umbu_processor_count(),
                                 &error),
               &error, "view");
    const size_t count = view.centres.receiver_count;
    view.far.points = (struct umb_points){.positions = view.centres.positions,
                                          .normals = view.centres.normals,
                                          .format = UMB_POINT_F64,
                                          .count = count};
    view.far.widths = array_make(count, sizeof(double));
    view.truth = array_make(count, sizeof(double));
    view.answers = array_make(count, sizeof(double));
    view.values = array_make(count, sizeof(float));
    memcpy(view.eye, camera.eye, sizeof view.eye);
    view.pixel_rad = 2 * camera.tan_y / height;
    race->texels[number] = widths_make(race, &view);
    truth_make(race, &camera, width, height, aa, &view);
    for (int mode = 0; mode < MODES; mode++) {
        mode_run(race, (enum mode)mode, &view); /* Warms what the next run reads */
        const double start = bench_cpu_s();
        mode_run(race, (enum mode)mode, &view);
        race->seconds[mode] += bench_cpu_s() - start;
        race->error[number][mode] = mean_error(&view);
    }
    race->points += count;
    bench_say("view of %u x %u: %zu points, pixels of %.0f texels", width, height, count,
              race->texels[number]);
    umbt_gbuffer_finish(&view.centres);
    free(view.far.widths);
    free(view.truth);
    free(view.answers);
    free(view.values);
}

static void report(const struct race *race)
{
    struct umb_asset_info info;
    uint64_t levels = 0, nodes = 0;
    printf("| texels a pixel |");
    for (int v = 0; v < VIEWS; v++) {
        printf(" %.0f |", race->texels[v]);
    }
    printf(" ns a point |\n|---|---|---|---|---|---|---|\n");
    for (int m = 0; m < MODES; m++) {
        printf("| %s |", names[m]);
        for (int v = 0; v < VIEWS; v++) {
            printf(" %.4f |", race->error[v][m]);
        }
        printf(" %.0f |\n", 1e9 * race->seconds[m] / (double)race->points);
    }
    umb_asset_get_info(race->assets.level[0], &info);
    for (int k = 1; k < FAR_LEVELS; k++) {
        levels += race->bytes[k];
    }
    for (int k = UMB_LEVEL_BRICK; k <= UMB_LEVEL_MAX; k++) {
        nodes += info.level_nodes[k];
    }
    printf("\nbytes: the asset %llu, MRAA's levels +%llu (%.0f %%), VOAA +%llu (%.0f %%)\n",
           (unsigned long long)race->bytes[0], (unsigned long long)levels,
           100.0 * (double)levels / (double)race->bytes[0], (unsigned long long)nodes,
           100.0 * (double)nodes / (double)race->bytes[0]);
}

int main(int argc, char **argv)
{
    static struct race race;
    struct umb_error error;
    if (argc != 4) {
        (void)fprintf(stderr, "usage: far_views SCENE CAMERA FOLDER\n");
        return 2;
    }
    bench_must(umbt_camera_parse(argv[2], &race.request, &error), &error, "CAMERA");
    bench_must(umbt_scene_init(&race.scene, argv[1], 0, &error), &error, argv[1]);
    assets_open(argv[3], &race);
    for (int v = 0; v < VIEWS; v++) {
        view_run(&race, v);
    }
    report(&race);
    far_shares_free(race.shares);
    for (int k = 0; k < FAR_LEVELS; k++) {
        umb_asset_close(race.assets.level[k]);
    }
    umbt_scene_finish(&race.scene);
    return 0;
}

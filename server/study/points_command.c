/* SPDX-License-Identifier: Apache-2.0 */
/*
 * `points`: sample points of a scene, for load tests and demonstrations.
 *
 * Camera, up axis and light direction have the same meaning as in `render`; the light only chooses
 * the side from which a fitted camera looks.
 */
#include "study/study_command.h"

#include <float.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include "tool/clock.h"
#include "tool/output.h"
#include "tool/threads.h"
#include "study/point_file.h"
#include "tool/json.h"
#include "study/study_vec.h"
#include "study/view_options.h"
#include "tool/exit_code.h"

#define COUNT_MAX     100000000U /* 3.6 GB in memory */
#define REACH_DEFAULT 5.0        /* metres; at most ... */
#define REACH_SHARE   0.05       /* ... this share of the scene's diagonal */
#define REACH_MAX     1e6        /* metres */
#define COARSE_M      0.01       /* float spacing that causes a warning */
#define SUN_AZIMUTH   135.0      /* the bake's default sun */
#define SUN_ELEVATION 45.0

enum kind {
    KIND_SURFACE = UMBT_POINT_SURFACE,
    KIND_NEAR = UMBT_POINT_NEAR,
    KIND_FREE = UMBT_POINT_FREE,
    KIND_GBUFFER,
};

static const char *const kind_names[] = {"surface", "near", "free", "gbuffer"};
static const char *const format_names[] = {"f32", "f64", "text"};

struct points_run {
    const char *scene_path;
    enum kind kind;
    uint64_t count, seed, threads;
    double reach_m;
    struct umbt_camera_request camera;
    uint32_t size[2]; /* Pixels */
    unsigned up;      /* 0 by the scene's format, 1 y, 2 z */
    struct umbt_point_file file;
    int json, quiet;
    struct umbt_scene scene;
    struct umbt_point_set set;
    uint64_t bytes;
    double load_s, sample_s;
};

#define AT(field) UMBU_AT(struct points_run, field)

static const struct umbu_option OPTIONS[] = {
    {"SCENE", NULL, "the scene file", UMBU_TEXT, AT(scene_path), .needed = true},
    {"output", "FILE", "replaced as a whole; - is stdout", UMBU_TEXT, AT(file.path), .needed = true,
     .letter = 'o'},
    {"kind", "KIND",
     "surface: uniform over the visible area; near: off the surfaces, by up to --reach; free: "
     "uniform in the scene's bounds; gbuffer: what a camera's pixels see, in scan order",
     UMBU_CHOICE("surface|near|free|gbuffer"), AT(kind), .standard = "surface"},
    {"count", "N", "points; for gbuffer, pixels are made smaller until there are as many",
     UMBU_COUNT(1, COUNT_MAX), AT(count), .otherwise = "1000000; gbuffer: the pixels that see"},
    {"seed", "N", "of the random points", UMBU_COUNT(0, UINT64_MAX), AT(seed), .standard = "1"},
    {"reach", "M", "near: metres", UMBU_ABOVE(0, REACH_MAX), AT(reach_m),
     .otherwise = "5, or 5 % of the scene's diagonal if less", .needs = "kind=near"},
    {UMBT_CAMERA_ROW(struct points_run, camera), .needs = "kind=gbuffer"},
    {UMBT_SIZE_ROW(struct points_run, size, 16384, "1280x720"), .needs = "kind=gbuffer"},
    {UMBT_UP_ROW(struct points_run, up), .needs = "kind=gbuffer"},
    {"normals", NULL,
     "six numbers a point: the unit normal of its surface, outwards on closed parts, by winding "
     "on open ones, towards the camera for gbuffer",
     UMBU_FLAG, AT(file.normals), .needs = "kind=surface|gbuffer"},
    {"format", NULL, "raw little-endian numbers, or text", UMBU_CHOICE("f32|f64|text"),
     AT(file.format), .standard = "f32"},
    {"origin", "X,Y,Z", "metres, subtracted from every point (as query's --origin adds it)",
     UMBU_NUMBERS(3), AT(file.origin)},
    {UMBT_THREADS_ROW(struct points_run)},
    {UMBU_JSON_ROW(struct points_run), .excludes = "output=-"},
    {UMBU_QUIET_ROW(struct points_run, "no progress, no summary")},
};

static const struct umbu_command COMMAND = {
    .name = "umbrage points",
    .usage = "umbrage points SCENE -o FILE [options]",
    .summary = "Writes sample points of a scene, to query with `umbrage query --points FILE\n"
               "--format f32`. No point lies inside a closed solid. The same seed gives the same\n"
               "points.",
    .notes = "Exit codes: 0 ok, 2 usage, 65 bad data, 66 no input, 69 unavailable, 73 cannot\n"
             "create, 74 I/O, 75 temporary.",
    .sections = {{"options", UMBU_ROWS(OPTIONS)}},
};

static enum umb_status view_sample(struct points_run *run, struct umb_error *error)
{
    const struct umbs_scene_view *scene = &run->scene.scene->view;
    struct umbt_camera_subject subject = {
        .points = (const double(*)[3])run->scene.corners,
        .count = 3 * run->scene.count,
        .box = run->scene.box,
        .z_up = run->up > 0 ? run->up == 2 : scene->z_up,
    };
    if (scene->light_count > 0 && scene->lights[0].kind == UMB_LIGHT_DIRECTIONAL) {
        for (int k = 0; k < 3; k++) {
            subject.to_light[k] = -scene->lights[0].direction[k];
        }
    } else {
        umbt_compass_vector(SUN_AZIMUTH, SUN_ELEVATION, subject.z_up, subject.to_light);
    }
    const struct umbt_point_view view = {
        .scene = &run->scene,
        .camera = &run->camera,
        .subject = &subject,
        .width = run->size[0],
        .height = run->size[1],
        .count = (size_t)run->count,
        .threads = (unsigned)run->threads,
    };
    return umbt_points_view(&view, &run->set, error);
}

static enum umb_status random_sample(struct points_run *run, struct umb_error *error)
{
    if (run->count == 0) {
        run->count = 1000000;
    }
    if (!(run->reach_m > 0.0)) {
        run->reach_m = fmin(REACH_DEFAULT, REACH_SHARE * run->scene.diagonal_m);
    }
    const struct umbt_point_request request = {
        .scene = &run->scene,
        .kind = (enum umbt_point_kind)run->kind,
        .count = (size_t)run->count,
        .seed = run->seed,
        .reach_m = run->reach_m,
        .threads = (unsigned)run->threads,
        .quiet = run->quiet,
    };
    return umbt_points_sample(&request, &run->set, error);
}

/* Warns if floats so far from the origin are coarse; fails if the coordinates exceed the range of
 * floats. */
static enum umb_status floats_judge(const struct points_run *run, struct umb_error *error)
{
    double reach = 0.0;
    for (int k = 0; k < 3; k++) {
        reach = fmax(reach, fmax(fabs(run->scene.box.min[k] - run->file.origin[k]),
                                 fabs(run->scene.box.max[k] - run->file.origin[k])));
    }
    if (run->file.format == UMBT_POINT_FILE_F32 && reach > (double)FLT_MAX) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "--origin: coordinates reach %.6g m, beyond floats; --format f64 or text "
                        "keeps them",
                        reach);
    }
    if (run->file.format == UMBT_POINT_FILE_F32 && reach * FLT_EPSILON > COARSE_M && !run->quiet) {
        fprintf(stderr,
                "umbrage points: coordinates reach %.6g m, where floats are %.2g m apart; "
                "--origin %.9g,%.9g,%.9g or --format f64 keeps them exact\n",
                reach, reach * FLT_EPSILON, floor(run->scene.box.min[0]),
                floor(run->scene.box.min[1]), floor(run->scene.box.min[2]));
    }
    return UMB_OK;
}

static void report(const struct points_run *run)
{
    if (run->json) {
        struct umbu_json json = {.file = stdout};
        umbu_json_begin(&json, NULL, '{');
        umbu_json_text(&json, "scene", run->scene_path);
        umbu_json_text(&json, "points_file", run->file.path);
        umbu_json_text(&json, "kind", kind_names[run->kind]);
        umbu_json_integer(&json, "points", run->set.count);
        umbu_json_integer(&json, "candidates", run->set.candidates);
        umbu_json_integer(&json, "seed", run->seed);
        umbu_json_text(&json, "format", format_names[run->file.format]);
        umbu_json_bool(&json, "normals", run->file.normals);
        umbu_json_vector(&json, "origin", run->file.origin);
        umbu_json_integer(&json, "bytes", run->bytes);
        umbu_json_integer(&json, "triangles", run->scene.count);
        umbu_json_rounded(&json, "load_s", run->load_s, 6);
        umbu_json_rounded(&json, "sample_s", run->sample_s, 6);
        umbu_json_close(&json);
    } else if (!run->quiet) {
        fprintf(umbu_output_talk(run->file.path),
                "%s: %zu %s points of %" PRIu64 " %s, %s%s, %" PRIu64 " bytes; load %.2f s, "
                "points %.2f s\n",
                run->file.path, run->set.count, kind_names[run->kind], run->set.candidates,
                run->kind == KIND_GBUFFER ? "pixels" : "candidates", format_names[run->file.format],
                run->file.normals ? " with normals" : "", run->bytes, run->load_s, run->sample_s);
    }
}

static enum umb_status points_make(struct points_run *run, struct umb_error *error)
{
    const double start = umbu_clock_s();
    enum umb_status status = umbu_output_check(run->file.path, UMBU_OUTPUT_COMMAND, error);
    if (status == UMB_OK) {
        status = umbt_scene_init(&run->scene, run->scene_path, error);
    }
    const double loaded = umbu_clock_s();
    run->load_s = loaded - start;
    if (status == UMB_OK) {
        status = run->kind == KIND_GBUFFER ? view_sample(run, error) : random_sample(run, error);
        run->sample_s = umbu_clock_s() - loaded;
    }
    if (status == UMB_OK) {
        status = floats_judge(run, error);
    }
    if (status == UMB_OK) {
        status = umbt_point_file_write(&run->file, &run->set, &run->bytes, error);
    }
    return status;
}

int umbt_points_command(int argc, char **argv)
{
    struct points_run run;
    struct umb_error error = {0};
    struct umbu_parsed parsed;
    memset(&run, 0, sizeof run);
    run.threads = umbu_processor_count();
    const int code = umbu_start(&parsed, &COMMAND, argc, argv, &run);
    if (code >= 0) {
        return code;
    }
    enum umb_status status = points_make(&run, &error);
    if (status == UMB_OK) {
        report(&run);
    }
    umbt_point_set_finish(&run.set);
    umbt_scene_finish(&run.scene);
    if (status != UMB_OK) {
        fprintf(stderr, "umbrage points: %s\n", error.message);
    }
    return umbu_exit_code(status);
}

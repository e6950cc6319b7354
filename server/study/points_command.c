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
#include "study/output_guard.h"
#include "study/parallel_for.h"
#include "study/point_file.h"
#include "study/study_args.h"
#include "common/json_text.h"
#include "study/study_progress.h"
#include "study/study_vec.h"
#include "tool/exit_code.h"

#define COUNT_MAX     100000000U /* 3.6 GB in memory */
#define REACH_DEFAULT 5.0        /* metres; at most ... */
#define REACH_SHARE   0.05       /* ... this share of the scene's diagonal */
#define REACH_MAX     1e6        /* metres */
#define COARSE_M      0.01       /* float spacing that causes a warning */
#define SUN_AZIMUTH   135.0      /* the bake's default sun */
#define SUN_ELEVATION 45.0

static const char help[] =
    "usage: umbrage points SCENE -o FILE [options]\n"
    "\n"
    "Writes sample points of a scene, to query with `umbrage query --points FILE --format f32`.\n"
    "No point lies inside a closed solid. The same seed gives the same points.\n"
    "\n"
    "  -o, --output FILE  replaced as a whole; - is stdout\n"
    "  --kind KIND        surface: uniform over the visible area (default)\n"
    "                     near: off the surfaces, by up to --reach\n"
    "                     free: uniform in the scene's bounds\n"
    "                     gbuffer: what a camera's pixels see, in scan order\n"
    "  --count N          points, 1 to 100000000 (default 1000000; gbuffer: every pixel that\n"
    "                     sees the scene; with a count, pixels are made smaller until there are\n"
    "                     as many)\n"
    "  --seed N           of the random points (default 1)\n"
    "  --reach M          near: metres (default: 5, or 5 % of the scene's diagonal if less)\n"
    "  --camera WHERE     gbuffer: as `umbrage render` takes it (default: fitted)\n"
    "  --size WxH         gbuffer: pixels (default 1280x720)\n"
    "  --up y|z           gbuffer: the scene's up axis (default: by its format)\n"
    "  --normals          six numbers a point: the unit normal of its surface, outwards on closed\n"
    "                     parts, by winding on open ones, towards the camera for gbuffer\n"
    "  --format FORMAT    f32, f64 (raw, little-endian) or text (default f32)\n"
    "  --origin X,Y,Z     metres, subtracted from every point (as query's --origin adds it)\n"
    "  --threads N        default: all processors\n"
    "  --json             print one JSON object\n"
    "  -q, --quiet        no progress, no summary\n"
    "  --help\n"
    "\n"
    "Exit codes: 0 ok, 2 usage, 65 bad data, 66 no input, 69 unavailable, 73 cannot create, 74 "
    "I/O,\n"
    "75 temporary.\n";

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
    int kind; /* enum kind */
    uint64_t count, seed, threads;
    double reach_m;
    struct umbt_camera_request camera;
    uint32_t width, height;
    int up_given, z_up;
    struct umbt_point_file file;
    int json, quiet, help;
    struct umbt_scene scene;
    struct umbt_point_set set;
    uint64_t bytes;
    double load_s, sample_s;
};

/* Values that the option table cannot hold directly. */
struct raw {
    const char *kind, *reach, *camera, *size, *up, *format, *origin;
};

static int name_index(const char *text, const char *const *names, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        if (strcmp(text, names[i]) == 0) {
            return (int)i;
        }
    }
    return -1;
}

static enum umb_status names_convert(const struct raw *raw, struct points_run *run,
                                     struct umb_error *error)
{
    run->kind = raw->kind != NULL ? name_index(raw->kind, kind_names, 4) : KIND_SURFACE;
    if (run->kind < 0) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "--kind: '%.60s' is none of surface, near, free, gbuffer", raw->kind);
    }
    const int format = raw->format != NULL ? name_index(raw->format, format_names, 3) : 0;
    if (format < 0) {
        return umb_fail(error, UMB_E_ARGUMENT, "--format: '%.60s' is none of f32, f64, text",
                        raw->format);
    }
    run->file.format = (enum umbt_point_file_format)format;
    if (raw->reach != NULL && run->kind != KIND_NEAR) {
        return umb_fail(error, UMB_E_ARGUMENT, "--reach: only --kind near takes it");
    }
    if ((raw->camera != NULL || raw->size != NULL || raw->up != NULL) &&
        run->kind != KIND_GBUFFER) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "--camera, --size and --up: only --kind gbuffer takes them");
    }
    if (run->file.normals && (run->kind == KIND_NEAR || run->kind == KIND_FREE)) {
        return umb_fail(error, UMB_E_ARGUMENT, "--normals: points of kind %s are on no surface",
                        kind_names[run->kind]);
    }
    return UMB_OK;
}

static enum umb_status origin_parse(const char *text, double origin[3], struct umb_error *error)
{
    const char *at = text;
    for (int k = 0; k < 3; k++) {
        if ((k > 0 && *at++ != ',') || !umbt_number_read(&at, &origin[k])) {
            return umb_fail(error, UMB_E_ARGUMENT, "--origin: '%.80s' is not three numbers X,Y,Z",
                            text);
        }
    }
    return *at == '\0' ? UMB_OK
                       : umb_fail(error, UMB_E_ARGUMENT,
                                  "--origin: '%.80s' is not three numbers X,Y,Z", text);
}

static enum umb_status raw_convert(const struct raw *raw, struct points_run *run,
                                   struct umb_error *error)
{
    enum umb_status status = names_convert(raw, run, error);
    run->width = 1280;
    run->height = 720;
    if (status == UMB_OK && raw->reach != NULL) {
        const char *at = raw->reach;
        if (!umbt_number_read(&at, &run->reach_m) || *at != '\0' || !(run->reach_m > 0.0) ||
            run->reach_m > REACH_MAX) {
            return umb_fail(error, UMB_E_ARGUMENT,
                            "--reach: '%.60s' is not a number above 0, up to 1e6", raw->reach);
        }
    }
    if (status == UMB_OK && raw->camera != NULL) {
        status = umbt_camera_parse(raw->camera, &run->camera, error);
    }
    if (status == UMB_OK && raw->size != NULL) {
        status = umbt_size_parse(raw->size, &run->width, &run->height, error);
    }
    if (status == UMB_OK && raw->up != NULL) {
        run->up_given = 1;
        status = umbt_up_parse(raw->up, &run->z_up, error);
    }
    if (status == UMB_OK && raw->origin != NULL) {
        status = origin_parse(raw->origin, run->file.origin, error);
    }
    return status;
}

static enum umb_status options_parse(int argc, char **argv, struct points_run *run,
                                     struct umb_error *error)
{
    struct raw raw = {0};
    const struct umbt_option table[] = {
        {"SCENE", UMBT_WORD, &run->scene_path, 0, 0},
        {"-o", UMBT_TEXT, &run->file.path, 0, 0},
        {"--output", UMBT_TEXT, &run->file.path, 0, 0},
        {"--kind", UMBT_TEXT, &raw.kind, 0, 0},
        {"--count", UMBT_COUNT, &run->count, 1, COUNT_MAX},
        {"--seed", UMBT_COUNT, &run->seed, 0, UINT64_MAX},
        {"--reach", UMBT_TEXT, &raw.reach, 0, 0},
        {"--camera", UMBT_TEXT, &raw.camera, 0, 0},
        {"--size", UMBT_TEXT, &raw.size, 0, 0},
        {"--up", UMBT_TEXT, &raw.up, 0, 0},
        {"--normals", UMBT_FLAG, &run->file.normals, 0, 0},
        {"--format", UMBT_TEXT, &raw.format, 0, 0},
        {"--origin", UMBT_TEXT, &raw.origin, 0, 0},
        {"--threads", UMBT_COUNT, &run->threads, 1, 256},
        {"--json", UMBT_FLAG, &run->json, 0, 0},
        {"--quiet", UMBT_FLAG, &run->quiet, 0, 0},
        {"--help", UMBT_FLAG, &run->help, 0, 0},
    };
    run->seed = 1;
    run->threads = umbt_processor_count();
    enum umb_status status =
        umbt_args_parse(argc, argv, table, sizeof table / sizeof table[0], error);
    if (status != UMB_OK || run->help) {
        return status;
    }
    if (run->file.path == NULL) {
        return umb_fail(error, UMB_E_ARGUMENT, "-o: is needed; see --help");
    }
    status = umbt_output_check_json(run->file.path, run->json, error);
    return status == UMB_OK ? raw_convert(&raw, run, error) : status;
}

static enum umb_status view_sample(struct points_run *run, struct umb_error *error)
{
    const struct umbs_scene_view *scene = &run->scene.scene->view;
    struct umbt_camera_subject subject = {
        .points = (const double(*)[3])run->scene.corners,
        .count = 3 * run->scene.count,
        .box = run->scene.box,
        .z_up = run->up_given ? run->z_up : scene->z_up,
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
        .width = run->width,
        .height = run->height,
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
        printf("{\"scene\":");
        umbs_json_text(stdout, run->scene_path);
        printf(",\"points_file\":");
        umbs_json_text(stdout, run->file.path);
        printf(",\"kind\":\"%s\",\"points\":%zu,\"candidates\":%" PRIu64 ",\"seed\":%" PRIu64
               ",\"format\":\"%s\",\"normals\":%s,\"origin\":[%.17g,%.17g,%.17g],\"bytes\":%" PRIu64
               ",\"triangles\":%zu,\"load_s\":%.4f,\"sample_s\":%.4f}\n",
               kind_names[run->kind], run->set.count, run->set.candidates, run->seed,
               format_names[run->file.format], run->file.normals ? "true" : "false",
               run->file.origin[0], run->file.origin[1], run->file.origin[2], run->bytes,
               run->scene.count, run->load_s, run->sample_s);
    } else if (!run->quiet) {
        fprintf(umbt_output_talk(run->file.path),
                "%s: %zu %s points of %" PRIu64 " %s, %s%s, %" PRIu64 " bytes; load %.2f s, "
                "points %.2f s\n",
                run->file.path, run->set.count, kind_names[run->kind], run->set.candidates,
                run->kind == KIND_GBUFFER ? "pixels" : "candidates", format_names[run->file.format],
                run->file.normals ? " with normals" : "", run->bytes, run->load_s, run->sample_s);
    }
}

static enum umb_status points_make(struct points_run *run, struct umb_error *error)
{
    const double start = umbt_now_s();
    enum umb_status status = umbt_output_check(run->file.path, error);
    if (status == UMB_OK) {
        status = umbt_scene_init(&run->scene, run->scene_path, error);
    }
    const double loaded = umbt_now_s();
    run->load_s = loaded - start;
    if (status == UMB_OK) {
        status = run->kind == KIND_GBUFFER ? view_sample(run, error) : random_sample(run, error);
        run->sample_s = umbt_now_s() - loaded;
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
    memset(&run, 0, sizeof run);
    enum umb_status status = options_parse(argc, argv, &run, &error);
    if (status == UMB_OK && run.help) {
        fputs(help, stdout);
        return 0;
    }
    if (status == UMB_OK) {
        status = points_make(&run, &error);
    }
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

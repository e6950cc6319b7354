/* SPDX-License-Identifier: Apache-2.0 */
/*
 * `points`: sample points of a scene, for load tests and demonstrations.
 *
 * Camera, up axis and light direction have the same meaning as in `render`; the light only chooses
 * the side from which a fitted camera looks.
 */
#include "study/setup.h"

#include <float.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include "base/try.h"
#include "tool/clock.h"
#include "tool/output.h"
#include "study/point_sampler.h"
#include "study/study_math.h"

#define COUNT_MAX     100000000U /* 3.6 GB in memory */
#define REACH_DEFAULT 5.0        /* metres; less in a scene where it is above REACH_SHARE */
#define REACH_SHARE   0.05       /* share of the scene's diagonal */
#define REACH_MAX     1e6        /* metres */
#define COARSE_M      0.01       /* distance of neighbouring floats that causes a warning */

static const char *const kind_names[] = {"surface", "near", "free", "gbuffer"};
static const char *const format_names[] = {"f32", "f64", "text"};

struct points {
    struct umbt_common common;
    enum umbt_point_kind kind;
    uint64_t count;
    double reach_m;
    struct umbt_point_file file;
    struct umbt_point_set set;
    uint64_t bytes;
    double load_s, sample_s;
};

#define AT(field) UMBU_AT(struct points, field)

static const struct umbu_option OPTIONS[] = {
    {UMBT_SCENE_ROW},
    {"output", "FILE", "file of the points, replaced as a whole; - is stdout", UMBU_TEXT,
     UMBT_AT(output), .needed = true, .letter = 'o'},
    {"kind", "KIND",
     "place of the points. surface: uniform over the visible area; near: off the surfaces, by up "
     "to --reach; free: uniform in the scene's bounds; gbuffer: what a camera's pixels see, in "
     "scan order",
     UMBU_CHOICE("surface|near|free|gbuffer"), AT(kind), .standard = "surface"},
    {"count", "N", "number of points; gbuffer makes its pixels smaller until there are as many",
     UMBU_COUNT(1, COUNT_MAX), AT(count), .otherwise = "1000000; gbuffer: the pixels that see"},
    {UMBT_SEED_ROW},
    {"reach", "M", "largest distance from a surface in metres, above 0 to 1000000",
     UMBU_ABOVE(0, REACH_MAX), AT(reach_m),
     .otherwise = "5, or 5 % of the scene's diagonal if less", .needs = "kind=near"},
    {UMBT_CAMERA_ROW, .needs = "kind=gbuffer"},
    {UMBT_SIZE_ROW(16384, "1280x720"), .needs = "kind=gbuffer"},
    {UMBT_UP_ROW, .needs = "kind=gbuffer"},
    {"normals", NULL,
     "writes six numbers a point: the unit normal of the surface follows the place. The normal "
     "points outwards on closed parts, by winding on open ones, towards the camera for gbuffer",
     UMBU_FLAG, AT(file.normals), .needs = "kind=surface|gbuffer"},
    {"format", NULL, "form of the numbers: little-endian floats or doubles, or text",
     UMBU_CHOICE("f32|f64|text"), AT(file.format), .standard = "f32"},
    {"origin", "X,Y,Z", "metres to subtract from every point; query's --origin adds them again",
     UMBU_NUMBERS(3), AT(file.origin)},
    {UMBT_THREADS_ROW},
    {UMBT_JSON_ROW, .excludes = "output=-"},
    {UMBT_QUIET_ROW("no progress, no summary")},
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

static enum umb_status view_sample(struct points *p, struct umb_error *error)
{
    const int z_up = umbt_is_z_up(&p->common);
    double to_light[3];
    (void)umbt_scene_sun(&p->common.scene, z_up, to_light);
    const struct umbt_camera_subject subject = umbt_subject(&p->common.scene, to_light, z_up);
    const struct umbt_pixel_request view = {
        .scene = &p->common.scene,
        .camera = &p->common.camera,
        .subject = &subject,
        .size = {p->common.size[0], p->common.size[1]},
        .count = (size_t)p->count,
        .threads = p->common.threads,
    };
    return umbt_points_of_pixels(&view, &p->set, error);
}

static enum umb_status random_sample(struct points *p, struct umb_error *error)
{
    if (p->count == 0) {
        p->count = 1000000;
    }
    if (!(p->reach_m > 0.0)) {
        p->reach_m = fmin(REACH_DEFAULT, REACH_SHARE * p->common.scene.diagonal_m);
    }
    const struct umbt_point_request request = {
        .scene = &p->common.scene,
        .kind = p->kind,
        .count = (size_t)p->count,
        .seed = p->common.seed,
        .reach_m = p->reach_m,
        .threads = p->common.threads,
        .quiet = p->common.quiet,
    };
    return umbt_points_sample(&request, &p->set, error);
}

/* Warns if floats are coarse at the coordinates. Fails if the coordinates exceed a float's
 * range. */
static enum umb_status floats_judge(const struct points *p, struct umb_error *error)
{
    const struct umb_box *box = &p->common.scene.box;
    double reach = 0.0;
    for (int k = 0; k < 3; k++) {
        reach = fmax(reach, fmax(fabs(box->min[k] - p->file.origin[k]),
                                 fabs(box->max[k] - p->file.origin[k])));
    }
    if (p->file.format == UMBT_POINT_FILE_F32 && reach > (double)FLT_MAX) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "--origin: coordinates reach %.6g m, beyond floats; --format f64 or text "
                        "keeps them",
                        reach);
    }
    if (p->file.format == UMBT_POINT_FILE_F32 && reach * FLT_EPSILON > COARSE_M &&
        !p->common.quiet) {
        fprintf(stderr,
                "umbrage points: coordinates reach %.6g m, where floats are %.2g m apart; "
                "--origin %.9g,%.9g,%.9g or --format f64 keeps them exact\n",
                reach, reach * FLT_EPSILON, floor(box->min[0]), floor(box->min[1]),
                floor(box->min[2]));
    }
    return UMB_OK;
}

static void report_text(FILE *to, const void *state)
{
    const struct points *p = state;
    fprintf(to,
            "%s: %zu %s points of %" PRIu64 " %s, %s%s, %" PRIu64 " bytes; load %.2f s, "
            "points %.2f s\n",
            p->common.output, p->set.count, kind_names[p->kind], p->set.candidates,
            p->kind == UMBT_POINT_VIEW ? "pixels" : "candidates", format_names[p->file.format],
            p->file.normals ? " with normals" : "", p->bytes, p->load_s, p->sample_s);
}

static void report_json(struct umbu_json *json, const void *state)
{
    const struct points *p = state;
    umbu_json_text(json, "scene", p->common.scene_path);
    umbu_json_text(json, "points_file", p->common.output);
    umbu_json_text(json, "kind", kind_names[p->kind]);
    umbu_json_text(json, "format", format_names[p->file.format]);
    umbu_json_bool(json, "normals", p->file.normals);
    umbu_json_vector(json, "origin", p->file.origin);
    UMBU_JSON_COUNTS(json, {"points", p->set.count}, {"candidates", p->set.candidates},
                     {"seed", p->common.seed}, {"bytes", p->bytes},
                     {"triangles", p->common.scene.count});
    UMBU_JSON_VALUES(json, 6, {"load_s", p->load_s}, {"sample_s", p->sample_s});
}

static enum umb_status points_run(void *state, const struct umbu_parsed *parsed,
                                  struct umb_error *error)
{
    struct points *p = state;
    const double start = umbu_clock_s();
    (void)parsed;
    UMB__TRY(umbu_output_check(p->common.output, UMBU_OUTPUT_COMMAND, error));
    UMB__TRY(umbt_scene_init(&p->common.scene, p->common.scene_path, 0, error));
    const double loaded = umbu_clock_s();
    p->load_s = loaded - start;
    UMB__TRY(p->kind == UMBT_POINT_VIEW ? view_sample(p, error) : random_sample(p, error));
    p->sample_s = umbu_clock_s() - loaded;
    UMB__TRY(floats_judge(p, error));
    p->file.path = p->common.output;
    return umbt_point_file_write(&p->file, &p->set, &p->bytes, error);
}

static void finish(void *state)
{
    struct points *p = state;
    umbt_point_set_finish(&p->set);
}

const struct umbt_command umbt_points = {&COMMAND,    sizeof(struct points), points_run,
                                         report_text, report_json,           finish};

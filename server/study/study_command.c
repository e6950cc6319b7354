/* SPDX-License-Identifier: Apache-2.0 */
/* `umbrage-study SCENE -o DIR`: what accuracy costs (study.h). */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "base/try.h"
#include "study/study.h"
#include "tool/clock.h"

#define RESOLUTION_QUICK 4096
#define RESOLUTION_FULL  16384
#define POINTS_QUICK     12000
#define POINTS_FULL      60000
#define DEGREE           0.017453292519943295

#define AT(field) UMBU_AT(struct umbt_study, options.field)

static const struct umbu_option OPTIONS[] = {
    {UMBT_SCENE_ROW},
    {"output", "DIR", "folder of the report; the command makes it if it does not exist",
     UMBU_NAME("a folder's name (a report has many files: it cannot go to stdout; "
               "name a folder, ./- for one of that name)"),
     UMBT_AT(output), .otherwise = "the scene's name and -study, here", .letter = 'o'},
    {"quick", NULL,
     "takes minutes, not hours: at most 4096 voxels a side, filters of 1, 3 and 9 taps, fewer "
     "samples",
     UMBU_FLAG, AT(quick)},
    {"max-resolution", "N",
     "highest resolution in voxels a side, 512 to 262144; the study begins at 512 and doubles it",
     UMBU_COUNT(512, 262144), AT(max_resolution), .otherwise = "quick: 4096, else 16384"},
    {"sun", "AZ,EL", "azimuth and elevation of the sun in degrees, as umbrage-bake takes them",
     UMBU_TEXT, AT(sun), .otherwise = "the file's first light, else 135,45"},
    {"light", "NAME", "name of the light in the scene file to study", UMBU_TEXT, AT(light),
     .excludes = "sun"},
    {"point", "X,Y,Z", "a point light there, in metres, as umbrage-bake takes it", UMBU_TEXT,
     AT(point), .excludes = "sun|light"},
    {"spot", "X,Y,Z,DX,DY,DZ,DEGREES", "a spot light, as umbrage-bake takes it", UMBU_TEXT,
     AT(spot), .excludes = "sun|light|point"},
    {"light-size", "SIZE", "how large the light is, as umbrage-bake takes it: 0.53deg, 0.25m",
     UMBU_TEXT, AT(light_size), .otherwise = "the light's own"},
    {"up", "y|z", "the scene's up axis", UMBU_CHOICE("y|z"), AT(up),
     .otherwise = "as for umbrage bake"},
    {"points", "N", "number of samples in each of the three sets, 1000 to 10000000",
     UMBU_COUNT(1000, 10000000), AT(points), .otherwise = "quick: 12000, else 60000"},
    {"truth", "N", "rays a side of the area truth, 2 to 32: N x N rays a sample", UMBU_COUNT(2, 32),
     AT(truth_side), .otherwise = "quick: 6, else 12"},
    {UMBT_SEED_ROW},
    {UMBT_THREADS_ROW},
    {"json", NULL, "print the report as one JSON object", UMBU_FLAG, UMBT_AT(json)},
    {UMBT_QUIET_ROW("no progress, no summary")},
};

static const struct umbu_command COMMAND = {
    .name = "umbrage study",
    .usage = "umbrage-study SCENE [-o DIR] [options]\n"
             "       umbrage study SCENE [-o DIR] [options]",
    .summary = "Shows what accuracy costs: bakes one light of the scene at many resolutions, asks\n"
               "each with several filters and coarse levels about the same points, and compares\n"
               "errors, time and bytes with traced rays; under a sun also shadow maps, and every\n"
               "technique of the literature on one view. Writes DIR/report.html (one file, opens\n"
               "anywhere), report.json, report.csv, pictures/ and assets/. Stopped and started\n"
               "again, it goes on with the assets that are there.",
    .notes = "Exit codes: 0 ok, 2 usage, 65 bad data, 66 no input, 69 no umbrage-bake, 73\n"
             "cannot create, 74 I/O, 75 temporary.",
    .sections = {{"options", UMBU_ROWS(OPTIONS)}},
};

/* "scenes/city.glb" becomes "city-study". */
static void name_folder(struct umbt_study *study)
{
    const char *path = study->common.scene_path, *slash = strrchr(path, '/');
    const char *name = slash != NULL ? slash + 1 : path;
    const char *dot = strrchr(name, '.');
    const size_t stem = dot != NULL && dot > name ? (size_t)(dot - name) : strlen(name);
    (void)snprintf(study->options.named, sizeof study->options.named, "%.*s-study", (int)stem,
                   name);
    study->common.output = study->options.named;
}

/* Fills in what --quick decides. */
static void options_complete(struct umbt_study *study)
{
    struct umbt_study_options *options = &study->options;
    if (study->common.output == NULL) {
        name_folder(study);
    }
    if (options->max_resolution == 0) {
        options->max_resolution = options->quick ? RESOLUTION_QUICK : RESOLUTION_FULL;
    }
    if (options->points == 0) {
        options->points = options->quick ? POINTS_QUICK : POINTS_FULL;
    }
    if (options->truth_side == 0) {
        options->truth_side = options->quick ? 6 : 12;
    }
}

/* Draws the aliasing heat map of the same view and light, by the command `aliasing`, which supports
 * only suns above the horizon. */
static enum umb_status heat_draw(struct umbt_study *study, struct umb_error *error)
{
    char path[UMBT_STUDY_PATH], threads[16], sun[64];
    char *arguments[17] = {(char *)(uintptr_t) "aliasing"};
    int count = 1;
    const double *to_light = study->points.to_light;
    const double up = to_light[study->z_up ? 2 : 1];
    if (study->points.lamp != NULL || !(up > 0.0)) {
        return UMB_OK;
    }
    UMB__TRY(umbt_study_path(study, "pictures/aliasing.png", path, error));
    (void)snprintf(threads, sizeof threads, "%u", study->common.threads);
    (void)snprintf(sun, sizeof sun, "%.15g,%.15g", umbt_compass_azimuth(to_light, study->z_up, 0.0),
                   fmin(90.0, asin(fmin(up, 1.0)) / DEGREE));
    const char *const words[][2] = {{"-o", path},           {"--size", "480x270"},
                                    {"--threads", threads}, {"--resolution", "4096"},
                                    {"--sun", sun},         {"--up", study->z_up ? "z" : "y"}};
    arguments[count++] = (char *)(uintptr_t)study->common.scene_path;
    arguments[count++] = (char *)(uintptr_t) "--quiet";
    for (size_t i = 0; i < sizeof words / sizeof words[0]; i++) {
        arguments[count++] = (char *)(uintptr_t)words[i][0];
        arguments[count++] = (char *)(uintptr_t)words[i][1];
    }
    return umbt_command_run(&umbt_aliasing, count, arguments) == 0
               ? UMB_OK
               : umb_fail(error, UMB_E_INTERNAL, "the aliasing heat map could not be drawn");
}

/* Loads the scene with translucent casters that let light through. */
static enum umb_status scene_open(struct umbt_study *study, struct umb_error *error)
{
    UMB__TRY(
        umbt_scene_init(&study->common.scene, study->common.scene_path, UMBT_SCENE_THROUGH, error));
    study->common.up = study->options.up == NULL ? 0 : study->options.up[0] == 'z' ? 2 : 1;
    study->z_up = umbt_is_z_up(&study->common);
    return UMB_OK;
}

/* Loads the scene again if the plan of the bakes takes translucent casters as opaque. */
static enum umb_status scene_match(struct umbt_study *study, struct umb_error *error)
{
    const int translucent = study->common.scene.casts.cuts.translucent.triangles > 0;
    if (!translucent || umbt_plan_has(study->bakes[0].info.plan, "transmittance")) {
        study->translucent = translucent;
        return UMB_OK;
    }
    umbt_scene_finish(&study->common.scene);
    return umbt_scene_init(&study->common.scene, study->common.scene_path, 0, error);
}

static enum umb_status study_run(void *state, const struct umbu_parsed *parsed,
                                 struct umb_error *error)
{
    static enum umb_status (*const steps[])(struct umbt_study *, struct umb_error *) = {
        scene_open,         umbt_study_bake_all, scene_match,           umbt_study_points_make,
        umbt_study_measure, umbt_study_pictures, umbt_study_techniques, heat_draw};
    struct umbt_study *study = state;
    const double start = umbu_clock_s();
    (void)parsed;
    options_complete(study);
    for (size_t i = 0; i < sizeof steps / sizeof steps[0]; i++) {
        UMB__TRY(steps[i](study, error));
    }
    study->seconds = umbu_clock_s() - start;
    return umbt_study_report(study, error);
}

static void report_text(FILE *to, const void *state)
{
    const struct umbt_study *study = state;
    char summary[16384];
    umbt_study_summary(study, summary, sizeof summary);
    fprintf(to, "%s%s/report.html\n", summary, study->common.output);
}

static void finish(void *state)
{
    struct umbt_study *study = state;
    umbt_study_points_finish(&study->points);
    umbt_study_bakes_finish(study);
}

const struct umbt_command umbt_study_command = {&COMMAND,    sizeof(struct umbt_study), study_run,
                                                report_text, umbt_study_json,           finish};

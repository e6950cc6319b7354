/* SPDX-License-Identifier: Apache-2.0 */
/* `umbrage-study SCENE -o DIR`: what accuracy costs (study.h). */
#include <stdio.h>
#include <string.h>

#include "study/output_guard.h"
#include "study/parallel_for.h"
#include "study/study_args.h"
#include "study/study_command.h"
#include "study/study_progress.h"
#include "study/study.h"
#include "study/study_pictures.h"
#include "study/study_report.h"
#include "study/study_techniques.h"
#include "tool/exit_code.h"

#define RESOLUTION_QUICK 4096
#define RESOLUTION_FULL  16384
#define POINTS_QUICK     12000
#define POINTS_FULL      60000
#define PATH_BYTES       4096

static const char help[] =
    "usage: umbrage-study SCENE [-o DIR] [options]\n"
    "       umbrage study SCENE [-o DIR] [options]\n"
    "\n"
    "Shows what accuracy costs: bakes the scene at many resolutions, open and closed, asks each "
    "at\n"
    "several filter widths and coarse levels about the same points, and compares errors, time and\n"
    "bytes with traced rays; and every shadow map of the literature on one view. Writes\n"
    "DIR/report.html (one file, opens anywhere), report.json, report.csv, pictures/ and assets/.\n"
    "Stopped and started again, it goes on with the assets that are there.\n"
    "\n"
    "  -o, --output DIR     made if it is not there (default: the scene's name and -study, here)\n"
    "  --quick              up to 4096 voxels a side, 1, 3 and 9 taps, fewer points: minutes\n"
    "  --max-resolution N   last of the resolutions from 512 on (quick: 4096, else 16384)\n"
    "  --sun AZ,EL          the sun, as umbrage-bake takes it\n"
    "  --light NAME         the file's directional light of that name\n"
    "  --up y|z             the scene's up axis (default: by its format)\n"
    "  --points N           samples a set, 1000 to 10000000 (quick: 12000, else 60000)\n"
    "  --truth N            rays a side of the area truth, 2 to 32 (quick: 6, else 12)\n"
    "  --seed N             of the random points (default 1)\n"
    "  --threads N          default: all processors\n"
    "  --json               print the report as one JSON object\n"
    "  -q, --quiet          no progress, no summary\n"
    "  --help\n"
    "\n"
    "Exit codes: 0 ok, 2 usage, 65 bad data, 66 no input, 69 no umbrage-bake, 73 cannot create,\n"
    "74 I/O, 75 temporary.\n";

/* "scenes/city.glb" becomes "city-study". */
static void name_folder(struct umbt_study_options *options)
{
    const char *slash = strrchr(options->scene, '/');
    const char *name = slash != NULL ? slash + 1 : options->scene;
    const char *dot = strrchr(name, '.');
    const size_t stem = dot != NULL && dot > name ? (size_t)(dot - name) : strlen(name);
    (void)snprintf(options->named, sizeof options->named, "%.*s-study", (int)stem, name);
    options->folder = options->named;
}

static enum umb_status options_check(struct umbt_study_options *options, struct umb_error *error)
{
    int z_up;
    if (umbt_output_is_stdout(options->folder)) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "-o: '-' is not a folder's name (a report has many files: it cannot go to "
                        "stdout; name a folder, ./- for one of that name)");
    }
    if (options->folder == NULL) {
        name_folder(options);
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
    return options->up != NULL ? umbt_up_parse(options->up, &z_up, error) : UMB_OK;
}

static enum umb_status options_parse(int argc, char **argv, struct umbt_study_options *options,
                                     struct umb_error *error)
{
    const struct umbt_option table[] = {
        {"SCENE", UMBT_WORD, &options->scene, 0, 0},
        {"-o", UMBT_TEXT, &options->folder, 0, 0},
        {"--output", UMBT_TEXT, &options->folder, 0, 0},
        {"--quick", UMBT_FLAG, &options->quick, 0, 0},
        {"--max-resolution", UMBT_COUNT, &options->max_resolution, 512, 262144},
        {"--sun", UMBT_TEXT, &options->sun, 0, 0},
        {"--light", UMBT_TEXT, &options->light, 0, 0},
        {"--up", UMBT_TEXT, &options->up, 0, 0},
        {"--points", UMBT_COUNT, &options->points, 1000, 10000000},
        {"--truth", UMBT_COUNT, &options->truth_side, 2, 32},
        {"--seed", UMBT_COUNT, &options->seed, 0, UINT64_MAX},
        {"--threads", UMBT_COUNT, &options->threads, 1, 256},
        {"--json", UMBT_FLAG, &options->json, 0, 0},
        {"--quiet", UMBT_FLAG, &options->quiet, 0, 0},
        {"--help", UMBT_FLAG, &options->help, 0, 0},
    };
    options->seed = 1;
    options->threads = umbt_processor_count();
    const enum umb_status status =
        umbt_args_parse(argc, argv, table, sizeof table / sizeof table[0], error);
    return status != UMB_OK || options->help ? status : options_check(options, error);
}

/* Draws the aliasing heat map of the same view, by the command `aliasing`. */
static enum umb_status heat_draw(const struct umbt_study *study, struct umb_error *error)
{
    char path[PATH_BYTES], threads[16];
    char *arguments[16];
    int count = 0;
    if (snprintf(path, sizeof path, "%s/pictures/aliasing.png", study->options.folder) >=
        (int)sizeof path) {
        return umb_fail(error, UMB_E_ARGUMENT, "-o: the path has more than %d bytes", PATH_BYTES);
    }
    (void)snprintf(threads, sizeof threads, "%u", (unsigned)study->options.threads);
    const char *const words[][2] = {{"-o", path},
                                    {"--size", "480x270"},
                                    {"--threads", threads},
                                    {"--resolution", "4096"},
                                    {"--sun", study->options.sun},
                                    {"--up", study->options.up}};
    arguments[count++] = (char *)(uintptr_t)study->options.scene;
    arguments[count++] = (char *)(uintptr_t) "--quiet";
    for (size_t i = 0; i < sizeof words / sizeof words[0]; i++) {
        if (words[i][1] != NULL) {
            arguments[count++] = (char *)(uintptr_t)words[i][0];
            arguments[count++] = (char *)(uintptr_t)words[i][1];
        }
    }
    return umbt_aliasing_command(count, arguments) == 0
               ? UMB_OK
               : umb_fail(error, UMB_E_INTERNAL, "the aliasing heat map could not be drawn");
}

static enum umb_status study_run(struct umbt_study *study, struct umb_error *error)
{
    enum umb_status status = umbt_scene_init(&study->scene, study->options.scene, error);
    enum umb_status (*const steps[])(struct umbt_study *, struct umb_error *) = {
        umbt_study_bake_all, umbt_study_points_make, umbt_study_measure};
    for (size_t i = 0; status == UMB_OK && i < sizeof steps / sizeof steps[0]; i++) {
        status = steps[i](study, error);
    }
    if (status == UMB_OK) {
        status = umbt_study_pictures(study, error);
    }
    if (status == UMB_OK) {
        status = umbt_study_techniques(study, error);
    }
    if (status == UMB_OK) {
        status = heat_draw(study, error);
    }
    study->seconds = umbt_now_s() - study->started_s;
    return status == UMB_OK ? umbt_study_report(study, error) : status;
}

static void report(const struct umbt_study *study)
{
    char summary[4096];
    if (study->options.json) {
        umbt_study_json(stdout, study);
    } else if (!study->options.quiet) {
        umbt_study_summary(study, summary, sizeof summary);
        printf("%s%s/report.html\n", summary, study->options.folder);
    }
}

int umbt_study_command(int argc, char **argv)
{
    static struct umbt_study study; /* large: not on the stack */
    struct umb_error error = {0};
    memset(&study, 0, sizeof study);
    study.started_s = umbt_now_s();
    enum umb_status status = options_parse(argc, argv, &study.options, &error);
    if (status == UMB_OK && study.options.help) {
        fputs(help, stdout);
        return 0;
    }
    if (status == UMB_OK) {
        status = study_run(&study, &error);
    }
    if (status == UMB_OK) {
        report(&study);
    }
    umbt_study_points_finish(&study.points);
    umbt_study_bakes_finish(&study);
    umbt_scene_finish(&study.scene);
    if (status != UMB_OK) {
        fprintf(stderr, "umbrage study: %s\n", error.message);
    }
    return umbu_exit_code(status);
}

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The assets of a study (study.h): one umbrage-bake a resolution, in a separate process, so that
 * its time and memory are those a user would see. The bake's own comparison with rays is off,
 * because the study compares more.
 *
 * The plan decides about the closed rule. Where it takes the rule, a second bake without it shows
 * what the rule saves; where it does not, there is one asset, which is open.
 *
 * An asset of an earlier run in FOLDER/assets is reused if it was baked from this scene by the same
 * program with the same options; these and the times of its bake are stored beside it.
 */
#define _GNU_SOURCE /* wait4 */
#include "study/study.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "base/try.h"
#include "study/study_math.h"
#include "tool/clock.h"
#include "tool/exit_code.h"
#include "umbrage/version.h"

#define PATH_BYTES   UMBT_STUDY_PATH
#define LOWEST       512
#define ARGS_MAX     32
#define TALK_BYTES   200
#define WAY_BYTES    8192 /* version and options of a bake, as a line */
#define EXIT_NO_ROOM 75   /* umbrage-bake's exit code for memory and limits */

enum umb_status umbt_study_path(const struct umbt_study *study, const char *name,
                                char path[UMBT_STUDY_PATH], struct umb_error *error)
{
    return snprintf(path, PATH_BYTES, "%s/%s", study->common.output, name) < PATH_BYTES
               ? UMB_OK
               : umb_fail(error, UMB_E_ARGUMENT, "-o: the path has more than %d bytes",
                          PATH_BYTES - 1);
}

enum umb_status umbt_study_folder(const struct umbt_study *study, const char *name,
                                  struct umb_error *error)
{
    char path[PATH_BYTES];
    UMB__TRY(umbt_study_path(study, name, path, error));
    return mkdir(path, 0777) == 0 || errno == EEXIST
               ? UMB_OK
               : umb_fail_errno(error, UMB_E_CANNOT_CREATE, errno, "-o: folder '%.200s'", path);
}

enum {
    ASSET,
    TIMES, /* times of its bake */
    TALK,  /* messages of its bake */
    FILES
};

static enum umb_status paths_make(const struct umbt_study *study, const char *bake,
                                  char paths[FILES][PATH_BYTES], struct umb_error *error)
{
    static const char *const endings[FILES] = {"umb", "times", "log"};
    for (int i = 0; i < FILES; i++) {
        char name[UMBT_STUDY_NAME + 16];
        (void)snprintf(name, sizeof name, "assets/%s.%s", bake, endings[i]);
        UMB__TRY(umbt_study_path(study, name, paths[i], error));
    }
    return UMB_OK;
}

/* Path of umbrage-bake, beside the running program. */
static enum umb_status find_bake(char path[PATH_BYTES], struct umb_error *error)
{
    ssize_t got = readlink("/proc/self/exe", path, PATH_BYTES - 16);
    if (got <= 0) {
        return umb_fail_errno(error, UMB_E_UNAVAILABLE, errno,
                              "cannot find the folder of the running program");
    }
    path[got] = '\0';
    char *slash = strrchr(path, '/');
    memcpy(slash != NULL ? slash + 1 : path, "umbrage-bake", sizeof "umbrage-bake");
    if (access(path, X_OK) != 0) {
        return umb_fail_errno(error, UMB_E_UNAVAILABLE, errno, "%.200s", path);
    }
    return UMB_OK;
}

/* Returns the name that chooses the first of several lights of the file, or NULL. */
static const char *first_light(const struct umbt_study *study)
{
    const struct umbs_scene_view *file = &study->common.scene.scene->view;
    return file->light_count > 1 && file->lights[0].name[0] != '\0' ? file->lights[0].name : NULL;
}

/* Adds the options of the light: the given one, else the file's first. */
static size_t light_arguments(const struct umbt_study *study, const char **arguments, size_t count)
{
    const struct umbt_study_options *o = &study->options;
    const int given = o->sun != NULL || o->light != NULL || o->point != NULL || o->spot != NULL;
    const char *const rows[][2] = {{"--sun", o->sun},
                                   {"--light", given ? o->light : first_light(study)},
                                   {"--point", o->point},
                                   {"--spot", o->spot},
                                   {"--light-size", o->light_size},
                                   {"--up", o->up}};
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        if (rows[i][1] != NULL) {
            arguments[count++] = rows[i][0];
            arguments[count++] = rows[i][1];
        }
    }
    return count;
}

/* Fills the command line of one bake; texts are borrowed. */
static void fill_arguments(const struct umbt_study *study, const struct umbt_study_bake *bake,
                           char paths[FILES][PATH_BYTES], char *numbers, const char **arguments)
{
    const char *fixed[] = {"umbrage-bake", study->common.scene_path,
                           "-o",           paths[ASSET],
                           "--verify",     "0",
                           "--quiet",      "--closed",
                           bake->rule,     "--resolution",
                           numbers,        "--threads",
                           numbers + 16};
    size_t count = 0;
    (void)snprintf(numbers, 16, "%u", bake->resolution);
    (void)snprintf(numbers + 16, 16, "%u", study->common.threads);
    for (; count < sizeof fixed / sizeof fixed[0]; count++) {
        arguments[count] = fixed[count];
    }
    arguments[light_arguments(study, arguments, count)] = NULL;
}

/* Writes the program's version and the options that decide what a bake makes, as one line. */
static void way_of(const struct umbt_study *study, const struct umbt_study_bake *bake,
                   char way[WAY_BYTES])
{
    const char *arguments[ARGS_MAX] = {NULL};
    size_t used = 0;
    const size_t count = light_arguments(study, arguments, 0);
    used += (size_t)snprintf(way, WAY_BYTES, "%s --closed %s", UMB_VERSION_TEXT, bake->rule);
    for (size_t i = 0; i < count && used < WAY_BYTES; i++) {
        used += (size_t)snprintf(way + used, WAY_BYTES - used, " %s", arguments[i]);
    }
    for (char *at = way; *at != '\0'; at++) {
        *at = *at == '\n' || *at == '\r' ? ' ' : *at;
    }
}

/* In the child: never returns. */
static void become_bake(const char *program, const char *const *arguments, const char *talk)
{
    int fd = open(talk, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
    if (fd < 0 || dup2(fd, STDERR_FILENO) < 0 || dup2(fd, STDOUT_FILENO) < 0) {
        _exit(127);
    }
    (void)execv(program, (char *const *)(uintptr_t)arguments);
    _exit(127);
}

static void last_line(const char *path, char *line, size_t size)
{
    char text[512];
    FILE *file = fopen(path, "r");
    line[0] = '\0';
    while (file != NULL && fgets(text, sizeof text, file) != NULL) {
        text[strcspn(text, "\n")] = '\0';
        (void)snprintf(line, size, "%.*s", (int)size - 1, text);
    }
    if (file != NULL) {
        (void)fclose(file);
    }
}

static double seconds_of(const struct timeval *time)
{
    return (double)time->tv_sec + 1e-6 * (double)time->tv_usec;
}

/* Runs one bake. Out: its exit code, 128 and more for a signal. */
static enum umb_status run_bake(const struct umbt_study *study, struct umbt_study_bake *bake,
                                char paths[FILES][PATH_BYTES], int *code, struct umb_error *error)
{
    char program[PATH_BYTES], numbers[32];
    const char *arguments[ARGS_MAX];
    int status = 0;
    struct rusage usage;
    UMB__TRY(find_bake(program, error));
    fill_arguments(study, bake, paths, numbers, arguments);
    const double start = umbu_clock_s();
    pid_t ended, child = fork();
    if (child == 0) {
        become_bake(program, arguments, paths[TALK]);
    }
    if (child < 0) {
        return umb_fail_errno(error, UMB_E_LIMIT, errno, "cannot start umbrage-bake");
    }
    do {
        ended = wait4(child, &status, 0, &usage);
    } while (ended < 0 && errno == EINTR);
    if (ended != child) {
        return umb_fail_errno(error, UMB_E_INTERNAL, errno, "umbrage-bake's end is lost");
    }
    bake->wall_s = umbu_clock_s() - start;
    bake->cpu_s = seconds_of(&usage.ru_utime) + seconds_of(&usage.ru_stime);
    *code = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
    return UMB_OK;
}

static void times_save(const char *path, const char *way, const struct umbt_study_bake *bake)
{
    FILE *file = fopen(path, "w"); /* without this file the next run bakes again */
    if (file != NULL) {
        (void)fprintf(file, "%.6f %.6f\n%s\n", bake->wall_s, bake->cpu_s, way);
        (void)fclose(file);
    }
}

/* Reads the times of a bake. Returns 0 unless it was made in the same way. */
static int times_load(const char *path, const char *way, struct umbt_study_bake *bake)
{
    char line[WAY_BYTES + 2] = "";
    FILE *file = fopen(path, "r");
    int good = file != NULL && fscanf(file, "%lf %lf ", &bake->wall_s, &bake->cpu_s) == 2 &&
               fgets(line, sizeof line, file) != NULL;
    if (file != NULL) {
        (void)fclose(file);
    }
    line[strcspn(line, "\n")] = '\0';
    return good && strcmp(line, way) == 0;
}

static enum umb_status resolution_open(struct umbt_study_bake *bake, const char *path,
                                       struct umb_error *error)
{
    UMB__TRY(umb_asset_open_file(path, NULL, &bake->asset, error));
    umb_asset_get_info(bake->asset, &bake->info);
    UMB__TRY(umb_asset_get_light(bake->asset, 0, &bake->light));
    if (bake->light.frustum_count > UMBT_STUDY_FACES) {
        return umb_fail(error, UMB_E_UNSUPPORTED, "%s: a light of %u frusta; the study takes %d",
                        bake->file, bake->light.frustum_count, UMBT_STUDY_FACES);
    }
    for (uint32_t i = 0; i < bake->light.frustum_count; i++) {
        UMB__TRY(
            umb_asset_get_frustum(bake->asset, bake->light.first_frustum + i, &bake->frusta[i]));
    }
    return UMB_OK;
}

static void resolution_close(struct umbt_study_bake *bake)
{
    umb_asset_close(bake->asset);
    bake->asset = NULL;
}

/* 1 if an earlier run left this asset. */
static int resolution_reuse(const struct umbt_study *study, struct umbt_study_bake *bake,
                            char paths[FILES][PATH_BYTES])
{
    struct umb_error ignored;
    char way[WAY_BYTES];
    way_of(study, bake, way);
    if (access(paths[ASSET], R_OK) != 0 || !times_load(paths[TIMES], way, bake) ||
        resolution_open(bake, paths[ASSET], &ignored) != UMB_OK) {
        resolution_close(bake);
        return 0;
    }
    const int same = memcmp(bake->info.scene_hash, study->common.scene.hash, UMB_ID_BYTES) == 0 &&
                     bake->resolution == 1U << umbt_study_frustum(bake)->log2_size;
    if (!same) {
        resolution_close(bake);
    }
    return same;
}

static enum umb_status status_of(int code)
{
    static const enum umb_status known[] = {UMB_E_ARGUMENT, UMB_E_BAD_SCENE, UMB_E_NO_INPUT,
                                            UMB_E_CANNOT_CREATE, UMB_E_IO};
    for (size_t i = 0; i < sizeof known / sizeof known[0]; i++) {
        if (umbu_exit_code(known[i]) == code) {
            return known[i];
        }
    }
    return UMB_E_UNAVAILABLE;
}

/* Bakes one asset, or writes the reason for a failure to bake->reason. */
static enum umb_status resolution_bake(const struct umbt_study *study, struct umbt_study_bake *bake,
                                       struct umb_error *error)
{
    char paths[FILES][PATH_BYTES];
    char talk[TALK_BYTES], way[WAY_BYTES];
    int code = 0;
    enum umb_status status = paths_make(study, bake->file, paths, error);
    if (status != UMB_OK || resolution_reuse(study, bake, paths)) {
        return status;
    }
    UMB__TRY(run_bake(study, bake, paths, &code, error));
    if (code == 0) {
        way_of(study, bake, way);
        times_save(paths[TIMES], way, bake);
        return resolution_open(bake, paths[ASSET], error);
    }
    last_line(paths[TALK], talk, sizeof talk);
    (void)snprintf(bake->reason, sizeof bake->reason, "%.200s", talk);
    if (code != EXIT_NO_ROOM) {
        return umb_fail(error, status_of(code), "%s: %.200s (umbrage-bake ended with %d)",
                        bake->file, talk, code);
    }
    return UMB_OK;
}

/* Names a bake by its resolution and rule; a failed bake by its file. */
static void bake_name(struct umbt_study_bake *bake)
{
    const char *kind = umbt_study_is_closed(bake) ? "closed" : "open";
    if (bake->asset != NULL) {
        (void)snprintf(bake->name, sizeof bake->name, "%u-%s", bake->resolution, kind);
    } else {
        memcpy(bake->name, bake->file, sizeof bake->name);
    }
}

/* Bakes one resolution with a value of --closed, and adds it to the study. Out: fits: 0 if there is
 * no room for it. */
static enum umb_status resolution_add(struct umbt_study *study, uint32_t resolution,
                                      const char *rule, int *fits, struct umb_error *error)
{
    struct umbt_study_bake *bake = &study->bakes[study->bake_count];
    memset(bake, 0, sizeof *bake);
    bake->resolution = resolution;
    bake->rule = rule;
    (void)snprintf(bake->file, sizeof bake->file, "%u-%s", resolution, rule);
    if (!study->common.quiet) {
        fprintf(stderr, "umbrage study: bake %u, closed rule %s\n", resolution, rule);
    }
    enum umb_status status = resolution_bake(study, bake, error);
    if (status != UMB_OK) {
        resolution_close(bake);
        return status;
    }
    bake_name(bake);
    study->bake_count++;
    *fits = bake->reason[0] == '\0';
    return UMB_OK;
}

enum umb_status umbt_study_bake_all(struct umbt_study *study, struct umb_error *error)
{
    int fits = 1, open_fits = 1;
    UMB__TRY(umbt_study_folder(study, "", error));
    UMB__TRY(umbt_study_folder(study, "assets", error));
    for (uint64_t resolution = LOWEST; fits && resolution <= study->options.max_resolution &&
                                       study->bake_count + 2 <= UMBT_STUDY_BAKES_MAX;
         resolution *= 2) {
        UMB__TRY(resolution_add(study, (uint32_t)resolution, "auto", &fits, error));
        if (open_fits && umbt_study_is_closed(&study->bakes[study->bake_count - 1])) {
            UMB__TRY(resolution_add(study, (uint32_t)resolution, "off", &open_fits, error));
        }
    }
    if (study->bakes[0].asset == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "%s: %.200s", study->bakes[0].name,
                        study->bakes[0].reason);
    }
    study->light_count = study->bakes[0].info.light_count;
    return UMB_OK;
}

void umbt_study_bakes_finish(struct umbt_study *study)
{
    for (uint32_t i = 0; i < study->bake_count; i++) {
        resolution_close(&study->bakes[i]);
    }
    study->bake_count = 0;
}

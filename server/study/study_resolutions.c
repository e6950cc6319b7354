/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The assets of a study (study.h): one umbrage-bake a resolution, in a separate process, so that
 * its time and memory are those a user would see. The bake's own comparison with rays is off,
 * because the study compares more.
 *
 * An asset of an earlier run in FOLDER/assets is reused if it was baked from this scene at this
 * resolution; the times of its bake are stored beside it.
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

#define PATH_BYTES   UMBT_STUDY_PATH
#define LOWEST       512
#define ARGS_MAX     32
#define TALK_BYTES   200
#define EXIT_NO_ROOM 75 /* umbrage-bake's exit code for memory and limits */

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

/* Fills the command line of one bake; texts are borrowed. */
static void fill_arguments(const struct umbt_study *study, const struct umbt_study_bake *bake,
                           char paths[FILES][PATH_BYTES], char *numbers, const char **arguments)
{
    const struct umbt_study_options *o = &study->options;
    const char *fixed[] = {"umbrage-bake", study->common.scene_path, "-o", paths[ASSET], "--verify",
                           "0", "--quiet", "--closed", bake->closed ? "auto" : "off",
                           "--resolution", numbers, "--threads",
                           /* Because rays know only opaque and open. */
                           numbers + 16, "--effect", "transmittance=off"};
    size_t count = 0;
    (void)snprintf(numbers, 16, "%u", bake->resolution);
    (void)snprintf(numbers + 16, 16, "%u", study->common.threads);
    for (; count < sizeof fixed / sizeof fixed[0]; count++) {
        arguments[count] = fixed[count];
    }
    const char *const optional[][2] = {{"--sun", o->sun}, {"--light", o->light}, {"--up", o->up}};
    for (size_t i = 0; i < sizeof optional / sizeof optional[0]; i++) {
        if (optional[i][1] != NULL) {
            arguments[count++] = optional[i][0];
            arguments[count++] = optional[i][1];
        }
    }
    arguments[count] = NULL;
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

static void times_save(const char *path, const struct umbt_study_bake *bake)
{
    FILE *file = fopen(path, "w"); /* without this file the next run bakes again */
    if (file != NULL) {
        (void)fprintf(file, "%.6f %.6f\n", bake->wall_s, bake->cpu_s);
        (void)fclose(file);
    }
}

static int times_load(const char *path, struct umbt_study_bake *bake)
{
    FILE *file = fopen(path, "r");
    int good = file != NULL && fscanf(file, "%lf %lf", &bake->wall_s, &bake->cpu_s) == 2;
    if (file != NULL) {
        (void)fclose(file);
    }
    return good;
}

static enum umb_status resolution_open(struct umbt_study_bake *bake, const char *path,
                                       struct umb_error *error)
{
    UMB__TRY(umb_asset_open_file(path, NULL, &bake->asset, error));
    umb_asset_get_info(bake->asset, &bake->info);
    UMB__TRY(umb_asset_get_light(bake->asset, 0, &bake->light));
    UMB__TRY(umb_asset_get_frustum(bake->asset, bake->light.first_frustum, &bake->frustum));
    if (bake->light.kind != UMB_LIGHT_DIRECTIONAL) {
        return umb_fail(error, UMB_E_UNSUPPORTED, "--light: the study knows directional lights");
    }
    bake->voxel_m =
        0.5 * (umb__length(bake->frustum.voxel_step[0]) + umb__length(bake->frustum.voxel_step[1]));
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
    if (access(paths[ASSET], R_OK) != 0 || !times_load(paths[TIMES], bake) ||
        resolution_open(bake, paths[ASSET], &ignored) != UMB_OK) {
        resolution_close(bake);
        return 0;
    }
    const int same = memcmp(bake->info.scene_hash, study->common.scene.hash, UMB_ID_BYTES) == 0 &&
                     bake->resolution == 1U << bake->frustum.log2_size;
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
    char talk[TALK_BYTES];
    int code = 0;
    enum umb_status status = paths_make(study, bake->name, paths, error);
    if (status != UMB_OK || resolution_reuse(study, bake, paths)) {
        return status;
    }
    UMB__TRY(run_bake(study, bake, paths, &code, error));
    if (code == 0) {
        times_save(paths[TIMES], bake);
        return resolution_open(bake, paths[ASSET], error);
    }
    last_line(paths[TALK], talk, sizeof talk);
    (void)snprintf(bake->reason, sizeof bake->reason, "%.200s", talk);
    if (code != EXIT_NO_ROOM) {
        return umb_fail(error, status_of(code), "%s: %.200s (umbrage-bake ended with %d)",
                        bake->name, talk, code);
    }
    return UMB_OK;
}

/* Adds one resolution, open or closed. Out: 0 if it is the last. */
static enum umb_status resolution_add(struct umbt_study *study, uint32_t resolution, int closed,
                                      int *more, struct umb_error *error)
{
    struct umbt_study_bake *bake = &study->bakes[study->bake_count];
    memset(bake, 0, sizeof *bake);
    bake->resolution = resolution;
    bake->closed = closed;
    (void)snprintf(bake->name, sizeof bake->name, "%u-%s", resolution, closed ? "closed" : "open");
    if (!study->common.quiet) {
        fprintf(stderr, "umbrage study: bake %s\n", bake->name);
    }
    enum umb_status status = resolution_bake(study, bake, error);
    if (status != UMB_OK) {
        resolution_close(bake);
        return status;
    }
    study->bake_count++;
    *more = bake->reason[0] == '\0';
    return UMB_OK;
}

enum umb_status umbt_study_bake_all(struct umbt_study *study, struct umb_error *error)
{
    UMB__TRY(umbt_study_folder(study, "", error));
    UMB__TRY(umbt_study_folder(study, "assets", error));
    const int any_closed = study->common.scene.parts.closed_triangles > 0;
    for (int closed = any_closed; closed >= 0; closed--) {
        int more = 1;
        for (uint64_t resolution = LOWEST; more && resolution <= study->options.max_resolution &&
                                           study->bake_count < UMBT_STUDY_BAKES_MAX;
             resolution *= 2) {
            UMB__TRY(resolution_add(study, (uint32_t)resolution, closed, &more, error));
        }
    }
    return UMB_OK;
}

void umbt_study_bakes_finish(struct umbt_study *study)
{
    for (uint32_t i = 0; i < study->bake_count; i++) {
        resolution_close(&study->bakes[i]);
    }
    study->bake_count = 0;
}

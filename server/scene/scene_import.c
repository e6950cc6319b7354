/* SPDX-License-Identifier: Apache-2.0 */
/*
 * umbs_scene_import (scene.h): opens the file, has it parsed by another process, takes a sealed
 * buffer back and validates it. No byte of the scene file is looked at here.
 *
 * The order matters: the memfd is sealed before it is mapped and validated, so that what was
 * checked cannot change any more, even if a process of the importer survived.
 */
#define _GNU_SOURCE /* memfd_create, O_PATH, F_ADD_SEALS */
#include "scene/scene.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/open_status.h"
#include "base/try.h"
#include "scene/scene_contract.h"
#include "scene/scene_process.h"
#include "common/clean_text.h"

#define GIB                      (1ULL << 30)
#define DEFAULT_MAX_INPUT_BYTES  (4 * GIB)
#define DEFAULT_MAX_MEMORY_BYTES (8 * GIB)
#define DEFAULT_TIMEOUT_S        600U
#define DEFAULT_MAX_FILES        65536U /* a bundle has 4096, each asked for a few times */
#define IMPORTER_NAME            "umbrage-bake"
#define PATH_BYTES               4096

/* State of one import: everything that must be closed at its end. */
struct import {
    const char *path;
    const char *name; /* last component of path */
    char shown[160];  /* name as clean text, for messages */
    struct umbs_import_options options;
    char importer[PATH_BYTES];
    int input, folder, output;
};

static enum umb_status open_input(struct import *import, struct umb_error *error)
{
    /* O_NONBLOCK: opening a pipe without a writer must not wait. The flag has no effect on
     * files. */
    import->input = open(import->path, O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY);
    if (import->input < 0) {
        return umb_fail_errno(error, umb__open_status(errno), errno, "cannot open scene '%s'",
                              import->shown);
    }
    struct stat facts;
    if (fstat(import->input, &facts) != 0) {
        return umb_fail_errno(error, UMB_E_IO, errno, "cannot look at scene '%s'", import->shown);
    }
    if (S_ISDIR(facts.st_mode)) {
        return umb_fail(error, UMB_E_NO_INPUT, "scene '%s' is a folder", import->shown);
    }
    if (!S_ISREG(facts.st_mode)) {
        return umb_fail(error, UMB_E_NO_INPUT, "scene '%s' is not a regular file", import->shown);
    }
    if ((uint64_t)facts.st_size > import->options.max_input_bytes) {
        return umb_fail(error, UMB_E_LIMIT, "scene '%s' has %" PRIu64 " bytes, limit %" PRIu64,
                        import->shown, (uint64_t)facts.st_size, import->options.max_input_bytes);
    }
    return UMB_OK;
}

static enum umb_status open_folder(struct import *import, struct umb_error *error)
{
    char folder[PATH_BYTES] = ".";
    size_t length = (size_t)(import->name - import->path);
    if (length >= sizeof(folder)) {
        return umb_fail(error, UMB_E_NO_INPUT, "path of scene '%s' has more than %d bytes",
                        import->shown, PATH_BYTES - 1);
    }
    if (length > 0) {
        memcpy(folder, import->path, length);
        folder[length] = '\0';
    }
    import->folder = open(folder, O_PATH | O_DIRECTORY | O_CLOEXEC); /* only to look names up */
    return import->folder >= 0
               ? UMB_OK
               : umb_fail_errno(error, UMB_E_NO_INPUT, errno, "folder '%s'", folder);
}

static enum umb_status open_output(struct import *import, struct umb_error *error)
{
    import->output = memfd_create("umbrage-scene", MFD_CLOEXEC | MFD_ALLOW_SEALING);
    return import->output >= 0
               ? UMB_OK
               : umb_fail_errno(error, UMB_E_IO, errno, "cannot make a memory file for the scene");
}

/* Finds the importer program: by its option, or beside the running program. */
static enum umb_status find_importer(struct import *import, struct umb_error *error)
{
    int length;
    if (import->options.importer_path != NULL) {
        length = snprintf(import->importer, sizeof(import->importer), "%s",
                          import->options.importer_path);
    } else {
        char self[PATH_BYTES];
        ssize_t got = readlink("/proc/self/exe", self, sizeof(self) - 1);
        if (got < 0) {
            return umb_fail_errno(error, UMB_E_UNAVAILABLE, errno,
                                  "cannot find the folder of the running program");
        }
        self[got] = '\0';
        char *slash = strrchr(self, '/');
        length = snprintf(import->importer, sizeof(import->importer), "%.*s/%s",
                          slash != NULL ? (int)(slash - self) : 0, self, IMPORTER_NAME);
    }
    if (length < 0 || (size_t)length >= sizeof(import->importer)) {
        return umb_fail(error, UMB_E_UNAVAILABLE, "path of the importer has more than %d bytes",
                        PATH_BYTES - 1);
    }
    return UMB_OK;
}

static int is_limit_signal(int number)
{
    /* SIGKILL comes from the hard CPU limit or from a system out of memory. */
    return number == SIGXCPU || number == SIGXFSZ || number == SIGKILL;
}

/* Turns the end of the importer into a status. */
static enum umb_status classify(const struct import *import, const struct umbs_process_end *end,
                                struct umb_error *error)
{
    if (end->asked_too_often) {
        return umb_fail(error, UMB_E_LIMIT,
                        "%s: asks for files more than %u times, the limit of a scene",
                        import->shown, import->options.max_files);
    }
    if (end->timed_out) {
        return umb_fail(error, UMB_E_LIMIT, "%s: importer took more than %u s", import->shown,
                        import->options.timeout_s);
    }
    if (end->signal != 0 && is_limit_signal(end->signal)) {
        return umb_fail(error, UMB_E_LIMIT, "%s: importer went over %s (signal %d)", import->shown,
                        end->signal == SIGXFSZ ? "its limit of output"
                                               : "its limit of time or memory",
                        end->signal);
    }
    if (end->signal == SIGSYS) {
        return umb_fail(error, UMB_E_BAD_SCENE,
                        "%s: importer stopped: it did what its sandbox forbids", import->shown);
    }
    if (end->signal != 0) {
        return umb_fail(error, UMB_E_BAD_SCENE, "%s: importer crashed (signal %d)", import->shown,
                        end->signal);
    }
    enum umb_status status;
    switch (end->exit_code) {
    case 0:
        return UMB_OK;
    case 65:
        status = UMB_E_BAD_SCENE;
        break;
    case 74:
        status = UMB_E_IO;
        break;
    case 75:
        status = UMB_E_LIMIT;
        break;
    case 69:
        status = UMB_E_UNAVAILABLE;
        break;
    case UMBS_PROCESS_EXIT_NOT_STARTED:
        return umb_fail(error, UMB_E_UNAVAILABLE, "importer program '%.200s' cannot be started",
                        import->importer);
    default:
        return umb_fail(error, UMB_E_BAD_SCENE, "%s: importer failed (exit code %d)%s%.160s",
                        import->shown, end->exit_code, end->talk[0] != '\0' ? ": " : "", end->talk);
    }
    if (end->talk[0] == '\0') {
        return umb_fail(error, status, "%s: importer refused it without a word", import->shown);
    }
    return umb_fail(error, status, "%s", end->talk);
}

static enum umb_status run_importer(struct import *import, struct umb_error *error)
{
    char memory[24], input[24], triangles[24];
    (void)snprintf(memory, sizeof(memory), "%" PRIu64, import->options.max_memory_bytes);
    (void)snprintf(input, sizeof(input), "%" PRIu64, import->options.max_input_bytes);
    (void)snprintf(triangles, sizeof(triangles), "%" PRIu64, import->options.max_triangles);
    char command[] = UMBS_CHILD_COMMAND;
    char *name = strdup(import->name);
    if (name == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for the scene's name");
    }
    char *arguments[UMBS_CHILD_ARG_COUNT + 1] = {
        [0] = import->importer,
        [UMBS_CHILD_ARG_COMMAND] = command,
        [UMBS_CHILD_ARG_NAME] = name,
        [UMBS_CHILD_ARG_MAX_MEMORY] = memory,
        [UMBS_CHILD_ARG_MAX_INPUT] = input,
        [UMBS_CHILD_ARG_MAX_TRIANGLES] = triangles,
    };
    const struct umbs_process process = {
        .program = import->importer,
        .arguments = arguments,
        .input = import->input,
        .folder = import->folder,
        .output = import->output,
        .max_files = import->options.max_files,
        .timeout_s = import->options.timeout_s,
        .max_output_bytes = import->options.max_memory_bytes,
        .shut_in = import->options.shut_in,
        .user = import->options.user,
    };
    struct umbs_process_end end;
    enum umb_status status = umbs_process_run(&process, &end, error);
    free(name);
    return status == UMB_OK ? classify(import, &end, error) : status;
}

/* Seals, maps and validates the importer's output in the memfd. */
static enum umb_status take_output(const struct import *import, struct umbs_scene *scene,
                                   struct umb_error *error)
{
    const int seals = F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_WRITE | F_SEAL_SEAL;
    struct stat facts;
    if (fcntl(import->output, F_ADD_SEALS, seals) != 0) {
        return umb_fail_errno(error, UMB_E_IO, errno, "cannot seal the scene buffer");
    }
    if (fstat(import->output, &facts) != 0) {
        return umb_fail_errno(error, UMB_E_IO, errno, "cannot look at the scene buffer");
    }
    if (facts.st_size <= 0 || (uint64_t)facts.st_size > SIZE_MAX) {
        return umb_fail(error, UMB_E_BAD_SCENE, "%s: importer wrote no scene", import->shown);
    }
    size_t size = (size_t)facts.st_size;
    void *map = mmap(NULL, size, PROT_READ, MAP_PRIVATE, import->output, 0);
    if (map == MAP_FAILED) {
        return umb_fail_errno(error, UMB_E_NO_MEMORY, errno, "cannot map %zu bytes of scene", size);
    }
    scene->map = map;
    scene->map_bytes = size;
    enum umb_status status = umbs_scene_view(map, size, &scene->view, error);
    if (status == UMB_OK && scene->view.world_triangle_count > import->options.max_triangles) {
        return umb_fail(error, UMB_E_LIMIT, "%s: %" PRIu64 " triangles, limit %" PRIu64,
                        import->shown, scene->view.world_triangle_count,
                        import->options.max_triangles);
    }
    return status;
}

static void fill_defaults(struct umbs_import_options *options)
{
    if (options->max_input_bytes == 0) {
        options->max_input_bytes = DEFAULT_MAX_INPUT_BYTES;
    }
    if (options->max_memory_bytes == 0) {
        options->max_memory_bytes = DEFAULT_MAX_MEMORY_BYTES;
    }
    if (options->max_triangles == 0) {
        options->max_triangles = UMBS_TRIANGLES_MAX;
    }
    if (options->max_files == 0) {
        options->max_files = DEFAULT_MAX_FILES;
    }
    if (options->timeout_s == 0) {
        options->timeout_s = DEFAULT_TIMEOUT_S;
    }
}

static void close_import(struct import *import)
{
    const int all[3] = {import->input, import->folder, import->output};
    for (int i = 0; i < 3; i++) {
        if (all[i] >= 0) {
            (void)close(all[i]);
        }
    }
}

static enum umb_status import_scene(struct import *import, struct umbs_scene *scene,
                                    struct umb_error *error)
{
    UMB__TRY(open_input(import, error));
    UMB__TRY(open_folder(import, error));
    UMB__TRY(find_importer(import, error));
    UMB__TRY(open_output(import, error));
    UMB__TRY(run_importer(import, error));
    return take_output(import, scene, error);
}

enum umb_status umbs_scene_import(const char *path, const struct umbs_import_options *options,
                                  struct umbs_scene **out, struct umb_error *error)
{
    *out = NULL;
    struct import import = {.path = path, .input = -1, .folder = -1, .output = -1};
    if (options != NULL) {
        import.options = *options;
    }
    fill_defaults(&import.options);
    const char *slash = strrchr(path, '/');
    import.name = slash != NULL ? slash + 1 : path;
    umbs_text_clean(import.shown, sizeof(import.shown), import.name, strlen(import.name));
    if (import.shown[0] == '\0') { /* the path ends with a slash */
        umbs_text_clean(import.shown, sizeof(import.shown), path, strlen(path));
    }
    struct umbs_scene *scene = calloc(1, sizeof(*scene));
    if (scene == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a scene");
    }
    const enum umb_status status = import_scene(&import, scene, error);
    close_import(&import);
    if (status != UMB_OK) {
        umbs_scene_destroy(scene);
        return status;
    }
    *out = scene;
    return UMB_OK;
}

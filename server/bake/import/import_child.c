/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The importer's process (import_job.h): set limits, enter the sandbox, map, read, write.
 *
 * The limit of the address space and the sandbox are in force before a byte of the scene is read.
 * Sanitizers reserve terabytes of address space, so their builds work without both.
 */

#include <errno.h>
#include <jansson.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>
#include <sys/resource.h>
#include <unistd.h>

#include "bake/import/import_job.h"
#include "bake/import/up_axis.h"
#include "bake/sandbox/sandbox.h"
#include "base/try.h"
#include "scene/scene_broker.h"
#include "scene/scene_contract.h"
#include "scene/scene_file.h"
#include "common/child_process.h"
#include "common/clean_text.h"
#include "tool/exit_code.h"
#include "tool/options.h"

#define EXIT_USAGE 2
#define EXIT_READ  74

/* Writes the importer's only message to its pipe. If the pipe's reader is gone, nothing happens. */
static void say(const char *name, const char *message)
{
    char shown[160];
    char line[512];
    umbs_text_clean(shown, sizeof(shown), name, strlen(name));
    int length = snprintf(line, sizeof(line), "%s: %s\n", shown, message);
    if (length > 0) {
        size_t count = (size_t)length < sizeof(line) ? (size_t)length : sizeof(line) - 1;
        ssize_t written = write(STDERR_FILENO, line, count);
        (void)written;
    }
}

static int parse_argument(const char *text, uint64_t *value)
{
    return umbu_read_count(&text, value) && *text == '\0' && *value > 0;
}

static enum umb_status write_output(void *user, const void *bytes, size_t count)
{
    int fd = *(const int *)user;
    const char *at = bytes;
    while (count > 0) {
        size_t step = count < (1U << 30) ? count : 1U << 30;
        ssize_t written = write(fd, at, step);
        if (written < 0 && errno == EINTR) {
            continue;
        }
        if (written <= 0) {
            return errno == EFBIG || errno == ENOSPC || errno == ENOMEM ? UMB_E_LIMIT : UMB_E_IO;
        }
        at += written;
        count -= (size_t)written;
    }
    return UMB_OK;
}

/* Reads the mapped scene by the reader of its extension. */
static enum umb_status read_scene(struct umbb_import *job, const char *name, uint64_t max_triangles,
                                  struct umb_error *error)
{
    static const struct {
        const char *extension;
        enum umbs_format format;
        enum umb_status (*read)(struct umbb_import *job, struct umb_error *error);
    } known[] = {
        {".gltf", UMBS_FORMAT_GLTF, umbb_gltf_read}, {".glb", UMBS_FORMAT_GLTF, umbb_gltf_read},
        {".obj", UMBS_FORMAT_OBJ, umbb_obj_read},    {".ply", UMBS_FORMAT_PLY, umbb_ply_read},
        {".stl", UMBS_FORMAT_STL, umbb_stl_read},
    };
    const char *extension = strrchr(name, '.');
    if (umbb_starts_with(umbb_text_of(&job->file), UMBS_SCENE_FILE_MAGIC)) {
        return UMBB_REFUSE(
            error, "the file is a scene buffer of umbrage-bake import (UMBSCF1), not a scene; "
                   "if it is your own, give it by --scene-buffer");
    }
    for (size_t i = 0; extension != NULL && i < sizeof known / sizeof known[0]; i++) {
        if (strcasecmp(extension, known[i].extension) != 0) {
            continue;
        }
        if (job->file.size == 0) {
            return UMBB_REFUSE(error, "the file is empty");
        }
        umbs_scene_builder_init(&job->scene, known[i].format, known[i].format != UMBS_FORMAT_GLTF,
                                max_triangles);
        return known[i].read(job, error);
    }
    return UMBB_REFUSE(error, "format '%.16s' is not supported (.gltf .glb .obj .ply .stl)",
                       extension != NULL ? extension : "without extension");
}

static enum umb_status convert(struct umbb_import *job, const char *name, uint64_t max_triangles,
                               struct umb_error *error)
{
    int output = UMBS_CHILD_FD_OUTPUT;
    const struct umb_sink sink = {write_output, &output};
    UMB__TRY(read_scene(job, name, max_triangles, error));
    if (job->scene.format != UMBS_FORMAT_GLTF) {
        umbb_up_decide(job);
    }
    return umbs_scene_builder_write(&job->scene, &sink, error);
}

static enum umb_status import(const char *name, uint64_t max_input, uint64_t max_triangles,
                              int look, struct umb_error *error)
{
    struct umbb_import job = {.folder = {UMBS_CHILD_FD_FILES, umbs_broker_open},
                              .max_input_bytes = max_input,
                              .look = look};
    struct umbb_sandbox sandbox;
    json_object_seed(0); /* from /dev/urandom, which the sandbox closes */
    UMB__TRY(umbb_sandbox_enter(&sandbox, error));
    UMB__TRY(umbb_file_map(UMBS_CHILD_FD_INPUT, max_input, &job.file, error));
    const enum umb_status status = convert(&job, name, max_triangles, error);
    umbb_file_unmap(&job.file);
    umbs_scene_builder_finish(&job.scene);
    return status;
}

int umbb_import_child(int argc, char **argv)
{
    uint64_t max_memory, max_input, max_triangles, look;
    struct umb_error error = {0};
    /* Makes writing beyond RLIMIT_FSIZE an error with a message instead of a signal. */
    (void)signal(SIGXFSZ, SIG_IGN);
    if (argc != UMBS_CHILD_ARG_COUNT ||
        !parse_argument(argv[UMBS_CHILD_ARG_MAX_MEMORY], &max_memory) ||
        !parse_argument(argv[UMBS_CHILD_ARG_MAX_INPUT], &max_input) ||
        !parse_argument(argv[UMBS_CHILD_ARG_MAX_TRIANGLES], &max_triangles) ||
        !parse_argument(argv[UMBS_CHILD_ARG_LOOK], &look)) {
        say(UMBS_CHILD_COMMAND, "is started by umbrage itself, not by people");
        return EXIT_USAGE;
    }
    const char *name = argv[UMBS_CHILD_ARG_NAME];
    if (!umbb_sandbox_exempt() && umbs_child_limit(RLIMIT_AS, max_memory, max_memory) != 0) {
        say(name, "the importer cannot limit its memory");
        return EXIT_READ;
    }
    enum umb_status status = import(name, max_input, max_triangles, look == 2, &error);
    if (status == UMB_OK) {
        return 0;
    }
    if (status == UMB_E_NO_MEMORY) {
        (void)snprintf(error.message, sizeof(error.message),
                       "the importer needs more than its limit of %llu MiB of memory",
                       (unsigned long long)(max_memory >> 20));
    }
    say(name, error.message);
    return umbu_exit_code(status);
}

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * umbs_scene_import (scene.h): opens the file, has it parsed by another process, takes a sealed
 * buffer back and validates it. No byte of the scene file is looked at here.
 *
 * The order matters: the memfd is sealed before it is mapped and validated, so that what was
 * checked cannot change any more, even if a process of the importer survived.
 *
 * The importer's process is started with limits, watched, and always reaped. Its limits are set
 * before the program starts, so that no bug of the importer can skip them. One limit is left to the
 * importer, as its first action: the address space. A sanitizer build cannot run under such a
 * limit, and only the importer knows how it was built.
 *
 * Between fork and exec only async-signal-safe calls are made, because the caller may have many
 * threads; everything they need is prepared before. The wait ends for certain: the loop's only
 * condition is the process's own end, and at the deadline the whole process group is killed.
 * Sources: fork(2), prctl(2), signal-safety(7).
 */
#define _GNU_SOURCE /* memfd_create, O_PATH, F_ADD_SEALS, pipe2 */
#include "scene/scene.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sysexits.h>
#include <unistd.h>

#include "base/open_status.h"
#include "base/try.h"
#include "common/child_process.h"
#include "common/clean_text.h"
#include "common/file_system.h"
#include "scene/scene_broker.h"
#include "scene/scene_contract.h"
#include "tool/clock.h"

#define GIB                      (1ULL << 30)
#define DEFAULT_MAX_INPUT_BYTES  (4 * GIB)
#define DEFAULT_MAX_MEMORY_BYTES (8 * GIB)
#define DEFAULT_TIMEOUT_S        600U
#define DEFAULT_MAX_FILES        65536U /* a bundle has 4096, each asked for a few times */
#define IMPORTER_NAME            "umbrage-bake"
#define PATH_BYTES               4096
#define EXIT_NOT_STARTED         127
/* Limit of the importer's descriptors: input, output, one file of the scene at a time, and some
 * that sanitizers open. */
#define CHILD_FDS_MAX 32U
/* Longest delay in milliseconds until the end of a child is noticed, if another process still holds
 * its pipe. */
#define POLL_STEP_MS 50

/* State of one import: everything that must be closed at its end, and how the process ended. */
struct import {
    const char *path;
    const char *name; /* last component of path */
    char shown[160];  /* name as clean text, for messages */
    struct umbs_import_options options;
    char importer[PATH_BYTES];
    int input, folder, output;
    int talk[2];         /* pipe for the importer's one message; [0] is this process's end */
    int files[2];        /* socket of scene_broker.h; [0] is this process's end */
    uint32_t files_left; /* number of files that the importer may still ask for */
    int timed_out;       /* 1: killed at the wall-clock limit */
    int asked_too_often; /* 1: killed because it asked for more than max_files files */
    int exit_code;       /* 0..255; -1: a signal ended the process */
    int signal;          /* signal that ended the process, or 0 */
    char said[1024];     /* begin of its message; after its end the first line as clean text */
    size_t said_bytes;
};

_Static_assert(UMBS_CHILD_FD_INPUT == 3 && UMBS_CHILD_FD_FILES == 4 && UMBS_CHILD_FD_OUTPUT == 5,
               "as become_program lays them out");

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

/* In the child: never returns. */
static void become_program(const struct import *import, char *const *arguments,
                           char *const *environment, pid_t parent)
{
    const uint64_t seconds = import->options.timeout_s, bytes = import->options.max_memory_bytes;
    int sources[] = {-1, -1, import->talk[1], import->input, import->files[1], import->output};
    if (umbs_child_own_group(parent) != 0 || prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0 ||
        umbs_child_lay_out(sources, sizeof sources / sizeof sources[0]) != 0 ||
        umbs_child_limit(RLIMIT_CORE, 0, 0) != 0 ||
        umbs_child_limit(RLIMIT_CPU, seconds, seconds + 1) != 0 ||
        umbs_child_limit(RLIMIT_FSIZE, bytes, bytes) != 0 ||
        umbs_child_limit(RLIMIT_NOFILE, CHILD_FDS_MAX, CHILD_FDS_MAX) != 0 ||
        umbs_child_reset_signals() != 0) {
        _exit(EXIT_NOT_STARTED);
    }
    execve(import->importer, arguments, environment);
    _exit(EXIT_NOT_STARTED);
}

/* Reads all available bytes of the importer's message. Keeps the first ones, as far as they fit,
 * and drops the rest. Closes the pipe at its end. */
static void drain(struct import *import)
{
    char chunk[1024];
    for (;;) {
        ssize_t got = read(import->talk[0], chunk, sizeof chunk);
        if (got < 0 && errno == EINTR) {
            continue;
        }
        if (got < 0 && errno == EAGAIN) {
            return;
        }
        if (got <= 0) {
            umbs_hang_up(&import->talk[0]);
            return;
        }
        const size_t room = sizeof import->said - import->said_bytes;
        const size_t count = (size_t)got < room ? (size_t)got : room;
        memcpy(import->said + import->said_bytes, chunk, count);
        import->said_bytes += count;
    }
}

/* Waits a moment for messages or requests, and handles them. */
static void attend(struct import *import, int64_t left_ms)
{
    struct pollfd wanted[2] = {{.fd = import->talk[0], .events = POLLIN},
                               {.fd = import->files[0], .events = POLLIN}};
    /* Both ends are closed: the importer is about to end. poll ignores -1. */
    int step_ms = import->talk[0] < 0 && import->files[0] < 0 ? 1 : POLL_STEP_MS;
    (void)poll(wanted, 2, left_ms < step_ms ? (int)left_ms : step_ms);
    if (wanted[0].revents != 0) {
        drain(import);
    }
    int served = 1;
    if (wanted[1].revents != 0) {
        served = umbs_broker_serve(import->files[0], import->folder, &import->files_left);
    }
    if (served <= 0) {
        umbs_hang_up(&import->files[0]);
    }
    import->asked_too_often |= served < 0;
}

/* Waits for the end of the child; kills it at a limit. Returns 1 if the child's status was read. */
static int watch(struct import *import, pid_t child)
{
    char line[sizeof import->said];
    int64_t deadline_ms = umbu_clock_ms() + (int64_t)import->options.timeout_s * 1000;
    while (!umbs_child_has_ended(child)) {
        int64_t left_ms = deadline_ms - umbu_clock_ms();
        import->timed_out = left_ms <= 0;
        if (import->timed_out || import->asked_too_often) {
            (void)kill(child, SIGKILL); /* it may have no group yet */
            break;
        }
        attend(import, left_ms);
    }
    const int known = umbs_child_reap(child, &import->exit_code, &import->signal);
    if (import->talk[0] >= 0) {
        drain(import);
    }
    const char *newline = memchr(import->said, '\n', import->said_bytes);
    size_t length = newline != NULL ? (size_t)(newline - import->said) : import->said_bytes;
    memcpy(line, import->said, length);
    umbs_text_clean(import->said, sizeof import->said, line, length);
    return known;
}

/* Runs the program and waits for its end; no process is left behind. Fails: E_UNAVAILABLE (program
 * missing or not executable), E_IO (no process, no pipe), a failure of shut_in. */
static enum umb_status run_program(struct import *import, char *const *arguments,
                                   struct umb_error *error)
{
    char *environment[UMBS_CHILD_ENVIRONMENT_MAX];
    if (access(import->importer, X_OK) != 0) {
        return umb_fail_errno(error, UMB_E_UNAVAILABLE, errno, "importer program '%s'",
                              import->importer);
    }
    if (pipe2(import->talk, O_CLOEXEC) != 0 || umbs_broker_pair(import->files) != 0) {
        return umb_fail_errno(error, UMB_E_IO, errno, "cannot make a pipe for the importer");
    }
    (void)fcntl(import->talk[0], F_SETFL, O_NONBLOCK);
    umbs_child_environment(environment);
    pid_t parent = getpid();
    pid_t child = fork();
    if (child == 0) {
        become_program(import, arguments, environment, parent);
    }
    if (child < 0) {
        return umb_fail_errno(error, UMB_E_IO, errno, "cannot start a process for the importer");
    }
    umbs_hang_up(&import->talk[1]);
    umbs_hang_up(&import->files[1]);
    const struct umbs_import_options *options = &import->options;
    const struct umbs_importer importer = {.process = child, .files = import->files[0]};
    const enum umb_status status =
        options->shut_in != NULL ? options->shut_in(options->user, &importer, error) : UMB_OK;
    if (status != UMB_OK) {
        (void)kill(child, SIGKILL); /* it may have no group yet */
        (void)umbs_child_reap(child, &import->exit_code, &import->signal);
        return status;
    }
    if (!watch(import, child)) {
        return umb_fail(error, UMB_E_INTERNAL,
                        "the importer's exit status is lost (SIGCHLD is ignored here?)");
    }
    return UMB_OK;
}

static int is_limit_signal(int number)
{
    /* SIGKILL comes from the hard CPU limit or from a system out of memory. */
    return number == SIGXCPU || number == SIGXFSZ || number == SIGKILL;
}

/* Returns the status that an exit code of the importer reports; UMB_OK for any other code. */
static enum umb_status status_of(int exit_code)
{
    switch (exit_code) {
    case EX_DATAERR:
        return UMB_E_BAD_SCENE;
    case EX_IOERR:
        return UMB_E_IO;
    case EX_TEMPFAIL:
        return UMB_E_LIMIT;
    case EX_UNAVAILABLE:
        return UMB_E_UNAVAILABLE;
    default:
        return UMB_OK;
    }
}

/* Turns the end of the importer into a status. */
static enum umb_status classify(const struct import *import, struct umb_error *error)
{
    const int number = import->signal;
    const enum umb_status status = status_of(import->exit_code);
    if (import->asked_too_often) {
        return umb_fail(error, UMB_E_LIMIT,
                        "%s: asks for files more than %u times, the limit of a scene",
                        import->shown, import->options.max_files);
    }
    if (import->timed_out) {
        return umb_fail(error, UMB_E_LIMIT, "%s: importer took more than %u s", import->shown,
                        import->options.timeout_s);
    }
    if (is_limit_signal(number)) {
        return umb_fail(error, UMB_E_LIMIT, "%s: importer went over %s (signal %d)", import->shown,
                        number == SIGXFSZ ? "its limit of output" : "its limit of time or memory",
                        number);
    }
    if (number == SIGSYS) {
        return umb_fail(error, UMB_E_BAD_SCENE,
                        "%s: importer stopped: it did what its sandbox forbids", import->shown);
    }
    if (number != 0) {
        return umb_fail(error, UMB_E_BAD_SCENE, "%s: importer crashed (signal %d)", import->shown,
                        number);
    }
    if (import->exit_code == EXIT_NOT_STARTED) {
        return umb_fail(error, UMB_E_UNAVAILABLE, "importer program '%.200s' cannot be started",
                        import->importer);
    }
    if (import->exit_code != 0 && status == UMB_OK) {
        return umb_fail(error, UMB_E_BAD_SCENE, "%s: importer failed (exit code %d)%s%.160s",
                        import->shown, import->exit_code, import->said[0] != '\0' ? ": " : "",
                        import->said);
    }
    if (status != UMB_OK && import->said[0] == '\0') {
        return umb_fail(error, status, "%s: importer refused it without a word", import->shown);
    }
    return status != UMB_OK ? umb_fail(error, status, "%s", import->said) : UMB_OK;
}

static enum umb_status run_importer(struct import *import, struct umb_error *error)
{
    char memory[24], input[24], triangles[24];
    (void)snprintf(memory, sizeof(memory), "%" PRIu64, import->options.max_memory_bytes);
    (void)snprintf(input, sizeof(input), "%" PRIu64, import->options.max_input_bytes);
    (void)snprintf(triangles, sizeof(triangles), "%" PRIu64, import->options.max_triangles);
    char command[] = UMBS_CHILD_COMMAND;
    char look[] = {import->options.look ? '2' : '1', '\0'};
    char *arguments[UMBS_CHILD_ARG_COUNT + 1] = {
        [0] = import->importer,
        [UMBS_CHILD_ARG_COMMAND] = command,
        [UMBS_CHILD_ARG_NAME] = (char *)(uintptr_t)import->name, /* exec does not write to it */
        [UMBS_CHILD_ARG_MAX_MEMORY] = memory,
        [UMBS_CHILD_ARG_MAX_INPUT] = input,
        [UMBS_CHILD_ARG_MAX_TRIANGLES] = triangles,
        [UMBS_CHILD_ARG_LOOK] = look,
    };
    UMB__TRY(run_program(import, arguments, error));
    return classify(import, error);
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
    return umbs__scene_check(scene, import->shown, &import->options, error);
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
    int *const all[] = {&import->input,   &import->folder,   &import->output,  &import->talk[0],
                        &import->talk[1], &import->files[0], &import->files[1]};
    for (size_t i = 0; i < sizeof all / sizeof all[0]; i++) {
        umbs_hang_up(all[i]);
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
    struct import import = {
        .path = path, .input = -1, .folder = -1, .output = -1, .talk = {-1, -1}, .files = {-1, -1}};
    if (options != NULL) {
        import.options = *options;
    }
    fill_defaults(&import.options);
    import.files_left = import.options.max_files;
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

/* SPDX-License-Identifier: Apache-2.0 */
/* Tries one act, or the layers, each in a separate process, in a temporary folder (doctor.h). */
#define _GNU_SOURCE /* syscall */
#include "bake/sandbox/doctor.h"

#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#define EXIT_NO_CAGE 9 /* exit code of the process that tries an act */

static const char *const folders[] = {"scene", "work", "other"};
static const char *const files[] = {"scene/scene.ply", "work/mine.umb", "other/tokens",
                                    "other/jobs.db", "other/tile.umbt"};
#define COUNT(array) (sizeof(array) / sizeof((array)[0]))

/* The path of a name below the folder; an absolute name stays as it is. */
static void path_of(const struct umbb_ground *ground, const char *name, char path[UMBB_GROUND_PATH])
{
    const int is_below = name[0] != '/';
    (void)snprintf(path, UMBB_GROUND_PATH, "%s%s%s", is_below ? ground->folder : "",
                   is_below ? "/" : "", name);
}

static int make_file(const char *path)
{
    const int fd = open(path, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
    return fd >= 0 && write(fd, "secret\n", 7) == 7 && close(fd) == 0;
}

/* Fills the folder. Returns 0, and errno, if a part cannot be made. */
static int fill_ground(struct umbb_ground *ground)
{
    char path[UMBB_GROUND_PATH], tokens[UMBB_GROUND_PATH];
    int good = 1;
    path_of(ground, "scene", ground->scene);
    path_of(ground, "work", ground->work);
    for (size_t i = 0; good && i < COUNT(folders); i++) {
        path_of(ground, folders[i], path);
        good = mkdir(path, 0700) == 0;
    }
    for (size_t i = 0; good && i < COUNT(files); i++) {
        path_of(ground, files[i], path);
        good = make_file(path);
    }
    path_of(ground, "other/tokens", tokens);
    path_of(ground, "work/link", path);
    return good && symlink(tokens, path) == 0;
}

static int make_folder_in(struct umbb_ground *ground, const char *parent)
{
    if (parent == NULL ||
        strlen(parent) + sizeof "/umbrage-doctor-XXXXXX" > sizeof ground->folder) {
        return -1;
    }
    (void)snprintf(ground->folder, sizeof ground->folder, "%s/umbrage-doctor-XXXXXX", parent);
    return mkdtemp(ground->folder) != NULL ? 0 : -1;
}

enum umb_status umbb_ground_make(struct umbb_ground *ground, struct umb_error *error)
{
    memset(ground, 0, sizeof *ground);
    if (make_folder_in(ground, getenv("TMPDIR")) != 0 && make_folder_in(ground, "/tmp") != 0 &&
        make_folder_in(ground, "/var/tmp") != 0) {
        ground->folder[0] = '\0';
        return umb_fail_errno(error, UMB_E_CANNOT_CREATE, errno,
                              "no folder for the tries (TMPDIR, /tmp, /var/tmp)");
    }
    if (!fill_ground(ground)) {
        const enum umb_status status = umb_fail_errno(error, UMB_E_CANNOT_CREATE, errno,
                                                      "cannot fill '%.60s'", ground->folder);
        umbb_ground_remove(ground);
        return status;
    }
    return UMB_OK;
}

/* Removes the folder and what allowed actions left in it: known names only, contents first. */
void umbb_ground_remove(struct umbb_ground *ground)
{
    static const char *const all[] = {
        "work/new",  "work/stolen", "work/link",       "work/mine.umb", "work",
        "other/new", "other/mine",  "other/tokens",    "other/jobs.db", "other/tile.umbt",
        "other",     "scene/new",   "scene/scene.ply", "scene",         "",
    };
    char path[UMBB_GROUND_PATH];
    for (size_t i = 0; ground->folder[0] != '\0' && i < COUNT(all); i++) {
        path_of(ground, all[i], path);
        (void)remove(path);
    }
    ground->folder[0] = '\0';
}

/* Returns 1 for errors that mean a missing right, not a wrong call. Landlock answers a rename or
 * link between folders of different rights with EXDEV. */
static int is_refusal(int code)
{
    return code == EACCES || code == EPERM || code == ENOSYS || code == EXDEV;
}

/* Enters the sandbox that a bake of the scene in the temporary folder would have: restricts paths
 * and, if `whole` is 1, system calls. */
static int enter_bake(const struct umbb_ground *ground, int whole, struct umbb_bake_sandbox *out)
{
    const struct umbb_path_rule rules[] = {{ground->scene, UMBB_PATH_READ},
                                           {ground->work, UMBB_PATH_WRITE}};
    struct umb_error error;
    *out = (struct umbb_bake_sandbox){.mode = UMBB_SANDBOX_REQUIRED};
    return umbb_bake_sandbox_paths(out, rules, COUNT(rules), &error) == UMB_OK &&
           (!whole || umbb_bake_sandbox_calls(out, 0, -1, &error) == UMB_OK);
}

static int enter(enum umbb_cage cage, const struct umbb_ground *ground)
{
    struct umbb_sandbox importer;
    struct umbb_bake_sandbox bake;
    switch (cage) {
    case UMBB_CAGE_NONE:
        return 1;
    case UMBB_CAGE_IMPORTER:
        return umbb_sandbox_enter(&importer, NULL) == UMB_OK;
    case UMBB_CAGE_LANDLOCK:
        return prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0 && umbb_landlock_enter(NULL, 0) > 0;
    case UMBB_CAGE_BAKE:
        return enter_bake(ground, 1, &bake);
    default:
        return enter_bake(ground, 0, &bake);
    }
}

/* Tries the act in this process. Relative paths of the act are below the temporary folder,
 * ground->folder. Returns the act's own result. */
static long perform(const struct umbb_act *act, const struct umbb_ground *ground)
{
    char path[UMBB_GROUND_PATH], target[UMBB_GROUND_PATH];
    const long *call = act->call;
    if (call[0] != 0) {
        return syscall(call[0], call[1], call[2], call[3], call[4], call[5], call[6]);
    }
    if (act->attempt != NULL) {
        return act->attempt();
    }
    path_of(ground, act->path, path);
    if (act->on_one != NULL) {
        return act->on_one(path);
    }
    if (act->on_two != NULL) {
        path_of(ground, act->target, target);
        return act->on_two(path, target);
    }
    return act->on_mode != NULL ? act->on_mode(path, act->flags)
                                : open(path, (int)act->flags, 0600);
}

/* In the child: never returns. */
static void attempt(const struct umbb_act *act, enum umbb_cage cage,
                    const struct umbb_ground *ground)
{
    const struct rlimit none = {0, 0};
    (void)setrlimit(RLIMIT_CORE, &none);
    if (!enter(cage, ground)) {
        _exit(EXIT_NO_CAGE);
    }
    errno = 0;
    const long result = perform(act, ground);
    _exit(result >= 0 ? UMBB_ACT_ALLOWED : is_refusal(errno) ? UMBB_ACT_REFUSED : UMBB_ACT_FAILED);
}

int umbb_doctor_try(const struct umbb_act *act, enum umbb_cage cage,
                    const struct umbb_ground *ground)
{
    int status;
    pid_t ended, child = fork();
    if (child == 0) {
        attempt(act, cage, ground);
    }
    if (child < 0) {
        return -1;
    }
    do {
        ended = waitpid(child, &status, 0);
    } while (ended < 0 && errno == EINTR);
    if (ended == child && WIFSIGNALED(status) && WTERMSIG(status) == SIGSYS) {
        return UMBB_ACT_KILLED;
    }
    if (ended == child && WIFEXITED(status) && WEXITSTATUS(status) <= UMBB_ACT_FAILED) {
        return WEXITSTATUS(status);
    }
    return -1;
}

/* Runs `fill` in a child process and reads the bytes that `fill` makes. They come through
 * descriptor 2, the only one that the importer's filter allows writing to. */
static int ask_child(void (*fill)(void *bytes, const void *with), const void *with, void *bytes,
                     size_t count)
{
    int ends[2];
    memset(bytes, 0, count);
    if (pipe(ends) != 0) {
        return -1;
    }
    const pid_t child = fork();
    if (child == 0) {
        if (dup2(ends[1], STDERR_FILENO) < 0) {
            _exit(1);
        }
        fill(bytes, with);
        _exit(write(STDERR_FILENO, bytes, count) != (ssize_t)count);
    }
    (void)close(ends[1]);
    const ssize_t got = child > 0 ? read(ends[0], bytes, count) : -1;
    (void)close(ends[0]);
    while (child > 0 && waitpid(child, NULL, 0) < 0 && errno == EINTR) {
    }
    return got == (ssize_t)count ? 0 : -1;
}

static void fill_importer(void *bytes, const void *with)
{
    struct umbb_sandbox *out = bytes;
    struct umb_error error;
    (void)with;
    if (umbb_sandbox_enter(out, &error) != UMB_OK) {
        out->seccomp = 0;
    }
}

static void fill_bake(void *bytes, const void *with)
{
    struct umbb_bake_sandbox *out = bytes;
    (void)!enter_bake(with, 1, out);
}

int umbb_doctor_probe(struct umbb_sandbox *importer)
{
    return ask_child(fill_importer, NULL, importer, sizeof *importer);
}

int umbb_doctor_probe_bake(const struct umbb_ground *ground, struct umbb_bake_sandbox *bake)
{
    return ask_child(fill_bake, ground, bake, sizeof *bake);
}

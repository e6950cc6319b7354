/* SPDX-License-Identifier: Apache-2.0 */
/* Tries one act, or the layers, each in a separate process (doctor.h). */
#include <errno.h>
#include <signal.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include "bake/sandbox/doctor.h"

#define EXIT_NO_CAGE 9 /* exit code of the process that tries an act */

/* Returns 1 for errors that mean a missing right, not a wrong call. Landlock answers a rename or
 * link between folders of different rights with EXDEV. */
static int is_refusal(int code)
{
    return code == EACCES || code == EPERM || code == ENOSYS || code == EXDEV;
}

/* Enters the sandbox of a bake of the ground's scene: paths and, if `whole`, the calls. */
static int enter_bake(const struct umbb_ground *ground, int whole, struct umbb_bake_sandbox *out)
{
    struct umbb_path_rule rules[UMBB_GROUND_RULES];
    struct umb_error error;
    umbb_ground_rules(ground, rules);
    *out = (struct umbb_bake_sandbox){.mode = UMBB_SANDBOX_REQUIRED};
    return umbb_bake_sandbox_paths(out, rules, UMBB_GROUND_RULES, &error) == UMB_OK &&
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
    const long result = umbb_act_attempt(act, ground);
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

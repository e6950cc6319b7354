/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The check of a scene against an asset, by umbrage-bake: the client's programs read no scenes.
 */
#define _GNU_SOURCE /* pipe2 */
#include "cli_view_site.h"

#include <errno.h>
#include <fcntl.h>
#include <spawn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "cli/shared/cli_common.h"
#include "tool/bake_settings.h"
#include "tool/tool_try.h"

#define PATH_SIZE  4096
#define TOLD_BYTES 4096 /* Most bytes of the program's lines that are kept */

extern char **environ;

/* Starts a program with both outputs in a pipe. Returns false if it fails. */
static bool start(const char *program, const char *scene, pid_t *child, int *out)
{
    const char *words[] = {program, "import", "--plan", "--quiet", "--", scene, NULL};
    posix_spawn_file_actions_t actions;
    int ends[2];
    if (pipe2(ends, O_CLOEXEC) != 0) {
        return false;
    }
    bool ok = posix_spawn_file_actions_init(&actions) == 0;
    if (ok) {
        ok = posix_spawn_file_actions_adddup2(&actions, ends[1], STDOUT_FILENO) == 0 &&
             posix_spawn_file_actions_adddup2(&actions, ends[1], STDERR_FILENO) == 0 &&
             posix_spawn(child, program, &actions, NULL, (char *const *)(uintptr_t)words,
                         environ) == 0;
        (void)posix_spawn_file_actions_destroy(&actions);
    }
    (void)close(ends[1]);
    *out = ends[0];
    if (!ok) {
        (void)close(ends[0]);
    }
    return ok;
}

/* Reads what a program prints, and waits for its end. Out: told: the first line. Returns the exit
 * code; -1: ended by a signal. */
static int finish(pid_t child, int out, char told[TOLD_BYTES])
{
    char rest[TOLD_BYTES];
    size_t size = 0;
    for (;;) {
        const bool has_room = size + 1 < TOLD_BYTES;
        const ssize_t got = read(out, has_room ? told + size : rest,
                                 has_room ? TOLD_BYTES - 1 - size : sizeof rest);
        if (got == 0 || (got < 0 && errno != EINTR)) {
            break;
        }
        size += has_room && got > 0 ? (size_t)got : 0;
    }
    (void)close(out);
    told[size] = '\0';
    told[strcspn(told, "\n")] = '\0';
    int status = -1;
    while (waitpid(child, &status, 0) < 0 && errno == EINTR) {
    }
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

enum umb_status umbc_view_scene_match(const struct umbc_view_site *site, const char *asset,
                                      const char *scene, bool quiet, struct umb_error *error)
{
    static const char program_name[] = "umbrage-bake", key[] = "scene=";
    char folder[PATH_SIZE], program[PATH_SIZE + sizeof program_name + 1];
    char told[TOLD_BYTES] = "umbrage-bake is not beside this program";
    uint8_t hash[UMB_ID_BYTES];
    pid_t child;
    int out, code = -1;
    if (!umbc_own_folder(folder, sizeof folder)) {
        return umb_fail(error, UMB_E_INTERNAL, "view: cannot find the folder of this program");
    }
    (void)snprintf(program, sizeof program, "%s/%s", folder, program_name);
    if (access(program, X_OK) == 0 && start(program, scene, &child, &out)) {
        code = finish(child, out, told);
    }
    told[strncmp(told, key, sizeof key - 1) == 0 ? strcspn(told, " ") : strlen(told)] = '\0';
    if (code == 0 && strlen(told) > sizeof key &&
        umb_id_from_text(told + sizeof key - 1, hash) == UMB_OK) {
        return umbu_scene_match(asset, site->scene_hash, scene, hash, error);
    }
    const bool named = strncmp(told, program_name, sizeof program_name - 1) == 0 &&
                       told[sizeof program_name - 1] == ':';
    const char *why = named ? told + sizeof program_name + 1 : told;
    if (code == UMBC_EXIT_DATA) { /* No bake read this scene */
        return umb_fail(error, UMB_E_BAD_SCENE, "%.400s (--force goes on)", why);
    }
    if (!quiet) {
        (void)fprintf(stderr, "umbrage: notice: the scene was not compared with the asset: %s\n",
                      why);
    }
    return UMB_OK;
}

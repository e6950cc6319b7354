/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Replaces this program by a program of the server side. Only the running program's own folder is
 * searched, so that a file of the same name in PATH is never run.
 */
#include "cli/shared/cli_common.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <stdio.h>
#include <unistd.h>

#define PATH_SIZE 4096

bool umbc_own_folder(char *folder, size_t size)
{
    ssize_t length = readlink("/proc/self/exe", folder, size - 1);
    if (length <= 0 || (size_t)length >= size - 1) {
        return false;
    }
    folder[length] = '\0';
    char *slash = strrchr(folder, '/');
    if (slash == NULL) {
        return false;
    }
    *slash = '\0';
    return true;
}

/* Makes the argument list: program, word (if not NULL), arguments, NULL. Strings are borrowed. */
static char **make_arguments(const char *program, const char *word, char **arguments)
{
    size_t count = 0, at = 0;
    while (arguments[count] != NULL) {
        count++;
    }
    const char **all = calloc(count + 3, sizeof *all);
    if (all == NULL) {
        return NULL;
    }
    all[at++] = program;
    if (word != NULL) {
        all[at++] = word;
    }
    memcpy(all + at, arguments, count * sizeof *all);
    return (char **)all;
}

int umbc_start_program(const char *command, const char *program, const char *word, char **arguments)
{
    char folder[PATH_SIZE];
    char path[PATH_SIZE + 64];
    if (!umbc_own_folder(folder, sizeof folder)) {
        return umbc_complain_as(UMB_E_INTERNAL, "%s: cannot find the folder of this program",
                                command);
    }
    (void)snprintf(path, sizeof path, "%s/%s", folder, program);
    if (access(path, X_OK) != 0) {
        (void)umbc_complain_as(
            UMB_E_UNSUPPORTED,
            "%s: needs the program %s beside this one in %s; this is a client-only install",
            command, program, folder);
        return UMBC_EXIT_MISSING;
    }
    char **all = make_arguments(path, word, arguments);
    if (all == NULL) {
        return umbc_complain_as(UMB_E_NO_MEMORY, "%s: out of memory", command);
    }
    (void)execv(path, all);
    int code = errno;
    free(all);
    return umbc_complain_as(UMB_E_UNSUPPORTED, "%s: cannot start %s: %s", command, path,
                            strerror(code));
}

/* SPDX-License-Identifier: Apache-2.0 */
/* Atomic output files of the command line, see cli_output.h. */
#include "cli_output.h"

#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

/* The temporary that a signal takes with it; NULL if there is none. A command has one output. */
static char *volatile temporary_name;

/* Removes the temporary, then lets the signal do what it always does. */
static void on_signal(int number)
{
    char *path = temporary_name;
    if (path != NULL) {
        (void)unlink(path);
    }
    (void)raise(number); /* blocked until this returns, and the handler is reset */
}

/* Signals that end a program. One that was ignored at the start (nohup) stays so. */
static const int ending[] = {SIGINT, SIGTERM, SIGHUP};
#define ENDING_COUNT (sizeof ending / sizeof ending[0])

static void catch_signals(sigset_t *set)
{
    struct sigaction action, before;
    memset(&action, 0, sizeof action);
    action.sa_handler = on_signal;
    action.sa_flags = (int)SA_RESETHAND;
    sigemptyset(&action.sa_mask);
    sigemptyset(set);
    for (size_t i = 0; i < ENDING_COUNT; i++) {
        (void)sigaddset(set, ending[i]);
        if (sigaction(ending[i], NULL, &before) == 0 && before.sa_handler == SIG_DFL) {
            (void)sigaction(ending[i], &action, NULL);
        }
    }
}

/* mkstemp, after which no signal leaves the file behind. */
static int make_temporary(char *name)
{
    sigset_t set, before;
    catch_signals(&set);
    (void)pthread_sigmask(SIG_BLOCK, &set, &before);
    int file = mkstemp(name);
    int code = errno;
    temporary_name = file >= 0 ? name : NULL;
    (void)pthread_sigmask(SIG_SETMASK, &before, NULL);
    errno = code;
    return file;
}

static void forget_temporary(struct umbc_output *output)
{
    temporary_name = NULL;
    free(output->temporary);
    output->temporary = NULL;
}

/* Length of the folder part of a path with its slash, 0 if there is none. */
static size_t folder_length(const char *path)
{
    const char *slash = strrchr(path, '/');
    return slash == NULL ? 0 : (size_t)(slash - path) + 1;
}

static enum umb_status begin_special(const char *path, struct umbc_output *output,
                                     struct umb_error *error)
{
    output->file = fopen(path, "wb");
    return output->file != NULL
               ? UMB_OK
               : umb_fail_errno(error, UMB_E_CANNOT_CREATE, errno, "cannot write '%.200s'", path);
}

static enum umb_status begin_temporary(const char *path, struct umbc_output *output,
                                       struct umb_error *error)
{
    size_t folder = folder_length(path);
    size_t capacity = folder + sizeof ".tmp.umbrage.XXXXXX";
    output->temporary = malloc(capacity);
    if (output->temporary == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for the name '%.200s'", path);
    }
    (void)snprintf(output->temporary, capacity, "%.*s.tmp.umbrage.XXXXXX", (int)folder, path);
    int file = make_temporary(output->temporary);
    if (file < 0) {
        int code = errno;
        free(output->temporary);
        output->temporary = NULL;
        return umb_fail_errno(error, UMB_E_CANNOT_CREATE, code, "cannot create '%.200s'", path);
    }
    output->file = fdopen(file, "wb");
    if (output->file == NULL) {
        int code = errno;
        (void)close(file);
        umbc_output_abandon(output);
        return umb_fail_errno(error, code == ENOMEM ? UMB_E_NO_MEMORY : UMB_E_CANNOT_CREATE, code,
                              "cannot create '%.200s'", path);
    }
    return UMB_OK;
}

enum umb_status umbc_output_begin(const char *path, struct umbc_output *output,
                                  struct umb_error *error)
{
    struct stat info;
    memset(output, 0, sizeof *output);
    output->path = path;
    if (strcmp(path, "-") == 0) {
        output->path = "stdout"; /* for messages; it is never opened by name */
        output->file = stdout;
        return UMB_OK;
    }
    if (stat(path, &info) == 0 && S_ISDIR(info.st_mode)) {
        return umb_fail(error, UMB_E_CANNOT_CREATE, "cannot create '%.200s': it is a folder", path);
    }
    if (path[folder_length(path)] == '\0') {
        return umb_fail(error, UMB_E_CANNOT_CREATE, "cannot create '%.200s': no file name", path);
    }
    if (stat(path, &info) == 0 && !S_ISREG(info.st_mode)) {
        return begin_special(path, output, error);
    }
    return begin_temporary(path, output, error);
}

/* Opens the folder of a path. Before the rename: what can fail is done while nothing is visible. */
static enum umb_status open_folder(const char *path, int *fd, struct umb_error *error)
{
    size_t folder = folder_length(path);
    char *name = folder == 0 ? strdup(".") : strndup(path, folder);
    if (name == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for the name '%.200s'", path);
    }
    *fd = open(name, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    int code = errno;
    free(name);
    return *fd >= 0
               ? UMB_OK
               : umb_fail_errno(error, UMB_E_IO, code, "cannot sync the folder of '%.180s'", path);
}

/* Renames a file in its folder. Out: folder: open, to be synced. */
static enum umb_status rename_file(const char *from, const char *to, int *folder,
                                   struct umb_error *error)
{
    enum umb_status status = open_folder(to, folder, error);
    if (status == UMB_OK && rename(from, to) != 0) {
        const int code = errno;
        (void)close(*folder);
        status = umb_fail_errno(error, UMB_E_CANNOT_CREATE, code, "cannot create '%.200s'", to);
    }
    return status;
}

/* The rename itself is durable only once the folder is. */
static enum umb_status sync_folder(const char *path, int fd, struct umb_error *error)
{
    int code = fsync(fd) != 0 ? errno : 0;
    (void)close(fd);
    /* Some file systems cannot sync folders; they say EINVAL. */
    return code == 0 || code == EINVAL
               ? UMB_OK
               : umb_fail_errno(error, UMB_E_IO, code, "cannot sync the folder of '%.180s'", path);
}

/* Permissions of an ordinary new file; mkstemp's are for its owner alone. */
static mode_t file_mode(const char *path)
{
    struct stat info;
    if (stat(path, &info) == 0) {
        return info.st_mode & 0777;
    }
    mode_t mask = umask(0);
    (void)umask(mask);
    return 0666 & ~mask;
}

enum umb_status umbc_output_commit(struct umbc_output *output, struct umb_error *error)
{
    bool temporary = output->temporary != NULL;
    /* The errno of an earlier write is the sink's, or lost. */
    bool bad = ferror(output->file) != 0;
    int code = !bad ? 0 : output->system_error != 0 ? output->system_error : EIO;
    if (!bad && (fflush(output->file) != 0 ||
                 (temporary && (fchmod(fileno(output->file), file_mode(output->path)) != 0 ||
                                fsync(fileno(output->file)) != 0)))) {
        bad = true;
        code = errno;
    }
    if (output->file != stdout) {
        if (fclose(output->file) != 0 && !bad) {
            code = errno;
            bad = true;
        }
    }
    output->file = NULL;
    if (bad) {
        umbc_output_abandon(output);
        return umb_fail_errno(error, UMB_E_IO, code, "cannot write '%.200s'", output->path);
    }
    if (!temporary) {
        return UMB_OK;
    }
    int folder = -1;
    enum umb_status status = rename_file(output->temporary, output->path, &folder, error);
    if (status != UMB_OK) {
        umbc_output_abandon(output);
        return status;
    }
    forget_temporary(output);
    return sync_folder(output->path, folder, error);
}

enum umb_status umbc_output_rename(const char *from, const char *to, struct umb_error *error)
{
    int folder = -1;
    enum umb_status status = rename_file(from, to, &folder, error);
    return status == UMB_OK ? sync_folder(to, folder, error) : status;
}

void umbc_output_abandon(struct umbc_output *output)
{
    if (output->file != NULL && output->file != stdout) {
        (void)fclose(output->file);
    }
    output->file = NULL;
    if (output->temporary != NULL) {
        (void)unlink(output->temporary);
        forget_temporary(output);
    }
}

static enum umb_status write_bytes(void *user, const void *bytes, size_t count)
{
    struct umbc_output *output = user;
    if (count == 0 || fwrite(bytes, 1, count, output->file) == count) {
        return UMB_OK;
    }
    if (output->system_error == 0) {
        output->system_error = errno;
    }
    return UMB_E_IO;
}

struct umb_sink umbc_output_sink(struct umbc_output *output)
{
    struct umb_sink sink = {.write = write_bytes, .user = output};
    return sink;
}

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Replaces a file atomically: writes a temporary beside it, syncs the temporary, renames it, and
 * syncs the folder.
 *
 * Invariants: the target is never opened for writing, unless it is a device or pipe. A temporary is
 * made with O_EXCL, so two writers never share one. After a failed write or fsync nothing is
 * renamed: the kernel may have dropped the dirty pages, and a second fsync would report success
 * (Rebello et al., "Can Applications Recover from fsync Failures?", ATC 2020).
 */
#include "tool/output.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include "tool/clock.h"
#include "tool/tool_try.h"

#define NAME_KEPT 180 /* bytes of the target's name in the temporary's; NAME_MAX is 255 */
#define TRIES     64  /* names tried before begin fails */

/*
 * The signal handler may run on any thread while the owner's thread goes on, so the handler reads a
 * copy of the name that is never freed. The owner's thread holds the signals back while name and
 * file change together. Another thread that takes a signal in that moment sees the old state; at
 * worst a temporary made an instant ago stays.
 */
static const int ending_signals[] = {SIGINT, SIGTERM, SIGHUP, SIGXCPU};
#define SIGNAL_COUNT (sizeof ending_signals / sizeof ending_signals[0])
static char doomed[PATH_MAX]; /* Name of the temporary, valid while `armed` */
static atomic_int armed;      /* lock-free: allowed in a handler */

static void on_signal(int number)
{
    if (atomic_load(&armed)) {
        (void)unlink(doomed);
    }
    (void)signal(number, SIG_DFL);
    (void)raise(number); /* arrives when the handler returns */
}

/* Blocks the signals that end a command. Out: before: the old mask, to be restored. */
static void hold_signals(sigset_t *before)
{
    sigset_t set;
    sigemptyset(&set);
    for (size_t i = 0; i < SIGNAL_COUNT; i++) {
        sigaddset(&set, ending_signals[i]);
    }
    (void)pthread_sigmask(SIG_BLOCK, &set, before);
}

static void catch_signals(void)
{
    struct sigaction action, before;
    memset(&action, 0, sizeof action);
    sigemptyset(&action.sa_mask);
    action.sa_handler = on_signal;
    for (size_t i = 0; i < SIGNAL_COUNT; i++) {
        if (sigaction(ending_signals[i], NULL, &before) == 0 && before.sa_handler == SIG_DFL) {
            (void)sigaction(ending_signals[i], &action, NULL);
        }
    }
}

/* Forgets the temporary after it was renamed or removed. */
static void forget_temporary(struct umbu_output *output)
{
    if (output->guarded) {
        atomic_store(&armed, 0);
    }
    free(output->temporary);
    output->temporary = NULL;
}

static enum umb_status no_memory(const char *path, struct umb_error *error)
{
    return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for the name '%.200s'", path);
}

/* Returns the length of the folder part of path, with the slash; 0 if there is none. */
static size_t folder_length(const char *path)
{
    const char *slash = strrchr(path, '/');
    return slash == NULL ? 0 : (size_t)(slash - path) + 1;
}

static char *folder_of(const char *path)
{
    const size_t length = folder_length(path);
    return length == 0 ? strdup(".") : strndup(path, length);
}

/* Refuses a target that a rename must not replace. Out: info: data of the target; st_mode is 0 if
 * there is no target yet. */
static enum umb_status check_target(const char *path, unsigned flags, struct stat *info,
                                    struct umb_error *error)
{
    const size_t length = strlen(path + folder_length(path));
    const bool exists = stat(path, info) == 0;
    if (!exists) {
        info->st_mode = 0;
    }
    if (exists && S_ISDIR(info->st_mode)) {
        return umb_fail(error, UMB_E_CANNOT_CREATE, "cannot create '%.200s': it is a folder", path);
    }
    if (length == 0 || length > NAME_MAX) {
        return umb_fail(error, UMB_E_CANNOT_CREATE,
                        "cannot create '%.200s': the file name must have 1 to 255 bytes", path);
    }
    if (exists && !S_ISREG(info->st_mode) && (flags & UMBU_OUTPUT_COMMAND) == 0) {
        return umb_fail(error, UMB_E_CANNOT_CREATE,
                        "cannot create '%.200s': it exists and is not a regular file", path);
    }
    return UMB_OK;
}

enum umb_status umbu_output_check(const char *path, unsigned flags, struct umb_error *error)
{
    struct stat info;
    if ((flags & UMBU_OUTPUT_COMMAND) != 0 && umbu_output_is_stdout(path)) {
        return UMB_OK;
    }
    const enum umb_status status = check_target(path, flags, &info, error);
    if (status != UMB_OK || (info.st_mode != 0 && !S_ISREG(info.st_mode))) {
        return status;
    }
    char *folder = folder_of(path);
    if (folder == NULL) {
        return no_memory(path, error);
    }
    const int cause = access(folder, W_OK | X_OK) == 0 ? 0 : errno;
    free(folder);
    return cause == 0
               ? UMB_OK
               : umb_fail_errno(error, UMB_E_CANNOT_CREATE, cause, "cannot create '%.200s'", path);
}

static char *temporary_name(const char *path)
{
    static atomic_uint next_number;
    const size_t folder = folder_length(path);
    const char *name = path + folder;
    size_t kept = strlen(name);
    kept = kept > NAME_KEPT ? NAME_KEPT : kept;
    const size_t capacity = folder + kept + 80;
    char *text = malloc(capacity);
    if (text != NULL) {
        snprintf(text, capacity, "%.*s.tmp.%.*s.%ld.%u.%lx", (int)folder, path, (int)kept, name,
                 (long)getpid(), atomic_fetch_add(&next_number, 1U),
                 (unsigned long)umbu_clock_ns());
    }
    return text;
}

static enum umb_status make_temporary(struct umbu_output *output, mode_t mode,
                                      struct umb_error *error)
{
    int cause = EEXIST;
    for (int i = 0; i < TRIES && (cause == EEXIST || cause == EINTR); i++) {
        output->temporary = temporary_name(output->path);
        if (output->temporary == NULL) {
            return no_memory(output->path, error);
        }
        output->fd =
            open(output->temporary, O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, mode);
        if (output->fd >= 0) {
            return UMB_OK;
        }
        cause = errno;
        free(output->temporary);
        output->temporary = NULL;
    }
    return umb_fail_errno(error, UMB_E_CANNOT_CREATE, cause, "cannot create '%.200s'",
                          output->path);
}

/* Makes a command's temporary, guarded against signals, with the old file's permissions. */
static enum umb_status begin_command(struct umbu_output *output, const struct stat *old,
                                     struct umb_error *error)
{
    sigset_t before;
    hold_signals(&before);
    catch_signals();
    enum umb_status status = make_temporary(output, 0666, error);
    if (status == UMB_OK && strlen(output->temporary) < sizeof doomed) {
        memcpy(doomed, output->temporary, strlen(output->temporary) + 1);
        output->guarded = true;
        atomic_store(&armed, 1);
    }
    (void)pthread_sigmask(SIG_SETMASK, &before, NULL);
    if (status == UMB_OK && old->st_mode != 0 && fchmod(output->fd, old->st_mode & 0777) != 0) {
        status = umb_fail_errno(error, UMB_E_CANNOT_CREATE, errno, "cannot create '%.200s'",
                                output->path);
    }
    return status;
}

static enum umb_status open_stream(struct umbu_output *output, struct umb_error *error)
{
    output->file = fdopen(output->fd, "wb");
    if (output->file != NULL) {
        return UMB_OK;
    }
    const int cause = errno;
    return umb_fail_errno(error, cause == ENOMEM ? UMB_E_NO_MEMORY : UMB_E_CANNOT_CREATE, cause,
                          "cannot create '%.200s'", output->path);
}

enum umb_status umbu_output_begin(const char *path, unsigned flags, struct umbu_output *output,
                                  struct umb_error *error)
{
    const bool command = (flags & UMBU_OUTPUT_COMMAND) != 0;
    const bool to_stdout = command && umbu_output_is_stdout(path);
    struct stat old = {0};
    *output = (struct umbu_output){.fd = -1};
    enum umb_status status = UMB_OK;
    UMB__TRY(to_stdout ? UMB_OK : check_target(path, flags, &old, error));
    output->path = strdup(to_stdout ? "stdout" : path); /* for messages; never opened by name */
    if (output->path == NULL) {
        return no_memory(path, error);
    }
    if (to_stdout) {
        output->fd = STDOUT_FILENO;
        output->file = stdout;
        return UMB_OK;
    }
    if (!command) {
        status = make_temporary(output, (flags & UMBU_OUTPUT_PRIVATE) != 0 ? 0600 : 0666, error);
    } else if (old.st_mode == 0 || S_ISREG(old.st_mode)) {
        status = begin_command(output, &old, error);
    } else {
        output->fd = open(path, O_WRONLY | O_CLOEXEC | O_NOCTTY);
        status = output->fd >= 0 ? UMB_OK
                                 : umb_fail_errno(error, UMB_E_CANNOT_CREATE, errno,
                                                  "cannot write '%.200s'", path);
    }
    if (status == UMB_OK && command) {
        status = open_stream(output, error);
    }
    if (status != UMB_OK) {
        umbu_output_abandon(output);
    }
    return status;
}

int umbu_write_all(int fd, const char *from, size_t count)
{
    while (count > 0) {
        const size_t part = count < ((size_t)1 << 30) ? count : (size_t)1 << 30;
        const ssize_t written = write(fd, from, part);
        if (written < 0 && errno == EINTR) {
            continue;
        }
        if (written <= 0) {
            return written < 0 ? errno : EIO;
        }
        from += written;
        count -= (size_t)written;
    }
    return 0;
}

static enum umb_status fail_write(const struct umbu_output *output, struct umb_error *error)
{
    return umb_fail_errno(error, UMB_E_IO, output->system_error, "cannot write '%.200s'",
                          output->path != NULL ? output->path : "");
}

enum umb_status umbu_output_write(struct umbu_output *output, const void *bytes, size_t count,
                                  struct umb_error *error)
{
    if (output->system_error == 0 && output->file == NULL) {
        output->system_error = umbu_write_all(output->fd, bytes, count);
    } else if (output->system_error == 0 && count > 0 &&
               fwrite(bytes, 1, count, output->file) != count) {
        output->system_error = errno != 0 ? errno : EIO;
    }
    return output->system_error == 0 ? UMB_OK : fail_write(output, error);
}

enum umb_status umbu_output_explain(const struct umbu_output *output, enum umb_status status,
                                    struct umb_error *error)
{
    if (output->system_error != 0) {
        return fail_write(output, error);
    }
    return error != NULL && error->message[0] != '\0'
               ? status
               : umb_fail(error, status, "cannot write '%.200s': %s", output->path,
                          umb_status_text(status));
}

static enum umb_status write_bytes(void *user, const void *bytes, size_t count)
{
    return umbu_output_write(user, bytes, count, NULL);
}

struct umb_sink umbu_output_sink(struct umbu_output *output)
{
    return (struct umb_sink){.write = write_bytes, .user = output};
}

int umbu_folder_sync(int folder)
{
    return fsync(folder) == 0 || errno == EINVAL || errno == ENOTSUP ? 0 : -1;
}

int umbu_folder_sync_at(int parent, const char *name)
{
    const int folder = openat(parent, name, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    const int result = folder >= 0 ? umbu_folder_sync(folder) : -1;
    const int cause = errno;
    if (folder >= 0) {
        (void)close(folder);
    }
    errno = cause;
    return result;
}

static enum umb_status fail_folder(const char *path, int cause, struct umb_error *error)
{
    return umb_fail_errno(error, UMB_E_IO, cause, "cannot sync the folder of '%.200s'", path);
}

/* Renames a file. The folder is opened first, so that everything that can fail is done before the
 * file becomes visible. Out: renamed: also set if the sync of the folder fails afterwards. */
static enum umb_status give_name(const char *from, const char *to, bool unsynced, bool *renamed,
                                 struct umb_error *error)
{
    char *name = folder_of(to);
    if (name == NULL) {
        return no_memory(to, error);
    }
    const int folder = open(name, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    const int cause = errno;
    free(name);
    if (folder < 0) {
        return fail_folder(to, cause, error);
    }
    enum umb_status status = UMB_OK;
    *renamed = rename(from, to) == 0;
    if (!*renamed) {
        status = umb_fail_errno(error, UMB_E_CANNOT_CREATE, errno, "cannot replace '%.200s'", to);
    } else if (!unsynced && umbu_folder_sync(folder) != 0) {
        status = fail_folder(to, errno, error);
    }
    (void)close(folder);
    return status;
}

enum umb_status umbu_output_rename(const char *from, const char *to, struct umb_error *error)
{
    bool renamed;
    return give_name(from, to, false, &renamed, error);
}

/* Closes what is open; stdout stays. Returns 0 or an errno. */
static int close_output(struct umbu_output *output)
{
    int failed = 0;
    if (output->file != NULL && output->file != stdout) {
        failed = fclose(output->file);
    } else if (output->file == NULL && output->fd >= 0) {
        failed = close(output->fd);
    }
    output->file = NULL;
    output->fd = -1;
    return failed != 0 ? errno : 0;
}

/* Flushes the bytes to the disk or to stdout. */
static enum umb_status flush(struct umbu_output *output, struct umb_error *error)
{
    if (output->system_error == 0 && output->file != NULL) {
        if (ferror(output->file)) { /* A fprintf failed, and its errno is no longer known */
            output->system_error = EIO;
        } else if (fflush(output->file) != 0) {
            output->system_error = errno;
        }
    }
    if (output->system_error != 0) {
        return fail_write(output, error);
    }
    if (output->temporary != NULL && !output->unsynced && fsync(output->fd) != 0) {
        return umb_fail_errno(error, UMB_E_IO, errno, "cannot sync '%.200s'", output->path);
    }
    return UMB_OK;
}

enum umb_status umbu_output_commit(struct umbu_output *output, struct umb_error *error)
{
    bool renamed = false;
    if (output->path == NULL) {
        return umb_fail(error, UMB_E_STATE, "no file is being replaced");
    }
    enum umb_status status = flush(output, error);
    const int cause = close_output(output);
    if (status == UMB_OK && cause != 0) {
        status = umb_fail_errno(error, UMB_E_IO, cause, "cannot close '%.200s'", output->path);
    }
    if (status == UMB_OK && output->temporary != NULL) {
        status = give_name(output->temporary, output->path, output->unsynced, &renamed, error);
    }
    if (renamed) {
        forget_temporary(output);
    }
    umbu_output_abandon(output);
    return status;
}

void umbu_output_abandon(struct umbu_output *output)
{
    if (output->path == NULL) {
        return;
    }
    (void)close_output(output);
    if (output->temporary != NULL) {
        (void)unlink(output->temporary);
        forget_temporary(output);
    }
    free(output->path);
    *output = (struct umbu_output){.fd = -1};
}

enum umb_status umbu_output_replace(const char *path, unsigned flags, const void *bytes,
                                    size_t size, struct umb_error *error)
{
    struct umbu_output output;
    UMB__TRY(umbu_output_begin(path, flags, &output, error));
    const enum umb_status status = umbu_output_write(&output, bytes, size, error);
    if (status == UMB_OK) {
        return umbu_output_commit(&output, error);
    }
    umbu_output_abandon(&output);
    return status;
}

enum umb_status umbu_output_write_by(const char *path, unsigned flags, umbu_writer_fn writer,
                                     void *user, struct umb_error *error)
{
    struct umbu_output output;
    const struct umb_sink sink = umbu_output_sink(&output);
    UMB__TRY(umbu_output_begin(path, flags, &output, error));
    error->message[0] = '\0';
    enum umb_status status = writer(user, &sink, error);
    if (status == UMB_OK) {
        return umbu_output_commit(&output, error);
    }
    status = umbu_output_explain(&output, status, error);
    umbu_output_abandon(&output);
    return status;
}

bool umbu_output_is_stdout(const char *path)
{
    return path != NULL && strcmp(path, "-") == 0;
}

FILE *umbu_output_talk(const char *path)
{
    return umbu_output_is_stdout(path) ? stderr : stdout;
}

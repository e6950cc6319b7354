/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A handler that removes one file and then gives the signal its usual effect.
 *
 * The handler may run on any thread while the owner goes on, so it reads a copy of the name that is
 * never freed. The signals are blocked while the name and the file change together. Another thread
 * may take a signal in that moment and finds the old state; at worst a temporary made an instant
 * ago stays.
 */
#include "study/output_guard.h"

#include <limits.h>
#include <signal.h>
#include <stdatomic.h>
#include <string.h>
#include <unistd.h>

static const int guarded_signals[] = {SIGINT, SIGTERM, SIGHUP, SIGXCPU};

enum {
    SIGNAL_COUNT = sizeof guarded_signals / sizeof guarded_signals[0]
};

static char temporary_name[PATH_MAX]; /* the temporary's name while `armed` */
static atomic_int armed;              /* lock-free: allowed in a handler */

static void handle(int number)
{
    if (atomic_load(&armed)) {
        (void)unlink(temporary_name);
    }
    (void)signal(number, SIG_DFL);
    (void)raise(number); /* arrives when this returns */
}

/* Blocks the signals, or unblocks them. */
static void hold(int how)
{
    sigset_t set;
    sigemptyset(&set);
    for (int i = 0; i < SIGNAL_COUNT; i++) {
        sigaddset(&set, guarded_signals[i]);
    }
    (void)pthread_sigmask(how, &set, NULL);
}

static void install(void)
{
    struct sigaction action, before;
    memset(&action, 0, sizeof action);
    sigemptyset(&action.sa_mask);
    action.sa_handler = handle;
    for (int i = 0; i < SIGNAL_COUNT; i++) {
        if (sigaction(guarded_signals[i], NULL, &before) == 0 && before.sa_handler == SIG_DFL) {
            (void)sigaction(guarded_signals[i], &action, NULL);
        }
    }
}

int umbt_output_is_stdout(const char *path)
{
    return path != NULL && strcmp(path, "-") == 0;
}

FILE *umbt_output_talk(const char *path)
{
    return umbt_output_is_stdout(path) ? stderr : stdout;
}

enum umb_status umbt_output_check(const char *path, struct umb_error *error)
{
    return umbt_output_is_stdout(path) ? UMB_OK : umbs_file_check(path, error);
}

enum umb_status umbt_output_begin(const char *path, struct umbs_file *file, struct umb_error *error)
{
    static char name[] = "stdout"; /* for messages; it is never opened by name */
    if (umbt_output_is_stdout(path)) {
        *file = (struct umbs_file){.fd = STDOUT_FILENO, .path = name};
        return UMB_OK;
    }
    hold(SIG_BLOCK);
    install();
    const enum umb_status status = umbs_file_begin(path, file, error);
    if (status == UMB_OK && strlen(file->temporary) < sizeof temporary_name) {
        memcpy(temporary_name, file->temporary, strlen(file->temporary) + 1);
        atomic_store(&armed, 1);
    }
    hold(SIG_UNBLOCK);
    return status;
}

enum umb_status umbt_output_commit(struct umbs_file *file, struct umb_error *error)
{
    if (file->temporary == NULL) {
        return UMB_OK; /* stdout: a failed write was reported */
    }
    /* Once renamed, there is no file of the temporary's name to remove. */
    const enum umb_status status = umbs_file_commit(file, error);
    atomic_store(&armed, 0);
    return status;
}

void umbt_output_abandon(struct umbs_file *file)
{
    if (file->temporary == NULL) {
        return; /* stdout */
    }
    umbs_file_abandon(file);
    atomic_store(&armed, 0);
}

enum umb_status umbt_output_replace(const char *path, const void *bytes, size_t size,
                                    struct umb_error *error)
{
    struct umbs_file file;
    enum umb_status status = umbt_output_begin(path, &file, error);
    if (status != UMB_OK) {
        return status;
    }
    status = umbs_file_write(&file, bytes, size, error);
    if (status == UMB_OK) {
        return umbt_output_commit(&file, error);
    }
    umbt_output_abandon(&file);
    return status;
}

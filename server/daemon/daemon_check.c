/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The option --check tests whether a start could use the files and folders of the options. It
 * changes none of them. Assets are not opened, because a damaged asset does not keep a daemon from
 * serving the others.
 */
#include <errno.h>
#include <libgen.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/try.h"
#include "common/private_folder.h"
#include "daemon/daemon.h"
#include "jobs/job_place.h"

static enum umb_status check_stores(const struct umbd_options *options, struct umb_error *error)
{
    struct umbs_store_options store = {.no_cache = 1};
    struct umbs_store *opened = NULL;
    memcpy(store.folders, options->stores, sizeof store.folders);
    enum umb_status status = umbs_store_open(&store, &opened, error);
    umbs_store_close(opened);
    return status;
}

static enum umb_status check_tokens(const struct umbd_options *options, struct umb_error *error)
{
    struct umbd_tokens *tokens = NULL;
    enum umb_status status = umbd_tokens_create(options->token_file, &tokens, error);
    umbd_tokens_destroy(tokens);
    return status;
}

static enum umb_status check_tls(const struct umbd_options *options, struct umb_error *error)
{
    const struct umbd_tls_files files = {options->tls_cert, options->tls_key,
                                         options->tls_client_ca, options->tls_crl};
    struct umbd_tls *tls = NULL;
    enum umb_status status = umbd_tls_create(&files, &tls, error);
    umbd_tls_destroy(tls);
    return status;
}

/* Checks a folder. An existing folder must be usable; for a missing one the folder above must allow
 * creating it. */
static enum umb_status check_folder(const char *option, const char *path, struct umb_error *error)
{
    struct stat info;
    char above[4096];
    int code = 0;
    if (stat(path, &info) == 0) {
        code = !S_ISDIR(info.st_mode) ? ENOTDIR : access(path, W_OK | X_OK) != 0 ? errno : 0;
    } else if (errno != ENOENT) {
        code = errno;
    } else {
        const int wrote = snprintf(above, sizeof above, "%s", path);
        code = wrote < 0 || (size_t)wrote >= sizeof above ? ENAMETOOLONG
               : access(dirname(above), W_OK | X_OK) != 0 ? errno
                                                          : 0;
    }
    return code == 0 ? UMB_OK
                     : umb_fail_errno(error, UMB_E_CANNOT_CREATE, code, "%s: cannot use '%.150s'",
                                      option, path);
}

/* A cache must also be protected from other users. */
static enum umb_status check_cache(const char *path, struct umb_error *error)
{
    struct umb_error cause;
    char *resolved = NULL;
    enum umb_status status = check_folder("--cache", path, error);
    if (status == UMB_OK && access(path, F_OK) == 0 &&
        umbs_private_folder(path, &resolved, &cause) != UMB_OK) {
        status = umb_fail(error, cause.status, "--cache: %s", cause.message);
    }
    free(resolved);
    return status;
}

/* Checks the place of the job table. If the jobs folder does not exist yet, only the start checks
 * it. */
static enum umb_status check_table(const struct umbd_options *options, struct umb_error *error)
{
    struct umbj_place place;
    return options->bakes.table != NULL || access(options->bakes.folder, F_OK) == 0
               ? umbj_place_check(options->bakes.folder, options->bakes.table, &place, error)
               : UMB_OK;
}

static bool is_in_path(const char *name)
{
    const char *path = getenv("PATH");
    char file[4096];
    while (path != NULL && *path != '\0') {
        const size_t length = strcspn(path, ":");
        const int wrote = snprintf(file, sizeof file, "%.*s/%s", (int)length, path, name);
        if (length > 0 && wrote > 0 && (size_t)wrote < sizeof file && access(file, X_OK) == 0) {
            return true;
        }
        path += length + (path[length] == ':');
    }
    return false;
}

/* Tests Slurm's programs. Only --check does so; a start does not, because a cluster may be upgraded
 * under a running daemon. */
static enum umb_status check_slurm(struct umb_error *error)
{
    static const char *const names[] = {"sbatch", "squeue", "scancel", "scontrol"};
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++) {
        if (!is_in_path(names[i])) {
            return umb_fail(error, UMB_E_UNAVAILABLE, "--executor slurm: no %s in PATH", names[i]);
        }
    }
    return UMB_OK;
}

static enum umb_status check_jobs(const struct umbd_options *options, struct umb_error *error)
{
    UMB__TRY(check_folder("--jobs", options->bakes.folder, error));
    UMB__TRY(umbd_daemon_check_apart(options, options->bakes.folder, error));
    UMB__TRY(check_table(options, error));
    if (options->bakes.tries.program != NULL && access(options->bakes.tries.program, X_OK) != 0) {
        return umb_fail_errno(error, UMB_E_UNAVAILABLE, errno, "--bake-program: '%.200s'",
                              options->bakes.tries.program);
    }
    return options->bakes.slurm ? check_slurm(error) : UMB_OK;
}

enum umb_status umbd_daemon_check(const struct umbd_options *options, struct umb_error *error)
{
    UMB__TRY(check_stores(options, error));
    if (options->cache != NULL) {
        UMB__TRY(check_cache(options->cache, error));
    }
    if (options->token_file != NULL) {
        UMB__TRY(check_tokens(options, error));
    }
    if (options->tls_cert != NULL && options->tls_key != NULL) {
        UMB__TRY(check_tls(options, error));
    }
    return options->bakes.folder != NULL ? check_jobs(options, error) : UMB_OK;
}

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * --check: whether the files and folders that the options name could be used, found out as a start
 * does, without a change to any of them. Assets are not opened: one that is damaged keeps no daemon
 * from serving the others.
 */
#include <errno.h>
#include <unistd.h>

#include "base/open_status.h"
#include "daemon/daemon.h"

static enum umb_status check_stores(const struct umbd_options *options, struct umb_error *error)
{
    struct umbs_store_options store = {.no_cache = 1};
    struct umbs_store *opened = NULL;
    for (size_t i = 0; i < UMBS_STORE_FOLDERS_MAX && options->stores[i] != NULL; i++) {
        store.folders[i] = options->stores[i];
    }
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
                                         options->tls_client_ca};
    struct umbd_tls *tls = NULL;
    enum umb_status status = umbd_tls_create(&files, &tls, error);
    umbd_tls_destroy(tls);
    return status;
}

enum umb_status umbd_daemon_check(const struct umbd_options *options, struct umb_error *error)
{
    enum umb_status status = check_stores(options, error);
    if (status == UMB_OK && options->token_file != NULL) {
        status = check_tokens(options, error);
    }
    if (status == UMB_OK && options->tls_cert != NULL && options->tls_key != NULL) {
        status = check_tls(options, error);
    }
    if (status == UMB_OK && options->jobs != NULL && options->bake_program != NULL &&
        access(options->bake_program, X_OK) != 0) {
        status = umb_fail_errno(error, umb__open_status(errno), errno, "--bake-program: %.200s",
                                options->bake_program);
    }
    return status;
}

/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_SHUT_IN_H
#define UMBRAGE_SERVER_BAKE_SHUT_IN_H
/* The sandbox of a bake (sandbox/sandbox.h) with the paths that its options name. */
#include "bake/options/bake_options.h"
#include "scene/scene.h"

/*
 * Sets the limits and restricts paths to those of the options. The bake may read the scene's folder
 * (only the file itself if the scene is a scene buffer) and write the folders of output and tiles.
 * A missing folder of tiles is created first, because the bake may not create one afterwards.
 *
 * Fails: the errors of umbb_bake_sandbox_paths.
 */
UMB_CHECKED enum umb_status umbb_shut_in_paths(const struct umbb_options *options,
                                               struct umbb_bake_sandbox *sandbox,
                                               struct umb_error *error);

/* Loads the filter of system calls, as the hook umbs_import_options.shut_in. user: the sandbox. */
UMB_CHECKED enum umb_status umbb_shut_in_calls(void *user, const struct umbs_importer *importer,
                                               struct umb_error *error);

/* Prints a missing layer on stderr. */
void umbb_shut_in_notice(const struct umbb_bake_sandbox *sandbox);

#endif

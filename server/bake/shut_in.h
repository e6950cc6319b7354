/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_SHUT_IN_H
#define UMBRAGE_SERVER_BAKE_SHUT_IN_H
/* The sandbox of a bake (sandbox/bake_sandbox.h) with the paths that its options name. */
#include "bake/bake_options.h"
#include "common/scene.h"

/*
 * Sets the limits and takes away all paths but those of the options: the scene's folder to read (of
 * a scene buffer the file alone), the folders of output and tiles to write. A missing folder of
 * tiles is made first, because the bake may make none afterwards.
 *
 * Fails: as umbb_bake_sandbox_paths.
 */
UMB_CHECKED enum umb_status umbb_shut_in_paths(const struct umbb_options *options,
                                               struct umbb_bake_sandbox *sandbox,
                                               struct umb_error *error);

/* Takes away calls: for umbs_import_options.shut_in. In: user: the sandbox. */
UMB_CHECKED enum umb_status umbb_shut_in_calls(void *user, const struct umbs_importer *importer,
                                               struct umb_error *error);

/* Says on stderr which layer is missing, if one is. */
void umbb_shut_in_notice(const struct umbb_bake_sandbox *sandbox);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CLI_CLI_BUNDLE_H
#define UMBRAGE_CLI_CLI_BUNDLE_H
/*
 * The files that a scene needs: itself, and what it names beside itself (buffers and images of
 * glTF, material libraries of OBJ and their textures). Names are looked for in the text, not
 * parsed: one too many costs bytes, the daemon's importer decides what they mean.
 *
 * Paths of the bundle are relative to the deepest folder that holds all of them. Names that are no
 * files here are left out with a notice, and so are files outside of the scene's folder, by ".." or
 * by links: a scene must not decide which of a user's files leave the machine.
 */
#include "umbrage/jobs.h"

#define UMBC_BUNDLE_FILES_MAX 4096

struct umbc_bundle {
    struct umb_job_file *files; /* the first one is the scene */
    size_t count;
};

/* Gathers them. quiet: no notices. Fails: E_NO_INPUT, E_IO, E_LIMIT, E_NO_MEMORY, E_BAD_SCENE (a
 * name that leaves the file system's root). */
UMB_CHECKED enum umb_status umbc_bundle_gather(const char *scene, int quiet,
                                               struct umbc_bundle *bundle, struct umb_error *error);
void umbc_bundle_finish(struct umbc_bundle *bundle);

#endif

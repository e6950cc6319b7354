/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CLI_CLI_BUNDLE_H
#define UMBRAGE_CLI_CLI_BUNDLE_H
/*
 * The files that a scene needs: the scene file and the files that it names (buffers and images of
 * glTF, material libraries of OBJ and their textures). The text is searched for names, not parsed:
 * an extra name only costs bytes, because the daemon's importer decides what to read.
 *
 * Paths of the bundle are relative to the deepest folder that holds all files. Two kinds of names
 * are left out with a notice: those without a file, and those that lead out of the scene's folder
 * by ".." or by links. A scene must not decide which of a user's files leave the machine.
 */
#include "umbrage/jobs.h"

#define UMBC_BUNDLE_FILES_MAX 4096

struct umbc_bundle {
    struct umb_job_file *files; /* [count] the scene first */
    size_t count;
};

/* Gathers the files of a scene. quiet: no notices. Fails: E_NO_INPUT, E_IO, E_LIMIT, E_NO_MEMORY,
 * E_BAD_SCENE (a name that leaves the file system's root). */
UMB_CHECKED enum umb_status umbc_bundle_gather(const char *scene, int quiet,
                                               struct umbc_bundle *bundle, struct umb_error *error);
void umbc_bundle_finish(struct umbc_bundle *bundle);

#endif

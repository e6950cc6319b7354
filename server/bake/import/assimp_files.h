/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_IMPORT_ASSIMP_FILES_H
#define UMBRAGE_SERVER_BAKE_IMPORT_ASSIMP_FILES_H
/*
 * The only files that Assimp can see: the scene, under a name of our own, and files beneath its
 * folder (import_files.h). Nothing can be written.
 */
#include <assimp/cfileio.h>
#include "bake/import/import_job.h"

struct umbb_assimp_files {
    struct aiFileIO io; /* hand this to Assimp */
    const struct umbb_import *job;
    const char *main_name; /* name under which Assimp sees the scene file */
    char refused[160];     /* reason why the last missing file was refused, or "" */
};

/* Prepares io. It must not move afterwards. */
void umbb_assimp_files_init(struct umbb_assimp_files *files, const struct umbb_import *job,
                            const char *main_name);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_IMPORT_ASSIMP_FILES_H
#define UMBRAGE_SERVER_BAKE_IMPORT_ASSIMP_FILES_H
/*
 * The only files that Assimp can see: the scene, under a name of our own, and what lies beneath its
 * folder (import_files.h). Nothing can be written.
 */
#include <assimp/cfileio.h>
#include "bake/import/import_job.h"

struct umbb_assimp_files {
    struct aiFileIO io; /* hand this to Assimp */
    const struct umbb_import *job;
    const char *main_name; /* the name the scene file goes by */
    char refused[160];     /* why the last missing file could not be had, or "" */
};

/* Prepares io. It must not move afterwards. */
void umbb_assimp_files_init(struct umbb_assimp_files *files, const struct umbb_import *job,
                            const char *main_name);

#endif

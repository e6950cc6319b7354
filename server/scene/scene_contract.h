/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_SCENE_SCENE_CONTRACT_H
#define UMBRAGE_SERVER_SCENE_SCENE_CONTRACT_H
/*
 * What the process that wants a scene and the importer's process agree on. The words are in
 * server/bake/import/import_child.h; the numbers are here, because both sides need them.
 */

#define UMBS_CHILD_COMMAND "import-child" /* argv[1] */

/* Descriptors of the importer beside 0 and 1 (/dev/null) and 2 (a pipe for its one sentence). */
enum umbs_child_fd {
    UMBS_CHILD_FD_INPUT = 3,  /* the scene file, a regular file, read only */
    UMBS_CHILD_FD_FILES = 4,  /* asks for the files that the scene names (scene_broker.h) */
    UMBS_CHILD_FD_OUTPUT = 5, /* an empty memfd for the scene buffer */
};

/* argv of the importer: program, command, then these. Numbers are decimal, none is 0. */
enum umbs_child_argument {
    UMBS_CHILD_ARG_COMMAND = 1,
    UMBS_CHILD_ARG_NAME = 2,          /* last component of the scene's path, for format and talk */
    UMBS_CHILD_ARG_MAX_MEMORY = 3,    /* bytes of address space */
    UMBS_CHILD_ARG_MAX_INPUT = 4,     /* bytes of any file read */
    UMBS_CHILD_ARG_MAX_TRIANGLES = 5, /* instances multiplied */
    UMBS_CHILD_ARG_COUNT = 6,
};

#endif

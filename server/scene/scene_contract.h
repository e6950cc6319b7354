/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_SCENE_SCENE_CONTRACT_H
#define UMBRAGE_SERVER_SCENE_SCENE_CONTRACT_H
/*
 * The contract between the importer's process and the process that starts it: numbers of
 * descriptors and arguments. server/bake/import/import_job.h describes the program.
 */

#define UMBS_CHILD_COMMAND "import-child" /* argv[1] */

/* Descriptors of the importer besides 0 and 1 (/dev/null) and 2 (a pipe for its one message). */
enum umbs_child_fd {
    UMBS_CHILD_FD_INPUT = 3, /* the scene file, a regular file, read only */
    UMBS_CHILD_FD_FILES = 4, /* socket to ask for the files that the scene names (scene_broker.h) */
    UMBS_CHILD_FD_OUTPUT = 5, /* an empty memfd for the scene buffer */
};

/* argv of the importer: program, command, then these. Numbers are decimal, none is 0. */
enum umbs_child_argument {
    UMBS_CHILD_ARG_COMMAND = 1,
    /* Last component of the scene's path, for its format and for messages. */
    UMBS_CHILD_ARG_NAME = 2,
    UMBS_CHILD_ARG_MAX_MEMORY = 3,    /* bytes of address space */
    UMBS_CHILD_ARG_MAX_INPUT = 4,     /* limit in bytes of every file read */
    UMBS_CHILD_ARG_MAX_TRIANGLES = 5, /* instances multiplied */
    UMBS_CHILD_ARG_LOOK = 6,          /* 1: shapes only; 2: what pictures need, too */
    UMBS_CHILD_ARG_COUNT = 7,
};

#endif

/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_SANDBOX_SANDBOX_PARTS_H
#define UMBRAGE_SERVER_BAKE_SANDBOX_SANDBOX_PARTS_H
/* The layers behind sandbox.h and bake_sandbox.h. */
#include <stddef.h>

/* Rights that a rule gives over a file, or over everything below a folder. */
enum umbb_path_use {
    UMBB_PATH_READ = 0,
    UMBB_PATH_RUN = 1,   /* read and run as a program */
    UMBB_PATH_WRITE = 2, /* read, and make, write, rename and remove files; no folders */
};

struct umbb_path_rule {
    const char *path;
    enum umbb_path_use use;
};

/* Enters the importer's filter. Returns 1 if the calling process is now inside, or 0 and errno. */
int umbb_filter_enter(void);

/* Enters the bake's filter. Returns 1, or 0 and errno. importer: process number of the importer, 0:
 * none runs. socket: descriptor of the socket to the importer. */
int umbb_bake_filter_enter(int importer, int socket);

/* Denies every path but those of the rules to the calling thread. Returns the ABI of the kernel's
 * Landlock, or 0 and errno: nothing is denied. */
int umbb_landlock_enter(const struct umbb_path_rule *rules, size_t count);

#endif

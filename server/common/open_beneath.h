/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_COMMON_OPEN_BENEATH_H
#define UMBRAGE_SERVER_COMMON_OPEN_BENEATH_H
/* Opens a regular file by an untrusted name that must not leave a folder. */

#define UMBS_BENEATH_NAME_BYTES 1024 /* with the NUL */

/*
 * Opens a regular file for reading.
 *
 * In:    folder: descriptor of a folder (O_PATH suffices). name: relative, '/' between components.
 * Out:   the descriptor, or -1 and errno: EXDEV or ELOOP if the name leaves the folder (absolute,
 *        "..", a symbolic link out of it), EISDIR or ENODEV if it is no regular file, ENAMETOOLONG,
 *        or an error of open.
 * Trust: safe on hostile names and against concurrent changes of the folder; never waits for a
 *        pipe.
 */
int umbs_open_beneath(int folder, const char *name);

#endif

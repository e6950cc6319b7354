/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_COMMON_TRUSTED_FILE_H
#define UMBRAGE_SERVER_COMMON_TRUSTED_FILE_H
/* Files that only the calling user can have written. The checks use the open descriptor. */
#include "umbrage/status.h"

/*
 * Opens a file for reading, once, after these proofs: its folder and the file belong to the calling
 * user or to root, neither can be written by group or others, and the file is a regular one (the
 * last component is no symbolic link).
 *
 * In:    what: the field that named the file, for messages ("--scene-buffer").
 * Out:   fd: >= 0, or -1 on failure.
 * Fails: E_NO_INPUT (missing, no regular file), E_PERMISSION (not proven: the message names path,
 *        owner and mode, and what to do), E_IO.
 */
UMB_CHECKED enum umb_status umbs_trusted_open(const char *what, const char *path, int *fd,
                                              struct umb_error *error);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_COMMON_PRIVATE_FOLDER_H
#define UMBRAGE_SERVER_COMMON_PRIVATE_FOLDER_H
/*
 * Folders and files that no other user can change. A file is "ours" if it belongs to this process's
 * user or to root. POSIX ACLs that let others write show as write permission of the group.
 */
#include <sys/stat.h>
#include "umbrage/status.h"

/*
 * Resolves a folder and checks that only this user and root can add or remove files in it, or put
 * another folder in its place. It must be ours and writable by its owner only; the same holds for
 * all folders above, except that a sticky one (/tmp) may be writable by all.
 *
 * Out:   resolved: its path without links, malloc; NULL on failure.
 * Fails: E_PERMISSION (names the folder at fault and its owner or mode), E_NO_INPUT, E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbs_private_folder(const char *path, char **resolved,
                                                struct umb_error *error);

/*
 * Opens a file for reading, once, with two proofs: its folder is as umbs_private_folder says, and
 * the open file is as umbs_private_file says. The last component is no symbolic link.
 *
 * Out:   fd: >= 0, or -1 on failure.
 * Fails: E_NO_INPUT (missing, no regular file), E_PERMISSION (not proven: the message names what to
 *        do), E_IO, E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbs_private_open(const char *path, int *fd, struct umb_error *error);

/* 1 if an open file is regular, ours, has one name only and no other user may write to it. */
int umbs_private_file(const struct stat *facts);

#endif

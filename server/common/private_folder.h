/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_COMMON_PRIVATE_FOLDER_H
#define UMBRAGE_SERVER_COMMON_PRIVATE_FOLDER_H
/*
 * Folders and files that no other user can change. Here a file is "ours" if it belongs to this
 * process's user or to root. POSIX ACLs that let others write appear as write permission of the
 * group.
 */
#include <sys/stat.h>
#include "umbrage/status.h"

/*
 * Resolves a folder, and checks that only this user and root can change its entries or put another
 * folder in its place. The folder must be ours and writable by its owner only. The same holds for
 * all folders above, except that a sticky one (/tmp) may be writable by all.
 *
 * Out:   resolved: its path without links, malloc; NULL on failure.
 * Fails: E_PERMISSION (names the folder at fault and its owner or mode), E_NO_INPUT, E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbs_private_folder(const char *path, char **resolved,
                                                struct umb_error *error);

/*
 * Opens a file for reading, once, after two checks: the folder passes umbs_private_folder, and the
 * open file passes umbs_private_file. The last component of the path must not be a symbolic link.
 *
 * Out:   fd: >= 0, or -1 on failure.
 * Fails: E_NO_INPUT (missing, not a regular file), E_PERMISSION (a check failed: the message says
 *        what to do), E_IO, E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbs_private_open(const char *path, int *fd, struct umb_error *error);

/* Returns 1 if an open file is regular, ours, has one name only and no other user may write to
 * it. */
int umbs_private_file(const struct stat *facts);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_JOBS_FOLDER_H
#define UMBRAGE_SERVER_JOBS_FOLDER_H
/* Folders below the jobs folder: listed, made, removed. No link is ever followed. */
#include <stdatomic.h>
#include <stddef.h>
#include "umbrage/status.h"

/* Writes the path of the folder that contains `path`: the part before the last slash, "." or "/".
 * Returns the path's length, as snprintf does. */
int umbj_folder_above(const char *path, char *above, size_t size);

/* Names in a folder, without "." and "..". */
struct umbj_names {
    char **list;
    size_t count;
};

/* Reads the names in a folder. Returns 0; or -1, and then nothing is allocated. In: folder: a
 * descriptor, which stays open. */
int umbj_names_read(int folder, struct umbj_names *names);
void umbj_names_finish(struct umbj_names *names);

/* Calls each(user, folder, name) for the names in a folder, and closes its descriptor. In: folder:
 * -1 = the folder could not be opened. Returns 0, or -1 if the folder could not be read. */
int umbj_folder_each(int folder, void (*each)(void *user, int folder, const char *name),
                     void *user);

/* Removes a file, or a folder with all its content; a missing one is fine. The removal ends early
 * once *stop is 1; stop may be NULL. A bundle's paths have at most UMBJ_PATH_DEPTH_MAX components,
 * which bounds the recursion. */
void umbj_folder_remove_until(int parent, const char *name, const atomic_int *stop);
void umbj_folder_remove(int parent, const char *name);

/* Removes a folder into which other processes may still write. The folder is first renamed to
 * NAME.gone, so that these processes no longer find it. Files that cannot be removed stay under
 * that name. */
void umbj_folder_drop(int parent, const char *name);

/* Removes everything in a folder but not the folder. */
void umbj_folder_empty(int parent, const char *name);

/* Creates a folder, for this user alone, unless it exists. After the call the folder survives a
 * power cut. Fails: E_CANNOT_CREATE. */
UMB_CHECKED enum umb_status umbj_folder_make(int parent, const char *name, struct umb_error *error);

#endif

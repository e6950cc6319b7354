/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_IMPORT_IMPORT_FILES_H
#define UMBRAGE_SERVER_BAKE_IMPORT_IMPORT_FILES_H
/*
 * Files of a scene, mapped read only: the scene file itself and the files that it names beneath its
 * folder. A file that shrinks while it is mapped kills the importer's process, and only that.
 */
#include <stddef.h>
#include <stdint.h>
#include "umbrage/status.h"

struct umbb_file {
    const char *bytes; /* content, not NUL-terminated; never NULL once mapped */
    size_t size;
    void *map; /* memory to unmap; NULL if size is 0 */
};

/*
 * Source of the files that a scene names: a folder (umbs_open_beneath), or the parent process,
 * which opens them for an importer that may open nothing (umbs_broker_open).
 */
struct umbb_folder {
    int handle;
    int (*open)(int handle, const char *name); /* a regular file's descriptor, or -1 and errno */
};

/* Maps the regular file behind a descriptor. Fails: E_LIMIT (more than max_bytes), E_IO,
 * E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbb_file_map(int fd, uint64_t max_bytes, struct umbb_file *file,
                                          struct umb_error *error);

/*
 * Opens and maps a file that the scene names.
 *
 * In:    name: char[length], as in the scene; '\' counts as '/'.
 * Fails: E_PERMISSION (absolute, "..", leaves the folder, a symbolic link out of it), E_NOT_FOUND
 *        (missing, or not a regular file), E_LIMIT, E_IO, E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbb_file_map_named(const struct umbb_folder *folder, const char *name,
                                                size_t length, uint64_t max_bytes,
                                                struct umbb_file *file, struct umb_error *error);

/* umbb_file_map_named for a name that may be percent-encoded, as URIs of glTF are (RFC 3986): the
 * literal name is tried first, then the decoded one. */
UMB_CHECKED enum umb_status umbb_file_map_uri(const struct umbb_folder *folder, const char *uri,
                                              size_t length, uint64_t max_bytes,
                                              struct umbb_file *file, struct umb_error *error);

/* 1 if the file begins with a text. */
int umbb_starts_with(const struct umbb_file *file, const char *text);

/* 1 if the file begins without a NUL, as text does. */
int umbb_is_text(const struct umbb_file *file);

/* Unmaps the file. No effect on a zeroed struct. */
void umbb_file_unmap(struct umbb_file *file);

#endif

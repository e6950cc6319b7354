/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_FOLDER_FIXTURE_H
#define UMBRAGE_TESTS_FOLDER_FIXTURE_H
/* A temporary folder, removed with all that is in it. */
#include <dirent.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

struct folder {
    char path[64];
    char file[512]; /* the last name made by folder_file */
};

static inline void folder_make(struct folder *folder)
{
    snprintf(folder->path, sizeof folder->path, "/tmp/umbrage-test-XXXXXX");
    assert_non_null(mkdtemp(folder->path));
}

/* Path of a file in the folder; valid until the next call. */
static inline const char *folder_file(struct folder *folder, const char *name)
{
    snprintf(folder->file, sizeof folder->file, "%s/%s", folder->path, name);
    return folder->file;
}

static inline void remove_tree(const char *path)
{
    DIR *open_folder = opendir(path);
    struct dirent *item;
    while (open_folder != NULL && (item = readdir(open_folder)) != NULL) {
        char name[1024];
        if (strcmp(item->d_name, ".") == 0 || strcmp(item->d_name, "..") == 0) {
            continue;
        }
        snprintf(name, sizeof name, "%.600s/%s", path, item->d_name);
        if (unlink(name) != 0) {
            remove_tree(name);
        }
    }
    if (open_folder != NULL) {
        closedir(open_folder);
    }
    rmdir(path);
}

static inline void folder_remove(struct folder *folder)
{
    chmod(folder->path, 0755);
    remove_tree(folder->path);
}

static inline long folder_size(struct folder *folder, const char *name)
{
    struct stat status;
    return stat(folder_file(folder, name), &status) == 0 ? (long)status.st_size : -1;
}

#endif

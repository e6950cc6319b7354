/* SPDX-License-Identifier: Apache-2.0 */
/* Folders below the jobs folder, see folder.h. */
#include "jobs/folder.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "common/file_system.h"
#include "tool/output.h"

void umbj_names_finish(struct umbj_names *names)
{
    for (size_t i = 0; i < names->count; i++) {
        free(names->list[i]);
    }
    free(names->list);
    *names = (struct umbj_names){NULL, 0};
}

static int add_name(struct umbj_names *names, const char *name)
{
    char **list = realloc(names->list, (names->count + 1) * sizeof *list);
    if (list == NULL) {
        return -1;
    }
    names->list = list;
    list[names->count] = strdup(name);
    return list[names->count] != NULL ? (int)(names->count++, 0) : -1;
}

int umbj_names_read(int folder, struct umbj_names *names)
{
    *names = (struct umbj_names){NULL, 0};
    int copy = openat(folder, ".", O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    DIR *listing = copy >= 0 ? fdopendir(copy) : NULL;
    if (listing == NULL) {
        umbs_hang_up(&copy);
        return -1;
    }
    int failed = 0;
    const struct dirent *entry;
    while (!failed && (entry = readdir(listing)) != NULL) {
        if (strcmp(entry->d_name, ".") != 0 && strcmp(entry->d_name, "..") != 0) {
            failed = add_name(names, entry->d_name);
        }
    }
    closedir(listing);
    if (failed) {
        umbj_names_finish(names);
    }
    return failed;
}

int umbj_folder_each(int folder, void (*each)(void *user, int folder, const char *name), void *user)
{
    struct umbj_names names;
    if (folder < 0) {
        return -1;
    }
    const int failed = umbj_names_read(folder, &names);
    for (size_t i = 0; i < names.count; i++) {
        each(user, folder, names.list[i]);
    }
    umbj_names_finish(&names);
    close(folder);
    return failed;
}

static void remove_one(void *user, int folder, const char *name)
{
    umbj_folder_remove_until(folder, name, user);
}

void umbj_folder_remove_until(int parent, const char *name, const atomic_int *stop)
{
    if ((stop != NULL && atomic_load(stop)) || unlinkat(parent, name, 0) == 0 ||
        (errno != EISDIR && errno != EPERM)) {
        return;
    }
    (void)umbj_folder_each(openat(parent, name, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC),
                           remove_one, (void *)stop);
    (void)unlinkat(parent, name, AT_REMOVEDIR); /* files that stay are swept at the next start */
}

void umbj_folder_empty(int parent, const char *name)
{
    (void)umbj_folder_each(openat(parent, name, O_RDONLY | O_DIRECTORY | O_CLOEXEC), remove_one,
                           NULL);
}

void umbj_folder_remove(int parent, const char *name)
{
    umbj_folder_remove_until(parent, name, NULL);
}

void umbj_folder_drop(int parent, const char *name)
{
    char gone[4300]; /* longer than any path */
    (void)snprintf(gone, sizeof gone, "%.4200s.gone", name);
    umbj_folder_remove(parent, renameat(parent, name, parent, gone) == 0 ? gone : name);
}

int umbj_folder_above(const char *path, char *above, size_t size)
{
    const char *slash = strrchr(path, '/');
    return slash == NULL   ? snprintf(above, size, ".")
           : slash == path ? snprintf(above, size, "/")
                           : snprintf(above, size, "%.*s", (int)(slash - path), path);
}

/* Syncs the parent folder: without this a power cut may remove the new folder. */
static int sync_parent(int parent, const char *name)
{
    char above[4300];
    (void)umbj_folder_above(name, above, sizeof above);
    return umbu_folder_sync_at(parent, above);
}

enum umb_status umbj_folder_make(int parent, const char *name, struct umb_error *error)
{
    const int made = mkdirat(parent, name, 0700) == 0;
    if (!made && errno != EEXIST) {
        return umb_fail_errno(error, UMB_E_CANNOT_CREATE, errno,
                              "cannot create the folder '%.100s'", name);
    }
    /* Syncs the parent of an existing folder too: a process may have ended between its mkdir and
     * its sync. The parent may be unreadable, which is a failure only if the folder is new. */
    if (sync_parent(parent, name) != 0 && made) {
        return umb_fail_errno(error, UMB_E_CANNOT_CREATE, errno,
                              "cannot sync what holds the folder '%.100s'", name);
    }
    return UMB_OK;
}

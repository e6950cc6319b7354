/* SPDX-License-Identifier: Apache-2.0 */
/* Makes and removes the folder of doctor_ground.h. */
#include "bake/sandbox/doctor_ground.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static const char *const folders[] = {"scene", "work", "other"};
static const char *const files[] = {"scene/scene.ply", "work/mine.umb", "other/tokens",
                                    "other/jobs.db", "other/tile.umbt"};
#define COUNT(array) (sizeof(array) / sizeof((array)[0]))

void umbb_ground_path(const struct umbb_ground *ground, const char *name,
                      char path[UMBB_GROUND_PATH])
{
    const int is_below = name[0] != '/';
    (void)snprintf(path, UMBB_GROUND_PATH, "%s%s%s", is_below ? ground->folder : "",
                   is_below ? "/" : "", name);
}

static int make_file(const char *path)
{
    const int fd = open(path, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
    return fd >= 0 && write(fd, "secret\n", 7) == 7 && close(fd) == 0;
}

/* Fills the folder. Returns 0, and errno, if a part cannot be made. */
static int fill(struct umbb_ground *ground)
{
    char path[UMBB_GROUND_PATH], tokens[UMBB_GROUND_PATH];
    int good = 1;
    umbb_ground_path(ground, "scene", ground->scene);
    umbb_ground_path(ground, "work", ground->work);
    for (size_t i = 0; good && i < COUNT(folders); i++) {
        umbb_ground_path(ground, folders[i], path);
        good = mkdir(path, 0700) == 0;
    }
    for (size_t i = 0; good && i < COUNT(files); i++) {
        umbb_ground_path(ground, files[i], path);
        good = make_file(path);
    }
    umbb_ground_path(ground, "other/tokens", tokens);
    umbb_ground_path(ground, "work/link", path);
    return good && symlink(tokens, path) == 0;
}

static int make_folder_in(struct umbb_ground *ground, const char *parent)
{
    if (parent == NULL ||
        strlen(parent) + sizeof "/umbrage-doctor-XXXXXX" > sizeof ground->folder) {
        return -1;
    }
    (void)snprintf(ground->folder, sizeof ground->folder, "%s/umbrage-doctor-XXXXXX", parent);
    return mkdtemp(ground->folder) != NULL ? 0 : -1;
}

enum umb_status umbb_ground_make(struct umbb_ground *ground, struct umb_error *error)
{
    memset(ground, 0, sizeof *ground);
    if (make_folder_in(ground, getenv("TMPDIR")) != 0 && make_folder_in(ground, "/tmp") != 0 &&
        make_folder_in(ground, "/var/tmp") != 0) {
        ground->folder[0] = '\0';
        return umb_fail_errno(error, UMB_E_CANNOT_CREATE, errno,
                              "no folder for the tries (TMPDIR, /tmp, /var/tmp)");
    }
    if (!fill(ground)) {
        const enum umb_status status = umb_fail_errno(error, UMB_E_CANNOT_CREATE, errno,
                                                      "cannot fill '%.60s'", ground->folder);
        umbb_ground_remove(ground);
        return status;
    }
    return UMB_OK;
}

/* Removes the folder and what allowed actions left in it: known names only, contents first. */
void umbb_ground_remove(struct umbb_ground *ground)
{
    static const char *const all[] = {
        "work/new",  "work/stolen", "work/link",       "work/mine.umb", "work",
        "other/new", "other/mine",  "other/tokens",    "other/jobs.db", "other/tile.umbt",
        "other",     "scene/new",   "scene/scene.ply", "scene",         "",
    };
    char path[UMBB_GROUND_PATH];
    for (size_t i = 0; ground->folder[0] != '\0' && i < COUNT(all); i++) {
        umbb_ground_path(ground, all[i], path);
        (void)remove(path);
    }
    ground->folder[0] = '\0';
}

void umbb_ground_rules(const struct umbb_ground *ground,
                       struct umbb_path_rule rules[UMBB_GROUND_RULES])
{
    rules[0] = (struct umbb_path_rule){ground->scene, UMBB_PATH_READ};
    rules[1] = (struct umbb_path_rule){ground->work, UMBB_PATH_WRITE};
}

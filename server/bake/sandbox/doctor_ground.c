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

static void name_all(struct umbb_ground *ground)
{
    const struct {
        char *to;
        const char *name;
    } names[] = {
        {ground->scene, "scene"},
        {ground->scene_file, "scene/scene.ply"},
        {ground->work, "work"},
        {ground->mine, "work/mine.umb"},
        {ground->link, "work/link"},
        {ground->other, "other"},
        {ground->tokens, "other/tokens"},
        {ground->table, "other/jobs.db"},
        {ground->tile, "other/tile.umbt"},
    };
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++) {
        (void)snprintf(names[i].to, UMBB_GROUND_PATH, "%s/%s", ground->folder, names[i].name);
    }
}

static int make_file(const char *path)
{
    const int fd = open(path, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
    return fd >= 0 && write(fd, "secret\n", 7) == 7 && close(fd) == 0 ? 0 : -1;
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
    name_all(ground);
    if (mkdir(ground->scene, 0700) != 0 || mkdir(ground->work, 0700) != 0 ||
        mkdir(ground->other, 0700) != 0 || make_file(ground->scene_file) != 0 ||
        make_file(ground->mine) != 0 || make_file(ground->tokens) != 0 ||
        make_file(ground->table) != 0 || make_file(ground->tile) != 0 ||
        symlink(ground->tokens, ground->link) != 0) {
        const enum umb_status status = umb_fail_errno(error, UMB_E_CANNOT_CREATE, errno,
                                                      "cannot fill '%.60s'", ground->folder);
        umbb_ground_remove(ground);
        return status;
    }
    return UMB_OK;
}

/* An allowed action leaves its files behind: only known names are removed. */
void umbb_ground_remove(struct umbb_ground *ground)
{
    static const char *const made[] = {"work/new", "work/stolen", "other/new", "other/mine",
                                       "scene/new"};
    char path[UMBB_GROUND_PATH];
    if (ground->folder[0] == '\0') {
        return;
    }
    for (size_t i = 0; i < sizeof made / sizeof made[0]; i++) {
        (void)snprintf(path, sizeof path, "%s/%s", ground->folder, made[i]);
        (void)remove(path);
    }
    const char *const all[] = {ground->scene_file, ground->mine,  ground->link,  ground->tokens,
                               ground->table,      ground->tile,  ground->scene, ground->work,
                               ground->other,      ground->folder};
    for (size_t i = 0; i < sizeof all / sizeof all[0]; i++) {
        (void)remove(all[i]);
    }
    ground->folder[0] = '\0';
}

void umbb_ground_rules(const struct umbb_ground *ground,
                       struct umbb_path_rule rules[UMBB_GROUND_RULES])
{
    rules[0] = (struct umbb_path_rule){ground->scene, UMBB_PATH_READ};
    rules[1] = (struct umbb_path_rule){ground->work, UMBB_PATH_WRITE};
}

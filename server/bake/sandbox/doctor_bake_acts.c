/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Actions that a scene in control of a bake would try on the files of a job service, and actions
 * that a bake needs (doctor_acts.h). Each runs in a separate process. An action that is allowed
 * changes only the doctor's temporary folder.
 */
#define _GNU_SOURCE /* O_DIRECTORY */
#include "bake/sandbox/doctor_acts.h"

#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define THREAD_BYTES ((size_t)8 << 20)

static char name_of_true[] = "/bin/true";

static long run_program(void)
{
    char *const words[] = {name_of_true, NULL};
    return execve(name_of_true, words, words + 1);
}

static int cut_file(const char *path)
{
    return truncate(path, 0);
}

static int change_owner(const char *path)
{
    return chown(path, getuid(), getgid());
}

static int change_times(const char *path)
{
    return utimensat(AT_FDCWD, path, NULL, 0);
}

static int need_scene(const char *path)
{
    char byte;
    const int fd = open(path, O_RDONLY);
    return fd >= 0 && read(fd, &byte, 1) == 1 ? 0 : -1;
}

/* Creates an asset as usual: writes, syncs and renames a temporary, then syncs the folder. */
static int need_output(const char *temporary, const char *target)
{
    char parent[UMBB_GROUND_PATH];
    (void)snprintf(parent, sizeof parent, "%s", target);
    *strrchr(parent, '/') = '\0';
    const int fd = open(temporary, O_WRONLY | O_CREAT | O_EXCL, 0600);
    const int folder = open(parent, O_RDONLY | O_DIRECTORY);
    return fd >= 0 && folder >= 0 && write(fd, "a", 1) == 1 && fsync(fd) == 0 &&
                   rename(temporary, target) == 0 && fsync(folder) == 0
               ? 0
               : -1;
}

static void *work(void *user)
{
    char *memory = malloc(THREAD_BYTES);
    if (memory != NULL) {
        memset(memory, 1, THREAD_BYTES);
    }
    *(int *)user = memory != NULL;
    free(memory);
    return NULL;
}

static long need_thread(void)
{
    pthread_t thread;
    int done = 0;
    errno = pthread_create(&thread, NULL, work, &done);
    if (errno != 0) {
        return -1;
    }
    return pthread_join(thread, NULL) == 0 && done ? 0 : -1;
}

#define CALLS UMBB_IN_BAKE
#define PATHS (UMBB_IN_BAKE | UMBB_IN_BAKE_PATHS)

const struct umbb_act umbb_bake_acts[] = {
    {"read a token file", PATHS, "other/tokens", .flags = O_RDONLY},
    {"read the job table", PATHS, "other/jobs.db", .flags = O_RDONLY},
    {"write the job table", PATHS, "other/jobs.db", .flags = O_RDWR},
    {"list another owner's folder", PATHS, "other", .flags = O_RDONLY | O_DIRECTORY},
    {"list the folder above", PATHS, ".", .flags = O_RDONLY | O_DIRECTORY},
    {"read through a link", PATHS, "work/link", .flags = O_RDONLY},
    {"read /etc/passwd", PATHS, "/etc/passwd", .flags = O_RDONLY},
    {"read another process's files", CALLS, "/proc/1/maps", .flags = O_RDONLY},
    {"write the scene", PATHS, "scene/scene.ply", .flags = O_WRONLY},
    {"create a file beside the scene", PATHS, "scene/new", .flags = O_WRONLY | O_CREAT},
    {"create a file elsewhere", PATHS, "other/new", .flags = O_WRONLY | O_CREAT},
    {"remove another owner's tile", PATHS, "other/tile.umbt", .on_one = unlink},
    {"rename a file out", PATHS, "work/mine.umb", .target = "other/mine", .on_two = rename},
    {"rename a file in", PATHS, "other/tokens", .target = "work/stolen", .on_two = rename},
    {"link a file in", PATHS, "other/tokens", .target = "work/stolen", .on_two = link},
    {"make a folder", PATHS, "work/new", .flags = 0700, .on_mode = mkdir},
    {"make a link", PATHS, "/etc/passwd", .target = "work/new", .on_two = symlink},
    {"make a pipe", PATHS, "work/new", .flags = 0600, .on_mode = mkfifo},
    {"run another program", PATHS, .attempt = run_program},
    {"cut another's file", CALLS, "other/jobs.db", .on_one = cut_file},
    {"change a file's mode", CALLS, "other/tokens", .flags = 0777, .on_mode = chmod},
    {"change a file's owner", CALLS, "other/tokens", .on_one = change_owner},
    {"change a file's times", CALLS, "other/tokens", .on_one = change_times},
};
const size_t umbb_bake_act_count = sizeof(umbb_bake_acts) / sizeof(umbb_bake_acts[0]);

const struct umbb_act umbb_bake_needs[] = {
    {"read the scene", PATHS, "scene/scene.ply", .on_one = need_scene},
    {"write and replace the asset", PATHS, "work/new", .target = "work/mine.umb",
     .on_two = need_output},
    {"work in a thread", PATHS, .attempt = need_thread},
    {"read its own program", PATHS, "/proc/self/exe",
     .flags = O_RDONLY}, /* the importer is this program */
};
const size_t umbb_bake_need_count = sizeof(umbb_bake_needs) / sizeof(umbb_bake_needs[0]);

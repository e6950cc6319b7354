/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Actions that a scene in control of a bake would try on the files of a job service, and actions
 * that a bake needs (doctor_acts.h). Each runs in a separate process. An action that is allowed
 * changes only the doctor's temporary folder.
 */
#define _GNU_SOURCE /* O_TMPFILE and the like on old headers */
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

static const struct umbb_ground *ground;
static const char *forbidden;
static char name_of_true[] = "/bin/true";

void umbb_bake_acts_on(const struct umbb_ground *on)
{
    ground = on;
}

void umbb_bake_acts_forbid(const char *file)
{
    forbidden = file;
}

/* Path of a name in a folder; valid until the next call. */
static const char *path_in(const char *folder, const char *name)
{
    static char path[2 * UMBB_GROUND_PATH];
    (void)snprintf(path, sizeof path, "%s/%s", folder, name);
    return path;
}

static long make(const char *folder)
{
    return open(path_in(folder, "new"), O_WRONLY | O_CREAT, 0600);
}

static long read_tokens(void)
{
    return open(ground->tokens, O_RDONLY);
}

static long read_table(void)
{
    return open(ground->table, O_RDONLY);
}

static long write_table(void)
{
    return open(ground->table, O_RDWR);
}

static long list_other(void)
{
    return open(ground->other, O_RDONLY | O_DIRECTORY);
}

static long list_above(void)
{
    return open(ground->folder, O_RDONLY | O_DIRECTORY);
}

static long read_link(void)
{
    return open(ground->link, O_RDONLY);
}

static long read_system(void)
{
    return open("/etc/passwd", O_RDONLY);
}

static long read_process(void)
{
    return open("/proc/1/maps", O_RDONLY);
}

static long write_scene(void)
{
    return open(ground->scene_file, O_WRONLY);
}

static long create_by_scene(void)
{
    return make(ground->scene);
}

static long create_elsewhere(void)
{
    return make(ground->other);
}

static long remove_tile(void)
{
    return unlink(ground->tile);
}

static long rename_out(void)
{
    return rename(ground->mine, path_in(ground->other, "mine"));
}

static long rename_in(void)
{
    return rename(ground->tokens, path_in(ground->work, "stolen"));
}

static long link_in(void)
{
    return link(ground->tokens, path_in(ground->work, "stolen"));
}

static long make_folder(void)
{
    return mkdir(path_in(ground->work, "new"), 0700);
}

static long make_link(void)
{
    return symlink("/etc/passwd", path_in(ground->work, "new"));
}

static long make_pipe(void)
{
    return mkfifo(path_in(ground->work, "new"), 0600);
}

static long run_program(void)
{
    char *const words[] = {name_of_true, NULL};
    return execve(name_of_true, words, words + 1);
}

static long cut_file(void)
{
    return truncate(ground->table, 0);
}

static long change_mode(void)
{
    return chmod(ground->tokens, 0777);
}

static long change_owner(void)
{
    return chown(ground->tokens, getuid(), getgid());
}

static long change_times(void)
{
    return utimensat(AT_FDCWD, ground->tokens, NULL, 0);
}

static long read_forbidden(void)
{
    return open(forbidden, O_RDONLY | O_NONBLOCK);
}

static long need_scene(void)
{
    char byte;
    const int fd = open(ground->scene_file, O_RDONLY);
    return fd >= 0 && read(fd, &byte, 1) == 1 ? 0 : -1;
}

/* Creates an asset in the usual way: a temporary, synced, renamed, its folder synced. */
static long need_output(void)
{
    char temporary[2 * UMBB_GROUND_PATH];
    (void)snprintf(temporary, sizeof temporary, "%s", path_in(ground->work, "new"));
    const int fd = open(temporary, O_WRONLY | O_CREAT | O_EXCL, 0600);
    const int folder = open(ground->work, O_RDONLY | O_DIRECTORY);
    return fd >= 0 && folder >= 0 && write(fd, "a", 1) == 1 && fsync(fd) == 0 &&
                   rename(temporary, ground->mine) == 0 && fsync(folder) == 0
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

/* The importer is this program. */
static long need_importer(void)
{
    const int fd = open("/proc/self/exe", O_RDONLY);
    return fd >= 0 ? 0 : -1;
}

#define CALLS UMBB_IN_BAKE
#define PATHS (UMBB_IN_BAKE | UMBB_IN_BAKE_PATHS)

const struct umbb_act umbb_bake_acts[] = {
    {"read a token file", read_tokens, PATHS},
    {"read the job table", read_table, PATHS},
    {"write the job table", write_table, PATHS},
    {"list another owner's folder", list_other, PATHS},
    {"list the folder above", list_above, PATHS},
    {"read through a link", read_link, PATHS},
    {"read /etc/passwd", read_system, PATHS},
    {"read another process's files", read_process, CALLS},
    {"write the scene", write_scene, PATHS},
    {"create a file beside the scene", create_by_scene, PATHS},
    {"create a file elsewhere", create_elsewhere, PATHS},
    {"remove another owner's tile", remove_tile, PATHS},
    {"rename a file out", rename_out, PATHS},
    {"rename a file in", rename_in, PATHS},
    {"link a file in", link_in, PATHS},
    {"make a folder", make_folder, PATHS},
    {"make a link", make_link, PATHS},
    {"make a pipe", make_pipe, PATHS},
    {"run another program", run_program, PATHS},
    {"cut another's file", cut_file, CALLS},
    {"change a file's mode", change_mode, CALLS},
    {"change a file's owner", change_owner, CALLS},
    {"change a file's times", change_times, CALLS},
};
const size_t umbb_bake_act_count = sizeof(umbb_bake_acts) / sizeof(umbb_bake_acts[0]);

const struct umbb_act umbb_bake_act_forbidden = {"read", read_forbidden, PATHS};

const struct umbb_act umbb_bake_needs[] = {
    {"read the scene", need_scene, PATHS},
    {"write and replace the asset", need_output, PATHS},
    {"work in a thread", need_thread, PATHS},
    {"read its own program", need_importer, PATHS},
};
const size_t umbb_bake_need_count = sizeof(umbb_bake_needs) / sizeof(umbb_bake_needs[0]);

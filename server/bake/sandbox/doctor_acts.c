/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The forbidden acts, those that a scene in control of a bake would try on the files of a job
 * service, and acts that a bake needs (doctor.h).
 *
 * Each runs in a separate process that ends afterwards, so nothing needs undoing but the doctor's
 * temporary folder. An act that could do harm if it were allowed (a signal, a changed mount) has
 * harmless arguments. A bad argument is enough where the kernel checks the right first: any error
 * but a refusal counts as allowed (doctor_try.c).
 */
#define _GNU_SOURCE /* clone flags, O_DIRECTORY, syscall */
#include "bake/sandbox/doctor.h"

#include <errno.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <pthread.h>
#include <sched.h>
#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/ptrace.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#define ABSENT       "/proc/umbrage-doctor" /* no file has that name */
#define THREAD_BYTES ((size_t)8 << 20)

static int look_at_path(const char *path)
{
    struct stat facts;
    return stat(path, &facts);
}

static long connect_out(void)
{
    struct sockaddr_in address = {.sin_family = AF_INET};
    return connect(STDIN_FILENO, (struct sockaddr *)&address, sizeof(address));
}

static long start_program(void)
{
    char *const arguments[] = {NULL};
    return execve(ABSENT, arguments, arguments);
}

static long fork_process(void)
{
    pid_t child = (pid_t)syscall(SYS_clone, (long)SIGCHLD, 0L, 0L, 0L, 0L);
    if (child == 0) {
        _exit(0);
    }
    return child;
}

static long signal_parent(void)
{
    return kill(getppid(), 0);
}

static long read_other_memory(void)
{
    return syscall(SYS_process_vm_readv, getppid(), NULL, 0UL, NULL, 0UL, 0UL);
}

static long make_executable(void)
{
    void *page = mmap(NULL, 4096, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    return page == MAP_FAILED ? -1 : mprotect(page, 4096, PROT_READ | PROT_EXEC);
}

static long mount_something(void)
{
    return syscall(SYS_mount, "none", "/proc", "tmpfs", -1L, NULL);
}

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

#define BOTH  (UMBB_IN_IMPORTER | UMBB_IN_BAKE)
#define PATHS (UMBB_IN_IMPORTER | UMBB_IN_LANDLOCK)

const struct umbb_act umbb_acts[] = {
    {"read a file", PATHS, "/etc/passwd", .flags = O_RDONLY},
    {"read a folder", PATHS, "/", .flags = O_RDONLY | O_DIRECTORY},
    {"look at a path", UMBB_IN_IMPORTER, "/etc/passwd", .on_one = look_at_path},
    {"create a file", PATHS, "/tmp", .flags = O_TMPFILE | O_RDWR},
    {"create a folder", UMBB_IN_IMPORTER, ABSENT, .flags = 0700, .on_mode = mkdir},
    {"remove a file", UMBB_IN_IMPORTER, ABSENT, .on_one = unlink},
    {"rename a file", UMBB_IN_IMPORTER, ABSENT, .target = ABSENT "2", .on_two = rename},
    {"make a link", UMBB_IN_IMPORTER, "/etc/passwd", .target = ABSENT, .on_two = symlink},
    {"change a file's mode", UMBB_IN_IMPORTER, ABSENT, .flags = 0777, .on_mode = chmod},
    {"make an internet socket", BOTH, .call = {SYS_socket, AF_INET, SOCK_STREAM}},
    {"make a unix socket", BOTH, .call = {SYS_socket, AF_UNIX, SOCK_DGRAM}},
    {"make a netlink socket", BOTH, .call = {SYS_socket, AF_NETLINK, SOCK_RAW}},
    {"connect", BOTH, .attempt = connect_out},
    {"write to another descriptor", UMBB_IN_IMPORTER, .call = {SYS_write, STDOUT_FILENO}},
    {"start a program", BOTH, .attempt = start_program},
    {"fork", BOTH, .attempt = fork_process},
    {"signal the parent", BOTH, .attempt = signal_parent},
    {"ptrace", BOTH, .call = {SYS_ptrace, PTRACE_TRACEME}},
    {"read another process's memory", BOTH, .attempt = read_other_memory},
    {"map executable memory", BOTH,
     .call = {SYS_mmap, 0, 4096, PROT_READ | PROT_WRITE | PROT_EXEC, MAP_PRIVATE | MAP_ANONYMOUS,
              -1}},
    {"make memory executable", BOTH, .attempt = make_executable},
    {"mount", BOTH, .attempt = mount_something},
    {"enter a new namespace", BOTH, .call = {SYS_unshare, CLONE_NEWUSER}},
    {"change the root", BOTH, "/proc", .on_one = chroot},
    {"change the user", BOTH, .call = {SYS_setuid, 0}},
    {"load a BPF program", BOTH, .call = {SYS_bpf, -1}},
    {"use io_uring", BOTH, .call = {SYS_io_uring_setup}},
    {"use userfaultfd", BOTH, .call = {SYS_userfaultfd, -1}},
    {"use the keyring", BOTH, .call = {SYS_keyctl, 0, -3}},
    {"watch performance events", BOTH, .call = {SYS_perf_event_open, 0, 0, -1, -1}},
};
const size_t umbb_act_count = sizeof(umbb_acts) / sizeof(umbb_acts[0]);

#define BAKE_PATHS (UMBB_IN_BAKE | UMBB_IN_BAKE_PATHS)

const struct umbb_act umbb_bake_acts[] = {
    {"read a token file", BAKE_PATHS, "other/tokens", .flags = O_RDONLY},
    {"read the job table", BAKE_PATHS, "other/jobs.db", .flags = O_RDONLY},
    {"write the job table", BAKE_PATHS, "other/jobs.db", .flags = O_RDWR},
    {"list another owner's folder", BAKE_PATHS, "other", .flags = O_RDONLY | O_DIRECTORY},
    {"list the folder above", BAKE_PATHS, ".", .flags = O_RDONLY | O_DIRECTORY},
    {"read through a link", BAKE_PATHS, "work/link", .flags = O_RDONLY},
    {"read /etc/passwd", BAKE_PATHS, "/etc/passwd", .flags = O_RDONLY},
    {"read another process's files", UMBB_IN_BAKE, "/proc/1/maps", .flags = O_RDONLY},
    {"write the scene", BAKE_PATHS, "scene/scene.ply", .flags = O_WRONLY},
    {"create a file beside the scene", BAKE_PATHS, "scene/new", .flags = O_WRONLY | O_CREAT},
    {"create a file elsewhere", BAKE_PATHS, "other/new", .flags = O_WRONLY | O_CREAT},
    {"remove another owner's tile", BAKE_PATHS, "other/tile.umbt", .on_one = unlink},
    {"rename a file out", BAKE_PATHS, "work/mine.umb", .target = "other/mine", .on_two = rename},
    {"rename a file in", BAKE_PATHS, "other/tokens", .target = "work/stolen", .on_two = rename},
    {"link a file in", BAKE_PATHS, "other/tokens", .target = "work/stolen", .on_two = link},
    {"make a folder", BAKE_PATHS, "work/new", .flags = 0700, .on_mode = mkdir},
    {"make a link", BAKE_PATHS, "/etc/passwd", .target = "work/new", .on_two = symlink},
    {"make a pipe", BAKE_PATHS, "work/new", .flags = 0600, .on_mode = mkfifo},
    {"run another program", BAKE_PATHS, .attempt = run_program},
    {"cut another's file", UMBB_IN_BAKE, "other/jobs.db", .on_one = cut_file},
    {"change a file's mode", UMBB_IN_BAKE, "other/tokens", .flags = 0777, .on_mode = chmod},
    {"change a file's owner", UMBB_IN_BAKE, "other/tokens", .on_one = change_owner},
    {"change a file's times", UMBB_IN_BAKE, "other/tokens", .on_one = change_times},
};
const size_t umbb_bake_act_count = sizeof(umbb_bake_acts) / sizeof(umbb_bake_acts[0]);

const struct umbb_act umbb_bake_needs[] = {
    {"read the scene", BAKE_PATHS, "scene/scene.ply", .on_one = need_scene},
    {"write and replace the asset", BAKE_PATHS, "work/new", .target = "work/mine.umb",
     .on_two = need_output},
    {"work in a thread", BAKE_PATHS, .attempt = need_thread},
    {"read its own program", BAKE_PATHS, "/proc/self/exe",
     .flags = O_RDONLY}, /* the importer is this program */
};
const size_t umbb_bake_need_count = sizeof(umbb_bake_needs) / sizeof(umbb_bake_needs[0]);

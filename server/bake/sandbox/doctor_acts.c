/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The forbidden acts (doctor_acts.h). Each runs in a separate process that ends afterwards, so
 * nothing needs undoing. An act that could do harm if it were allowed (a signal, a changed mount)
 * has harmless arguments. A bad argument is enough where the kernel checks the right first: any
 * error but a refusal counts as allowed (doctor_try.c).
 */
#define _GNU_SOURCE /* clone flags, pipe2, syscall */
#include "bake/sandbox/doctor_acts.h"

#include <fcntl.h>
#include <netinet/in.h>
#include <sched.h>
#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <sys/mman.h>
#include <sys/ptrace.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#define ABSENT "/proc/umbrage-doctor" /* no file has that name */

long umbb_act_attempt(const struct umbb_act *act, const struct umbb_ground *ground)
{
    char path[UMBB_GROUND_PATH], target[UMBB_GROUND_PATH];
    if (act->attempt != NULL) {
        return act->attempt();
    }
    umbb_ground_path(ground, act->path, path);
    if (act->on_one != NULL) {
        return act->on_one(path);
    }
    if (act->on_two != NULL) {
        umbb_ground_path(ground, act->target, target);
        return act->on_two(path, target);
    }
    return act->on_mode != NULL ? act->on_mode(path, act->flags)
                                : open(path, (int)act->flags, 0600);
}

static int look_at_path(const char *path)
{
    struct stat facts;
    return stat(path, &facts);
}

static long internet_socket(void)
{
    return socket(AF_INET, SOCK_STREAM, 0);
}

static long unix_socket(void)
{
    return socket(AF_UNIX, SOCK_DGRAM, 0);
}

static long netlink_socket(void)
{
    return socket(AF_NETLINK, SOCK_RAW, 0);
}

static long connect_out(void)
{
    struct sockaddr_in address = {.sin_family = AF_INET};
    return connect(STDIN_FILENO, (struct sockaddr *)&address, sizeof(address));
}

static long write_elsewhere(void)
{
    return write(STDOUT_FILENO, "", 0);
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

static long trace_parent(void)
{
    return ptrace(PTRACE_TRACEME, 0, NULL, NULL);
}

static long read_other_memory(void)
{
    return syscall(SYS_process_vm_readv, getppid(), NULL, 0UL, NULL, 0UL, 0UL);
}

static long executable_memory(void)
{
    void *page =
        mmap(NULL, 4096, PROT_READ | PROT_WRITE | PROT_EXEC, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    return page == MAP_FAILED ? -1 : 0;
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

static long new_namespace(void)
{
    return unshare(CLONE_NEWUSER);
}

static long change_root(void)
{
    return chroot("/proc");
}

static long become_root(void)
{
    return setuid(0);
}

static long load_bpf(void)
{
    return syscall(SYS_bpf, -1, NULL, 0);
}

static long use_io_uring(void)
{
    return syscall(SYS_io_uring_setup, 0, NULL);
}

static long use_userfaultfd(void)
{
    return syscall(SYS_userfaultfd, -1);
}

static long use_keyring(void)
{
    return syscall(SYS_keyctl, 0, -3L, 0L, 0L, 0L);
}

static long watch_events(void)
{
    return syscall(SYS_perf_event_open, NULL, 0, -1, -1, 0UL);
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
    {"make an internet socket", BOTH, .attempt = internet_socket},
    {"make a unix socket", BOTH, .attempt = unix_socket},
    {"make a netlink socket", BOTH, .attempt = netlink_socket},
    {"connect", BOTH, .attempt = connect_out},
    {"write to another descriptor", UMBB_IN_IMPORTER, .attempt = write_elsewhere},
    {"start a program", BOTH, .attempt = start_program},
    {"fork", BOTH, .attempt = fork_process},
    {"signal the parent", BOTH, .attempt = signal_parent},
    {"ptrace", BOTH, .attempt = trace_parent},
    {"read another process's memory", BOTH, .attempt = read_other_memory},
    {"map executable memory", BOTH, .attempt = executable_memory},
    {"make memory executable", BOTH, .attempt = make_executable},
    {"mount", BOTH, .attempt = mount_something},
    {"enter a new namespace", BOTH, .attempt = new_namespace},
    {"change the root", BOTH, .attempt = change_root},
    {"change the user", BOTH, .attempt = become_root},
    {"load a BPF program", BOTH, .attempt = load_bpf},
    {"use io_uring", BOTH, .attempt = use_io_uring},
    {"use userfaultfd", BOTH, .attempt = use_userfaultfd},
    {"use the keyring", BOTH, .attempt = use_keyring},
    {"watch performance events", BOTH, .attempt = watch_events},
};
const size_t umbb_act_count = sizeof(umbb_acts) / sizeof(umbb_acts[0]);

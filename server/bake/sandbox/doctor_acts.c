/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The forbidden acts (doctor_acts.h). They run in a separate process that is discarded, so nothing
 * needs undoing. An act that could do harm if it were allowed (a signal, a changed mount) has
 * harmless arguments. If a right is checked before the arguments, a bad argument suffices: any
 * error but a refusal counts as allowed (doctor.c).
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

static long read_passwd(void)
{
    return open("/etc/passwd", O_RDONLY);
}

static long read_root_folder(void)
{
    return open("/", O_RDONLY | O_DIRECTORY);
}

static long look_at_path(void)
{
    struct stat facts;
    return stat("/etc/passwd", &facts);
}

static long create_file(void)
{
    return open("/tmp", O_TMPFILE | O_RDWR, 0600);
}

static long make_folder(void)
{
    return mkdir("/proc/umbrage-doctor", 0700);
}

static long remove_file(void)
{
    return unlink("/proc/umbrage-doctor");
}

static long rename_file(void)
{
    return rename("/proc/umbrage-doctor", "/proc/umbrage-doctor2");
}

static long link_file(void)
{
    return symlink("/etc/passwd", "/proc/umbrage-doctor");
}

static long change_mode(void)
{
    return chmod("/proc/umbrage-doctor", 0777);
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
    return execve("/proc/umbrage-doctor", arguments, arguments);
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
    {"read a file", read_passwd, PATHS},
    {"read a folder", read_root_folder, PATHS},
    {"look at a path", look_at_path, UMBB_IN_IMPORTER},
    {"create a file", create_file, PATHS},
    {"create a folder", make_folder, UMBB_IN_IMPORTER},
    {"remove a file", remove_file, UMBB_IN_IMPORTER},
    {"rename a file", rename_file, UMBB_IN_IMPORTER},
    {"make a link", link_file, UMBB_IN_IMPORTER},
    {"change a file's mode", change_mode, UMBB_IN_IMPORTER},
    {"make an internet socket", internet_socket, BOTH},
    {"make a unix socket", unix_socket, BOTH},
    {"make a netlink socket", netlink_socket, BOTH},
    {"connect", connect_out, BOTH},
    {"write to another descriptor", write_elsewhere, UMBB_IN_IMPORTER},
    {"start a program", start_program, BOTH},
    {"fork", fork_process, BOTH},
    {"signal the parent", signal_parent, BOTH},
    {"ptrace", trace_parent, BOTH},
    {"read another process's memory", read_other_memory, BOTH},
    {"map executable memory", executable_memory, BOTH},
    {"make memory executable", make_executable, BOTH},
    {"mount", mount_something, BOTH},
    {"enter a new namespace", new_namespace, BOTH},
    {"change the root", change_root, BOTH},
    {"change the user", become_root, BOTH},
    {"load a BPF program", load_bpf, BOTH},
    {"use io_uring", use_io_uring, BOTH},
    {"use userfaultfd", use_userfaultfd, BOTH},
    {"use the keyring", use_keyring, BOTH},
    {"watch performance events", watch_events, BOTH},
};
const size_t umbb_act_count = sizeof(umbb_acts) / sizeof(umbb_acts[0]);

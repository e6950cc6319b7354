/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The lists of allowed system calls of importer and bake (sandbox.h).
 *
 * The importer may make the calls that it was seen to make: memory, the clock, its own end,
 * messages to its parent over its two descriptors, and reads of the descriptors it was given. Calls
 * that libraries try and can do without get EACCES. Any other call kills the process: it comes from
 * an attacker, not from the importer.
 *
 * A bake may use files, memory, threads, clocks, and its importer until that has ended. Landlock
 * restricts the files. Calls that no bake makes but an attacker would (programs, sockets, other
 * processes, rights) kill the process. Any other call gets ENOSYS, as from an older kernel: another
 * version of the C library or of Embree then falls back to older calls.
 *
 * Why not libseccomp: a filter must be whole or absent. libseccomp 2.5.4 makes some 800 allocations
 * and, if one fails, can load a filter that lacks rules (decision 7). Sources: seccomp(2), bpf_insn
 * in linux/filter.h.
 */
#define _GNU_SOURCE /* clone flags, fcntl commands, syscall */
#include <errno.h>
#include <fcntl.h>
#include <linux/audit.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <sched.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "bake/sandbox/sandbox.h"
#include "scene/scene_contract.h"

#define COUNT(array) (sizeof(array) / sizeof((array)[0]))
#define REFUSE       (SECCOMP_RET_ERRNO | EACCES)
#define UNKNOWN      (SECCOMP_RET_ERRNO | ENOSYS)

#define CODE_MAX 512

/* Program under construction. `count` may grow beyond the size of the array; filter_load then
 * fails. */
struct filter {
    struct sock_filter code[CODE_MAX];
    size_t count;
};

/* Call that is allowed if one argument, masked, has a value. The low 32 bits are compared, because
 * the kernel uses no more of descriptors, process numbers, commands and protection bits. */
struct condition {
    uint16_t call;
    uint8_t argument;
    uint32_t mask, value;
};

#if defined(__x86_64__)
#define ARCHITECTURE AUDIT_ARCH_X86_64
#elif defined(__aarch64__)
#define ARCHITECTURE AUDIT_ARCH_AARCH64
#else
#error "the filters know the system calls of x86-64 and AArch64 only"
#endif

static void put(struct filter *filter, struct sock_filter instruction)
{
    if (filter->count < CODE_MAX) {
        filter->code[filter->count] = instruction;
    }
    filter->count++;
}

static void put_load(struct filter *filter, size_t offset)
{
    put(filter, (struct sock_filter)BPF_STMT(BPF_LD | BPF_W | BPF_ABS, (uint32_t)offset));
}

/* Adds a test: if the loaded word is not `value`, the next `otherwise` instructions are skipped. */
static void put_if(struct filter *filter, uint32_t value, uint8_t otherwise)
{
    put(filter, (struct sock_filter)BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, value, 0, otherwise));
}

static void put_return(struct filter *filter, uint32_t action)
{
    put(filter, (struct sock_filter)BPF_STMT(BPF_RET | BPF_K, action));
}

static size_t argument_at(uint8_t argument)
{
    return offsetof(struct seccomp_data, args) + 8 * (size_t)argument;
}

/* Begins a program. Calls of another architecture have other numbers, so they kill the process. */
static void filter_begin(struct filter *filter)
{
    put_load(filter, offsetof(struct seccomp_data, arch));
    put(filter, (struct sock_filter)BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, ARCHITECTURE, 1, 0));
    put_return(filter, SECCOMP_RET_KILL_PROCESS);
    put_load(filter, offsetof(struct seccomp_data, nr));
}

/* Sets the action of each of these calls: SECCOMP_RET_*. */
static void filter_calls(struct filter *filter, const uint16_t *calls, size_t count,
                         uint32_t action)
{
    for (size_t i = 0; i < count; i++) {
        put_if(filter, calls[i], 1);
        put_return(filter, action);
    }
}

/* Leaves the call's number loaded; so does filter_if_null. */
static void filter_if(struct filter *filter, const struct condition *conditions, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        put_if(filter, conditions[i].call, 5);
        put_load(filter, argument_at(conditions[i].argument));
        put(filter, (struct sock_filter)BPF_STMT(BPF_ALU | BPF_AND | BPF_K, conditions[i].mask));
        put_if(filter, conditions[i].value, 1);
        put_return(filter, SECCOMP_RET_ALLOW);
        put_load(filter, offsetof(struct seccomp_data, nr));
    }
}

/* Allows a call whose argument is a null pointer: all 64 bits are compared. */
static void filter_if_null(struct filter *filter, uint16_t call, uint8_t argument)
{
    put_if(filter, call, 6);
    put_load(filter, argument_at(argument));
    put_if(filter, 0, 3);
    put_load(filter, argument_at(argument) + 4);
    put_if(filter, 0, 1);
    put_return(filter, SECCOMP_RET_ALLOW);
    put_load(filter, offsetof(struct seccomp_data, nr));
}

/* Ends the program with the action for every other call, and loads the program for all threads of
 * the process. Returns 1; or 0 and errno if nothing changed. */
static int filter_load(struct filter *filter, uint32_t otherwise)
{
    put_return(filter, otherwise);
    if (filter->count > CODE_MAX) {
        errno = E2BIG;
        return 0;
    }
    const struct sock_fprog loaded = {(unsigned short)filter->count, filter->code};
    return syscall(SYS_seccomp, SECCOMP_SET_MODE_FILTER, SECCOMP_FILTER_FLAG_TSYNC, &loaded) == 0;
}

/* No page becomes executable. */
static const struct condition no_new_code[] = {
    {SYS_mmap, 2, PROT_EXEC, 0},
    {SYS_mprotect, 2, PROT_EXEC, 0},
};

static const uint16_t importer_allowed[] = {
    SYS_brk,          SYS_munmap,          SYS_mremap,
    SYS_madvise,      SYS_futex,           SYS_clock_gettime,
    SYS_gettimeofday, SYS_getrandom,       SYS_lseek,
    SYS_fstat,        SYS_close,           SYS_exit,
    SYS_exit_group,   SYS_rt_sigaction,    SYS_rt_sigprocmask,
    SYS_rt_sigreturn, SYS_restart_syscall, SYS_getpid,
    SYS_gettid,       SYS_sched_yield,
};

static const uint16_t importer_refused[] = {
#if defined(__x86_64__) /* later architectures only have their younger forms */
    SYS_open,       SYS_access,    SYS_stat,       SYS_lstat,
    SYS_readlink,
#endif
    SYS_openat,     SYS_openat2,   SYS_faccessat,  SYS_faccessat2,
    SYS_newfstatat, SYS_statx,     SYS_readlinkat, SYS_getcwd,
    SYS_getdents64, SYS_ioctl,     SYS_fcntl,      SYS_socket,
    SYS_read,       SYS_sysinfo,   SYS_uname,      SYS_sched_getaffinity,
    SYS_prlimit64,  SYS_getrusage,
};

int umbb_filter_enter(void)
{
    const struct condition talk[] = {
        {SYS_write, 0, UINT32_MAX, STDERR_FILENO},
        {SYS_write, 0, UINT32_MAX, UMBS_CHILD_FD_OUTPUT},
        {SYS_sendmsg, 0, UINT32_MAX, UMBS_CHILD_FD_FILES},
        {SYS_recvmsg, 0, UINT32_MAX, UMBS_CHILD_FD_FILES},
        {SYS_tgkill, 0, UINT32_MAX, (uint32_t)getpid()}, /* abort() */
    };
    struct filter filter = {.count = 0};
    filter_begin(&filter);
    filter_calls(&filter, importer_allowed, COUNT(importer_allowed), SECCOMP_RET_ALLOW);
    filter_calls(&filter, importer_refused, COUNT(importer_refused), REFUSE);
    filter_if(&filter, no_new_code, COUNT(no_new_code));
    filter_if(&filter, talk, COUNT(talk));
    return filter_load(&filter, SECCOMP_RET_KILL_PROCESS);
}

/* Flags of clone: those of every thread, and those of no thread. */
#define THREAD_FLAGS ((uint32_t)(CLONE_VM | CLONE_SIGHAND | CLONE_THREAD))
#define SPACE_FLAGS                                                                                \
    ((uint32_t)(CLONE_NEWNS | CLONE_NEWCGROUP | CLONE_NEWUTS | CLONE_NEWIPC | CLONE_NEWUSER |      \
                CLONE_NEWPID | CLONE_NEWNET))

/* Calls on files; Landlock restricts which files. */
static const uint16_t files[] = {
#if defined(__x86_64__) /* later architectures only have their younger forms */
    SYS_open,    SYS_access,    SYS_stat,       SYS_lstat,      SYS_readlink,
    SYS_mkdir,   SYS_unlink,    SYS_rename,     SYS_poll,
#endif
    SYS_openat,  SYS_openat2,   SYS_faccessat,  SYS_faccessat2, SYS_newfstatat,
    SYS_statx,   SYS_fstat,     SYS_readlinkat, SYS_getcwd,     SYS_getdents64,
    SYS_mkdirat, SYS_unlinkat,  SYS_renameat,   SYS_renameat2,  SYS_read,
    SYS_readv,   SYS_pread64,   SYS_write,      SYS_writev,     SYS_pwrite64,
    SYS_lseek,   SYS_ftruncate, SYS_fsync,      SYS_fdatasync,  SYS_close,
};

/* Memory and threads. */
static const uint16_t threads[] = {
    SYS_brk,     SYS_munmap,      SYS_mremap,
    SYS_madvise, SYS_futex,       SYS_set_robust_list,
    SYS_rseq,    SYS_sched_yield, SYS_sched_getaffinity,
    SYS_getcpu,  SYS_gettid,      SYS_getpid,
    SYS_getppid, SYS_exit,        SYS_exit_group,
};

/* Allowed calls of a bake about signals, clocks, facts of the machine, and the end of the
 * importer. */
static const uint16_t facts[] = {
    SYS_rt_sigaction,    SYS_rt_sigprocmask, SYS_rt_sigreturn, SYS_sigaltstack,
    SYS_restart_syscall, SYS_clock_gettime,  SYS_clock_getres, SYS_clock_nanosleep,
    SYS_nanosleep,       SYS_gettimeofday,   SYS_getrandom,    SYS_sysinfo,
    SYS_uname,           SYS_getrusage,      SYS_getuid,       SYS_geteuid,
    SYS_getgid,          SYS_getegid,        SYS_ppoll,        SYS_waitid,
    SYS_wait4,
};

/* Calls of an attacker only: programs, other processes, sockets. */
static const uint16_t killed_others[] = {
    SYS_execve,     SYS_ptrace,      SYS_execveat,
    SYS_socket,     SYS_connect,     SYS_process_vm_readv,
    SYS_bind,       SYS_listen,      SYS_process_vm_writev,
    SYS_sendto,     SYS_accept4,     SYS_pidfd_send_signal,
    SYS_pidfd_open, SYS_pidfd_getfd,
#if defined(__x86_64__)
    SYS_fork,       SYS_vfork,
#endif
};

/* Calls of an attacker only: rights, and parts of the kernel. */
static const uint16_t killed_rights[] = {
    SYS_mount,        SYS_umount2,    SYS_pivot_root,      SYS_chroot,         SYS_unshare,
    SYS_setns,        SYS_setuid,     SYS_setgid,          SYS_setreuid,       SYS_setregid,
    SYS_setresuid,    SYS_setresgid,  SYS_setgroups,       SYS_capset,         SYS_truncate,
    SYS_bpf,          SYS_keyctl,     SYS_add_key,         SYS_request_key,    SYS_init_module,
    SYS_finit_module, SYS_kexec_load, SYS_perf_event_open, SYS_io_uring_setup, SYS_userfaultfd,
};

static void allow_conditions(struct filter *filter, int importer, int socket)
{
    const uint32_t all = UINT32_MAX;
    const struct condition conditions[] = {
        {SYS_clone, 0, THREAD_FLAGS | SPACE_FLAGS, THREAD_FLAGS},
        {SYS_tgkill, 0, all, (uint32_t)getpid()},
        {SYS_kill, 0, all, (uint32_t)getpid()},
        {SYS_prlimit64, 0, all, 0},
        {SYS_prctl, 0, all, PR_SET_NAME},
        {SYS_prctl, 0, all, PR_SET_VMA},
        {SYS_ioctl, 1, all, TCGETS},
        {SYS_ioctl, 1, all, TIOCGWINSZ},
        {SYS_fcntl, 1, all, F_GETFD},
        {SYS_fcntl, 1, all, F_SETFD},
        {SYS_fcntl, 1, all, F_GETFL},
        {SYS_fcntl, 1, all, F_SETFL},
        {SYS_fcntl, 1, all, F_DUPFD_CLOEXEC},
        {SYS_fcntl, 1, all, F_ADD_SEALS},
    };
    const struct condition talk[] = {
        {SYS_kill, 0, all, (uint32_t)importer},   {SYS_kill, 0, all, (uint32_t)-importer},
        {SYS_sendmsg, 0, all, (uint32_t)socket},  {SYS_recvmsg, 0, all, (uint32_t)socket},
        {SYS_recvfrom, 0, all, (uint32_t)socket},
    };
    filter_if(filter, no_new_code, COUNT(no_new_code));
    filter_if(filter, conditions, COUNT(conditions));
    filter_if(filter, talk, importer > 0 ? COUNT(talk) : 0);
    filter_if_null(filter, SYS_utimensat, 1); /* for open files: marks a tile as used */
}

int umbb_bake_filter_enter(int importer, int socket)
{
    /* Calls that get EACCES with any other value of the tested argument, and do not kill the
     * process: libraries try more kinds of maps. */
    static const uint16_t refused[] = {SYS_mmap, SYS_mprotect};
    static const uint16_t stopped[] = {SYS_clone,   SYS_kill,    SYS_tgkill,
                                       SYS_sendmsg, SYS_recvmsg, SYS_recvfrom};
    struct filter filter = {.count = 0};
    filter_begin(&filter);
    filter_calls(&filter, files, COUNT(files), SECCOMP_RET_ALLOW);
    filter_calls(&filter, threads, COUNT(threads), SECCOMP_RET_ALLOW);
    filter_calls(&filter, facts, COUNT(facts), SECCOMP_RET_ALLOW);
    filter_calls(&filter, killed_others, COUNT(killed_others), SECCOMP_RET_KILL_PROCESS);
    filter_calls(&filter, killed_rights, COUNT(killed_rights), SECCOMP_RET_KILL_PROCESS);
    allow_conditions(&filter, importer, socket);
    filter_calls(&filter, refused, COUNT(refused), REFUSE);
    filter_calls(&filter, stopped, COUNT(stopped), SECCOMP_RET_KILL_PROCESS);
    return filter_load(&filter, UNKNOWN);
}

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The bake's list of allowed system calls (bake_sandbox.h).
 *
 * Landlock restricts the files; this filter restricts the calls that Landlock does not see. A bake
 * may use files, memory, threads, clocks, and its importer until that has ended. Calls that no bake
 * makes but an attacker would (programs, sockets, other processes, rights) kill the process. Any
 * other call gets ENOSYS, as from an older kernel: another version of the C library or of Embree
 * then falls back to older calls.
 */
#define _GNU_SOURCE /* clone flags, fcntl commands */
#include <errno.h>
#include <fcntl.h>
#include <sched.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "bake/sandbox/filter_program.h"
#include "bake/sandbox/sandbox_parts.h"

#define COUNT(array) (sizeof(array) / sizeof((array)[0]))
#define REFUSE       (SECCOMP_RET_ERRNO | EACCES)
#define UNKNOWN      (SECCOMP_RET_ERRNO | ENOSYS)

/* Flags of clone: those of every thread, and those of no thread. */
#define THREAD_FLAGS ((uint32_t)(CLONE_VM | CLONE_SIGHAND | CLONE_THREAD))
#define SPACE_FLAGS                                                                                \
    ((uint32_t)(CLONE_NEWNS | CLONE_NEWCGROUP | CLONE_NEWUTS | CLONE_NEWIPC | CLONE_NEWUSER |      \
                CLONE_NEWPID | CLONE_NEWNET))

/* Calls that later architectures only have in younger forms. */
#if defined(__x86_64__)
static const uint16_t elder_files[] = {
    SYS_open,  SYS_access, SYS_stat,   SYS_lstat, SYS_readlink,
    SYS_mkdir, SYS_unlink, SYS_rename, SYS_poll,
};
static const uint16_t elder_programs[] = {SYS_fork, SYS_vfork};
#else
static const uint16_t elder_files[] = {SYS_openat};
static const uint16_t elder_programs[] = {SYS_execve};
#endif

/* Calls on files; Landlock restricts which files. */
static const uint16_t files[] = {
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

/* Signals, clocks, facts about the machine, and the end of the importer. */
static const uint16_t facts[] = {
    SYS_rt_sigaction,    SYS_rt_sigprocmask, SYS_rt_sigreturn, SYS_sigaltstack,
    SYS_restart_syscall, SYS_clock_gettime,  SYS_clock_getres, SYS_clock_nanosleep,
    SYS_nanosleep,       SYS_gettimeofday,   SYS_getrandom,    SYS_sysinfo,
    SYS_uname,           SYS_getrusage,      SYS_getuid,       SYS_geteuid,
    SYS_getgid,          SYS_getegid,        SYS_ppoll,        SYS_waitid,
    SYS_wait4,
};

/* Calls of an attacker only. */
static const uint16_t killed[] = {
    SYS_execve,
    SYS_execveat,
    SYS_ptrace,
    SYS_process_vm_readv,
    SYS_process_vm_writev,
    SYS_pidfd_open,
    SYS_pidfd_getfd,
    SYS_pidfd_send_signal,
    SYS_socket,
    SYS_connect,
    SYS_bind,
    SYS_listen,
    SYS_accept4,
    SYS_sendto,
    SYS_mount,
    SYS_umount2,
    SYS_pivot_root,
    SYS_chroot,
    SYS_unshare,
    SYS_setns,
    SYS_setuid,
    SYS_setgid,
    SYS_setreuid,
    SYS_setregid,
    SYS_setresuid,
    SYS_setresgid,
    SYS_setgroups,
    SYS_capset,
    SYS_truncate,
    SYS_bpf,
    SYS_perf_event_open,
    SYS_io_uring_setup,
    SYS_userfaultfd,
    SYS_keyctl,
    SYS_add_key,
    SYS_request_key,
    SYS_init_module,
    SYS_finit_module,
    SYS_kexec_load,
};

static void allow_conditions(struct umbb_filter *filter, int importer, int socket)
{
    const uint32_t all = UINT32_MAX;
    const struct umbb_filter_condition conditions[] = {
        {SYS_mmap, 2, PROT_EXEC, 0},
        {SYS_mprotect, 2, PROT_EXEC, 0},
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
    const struct umbb_filter_condition talk[] = {
        {SYS_kill, 0, all, (uint32_t)importer},   {SYS_kill, 0, all, (uint32_t)-importer},
        {SYS_sendmsg, 0, all, (uint32_t)socket},  {SYS_recvmsg, 0, all, (uint32_t)socket},
        {SYS_recvfrom, 0, all, (uint32_t)socket},
    };
    for (size_t i = 0; i < COUNT(conditions); i++) {
        umbb_filter_if(filter, &conditions[i]);
    }
    for (size_t i = 0; importer > 0 && i < COUNT(talk); i++) {
        umbb_filter_if(filter, &talk[i]);
    }
    umbb_filter_if_null(filter, SYS_utimensat, 1); /* for open files: marks a tile as used */
}

int umbb_bake_filter_enter(int importer, int socket)
{
    /* Other values of these arguments are refused, not fatal: libraries try to map more. */
    static const uint16_t refused[] = {SYS_mmap, SYS_mprotect};
    static const uint16_t stopped[] = {SYS_clone,   SYS_kill,    SYS_tgkill,
                                       SYS_sendmsg, SYS_recvmsg, SYS_recvfrom};
    struct umbb_filter filter = {.count = 0};
    umbb_filter_begin(&filter);
    umbb_filter_calls(&filter, elder_files, COUNT(elder_files), SECCOMP_RET_ALLOW);
    umbb_filter_calls(&filter, files, COUNT(files), SECCOMP_RET_ALLOW);
    umbb_filter_calls(&filter, threads, COUNT(threads), SECCOMP_RET_ALLOW);
    umbb_filter_calls(&filter, facts, COUNT(facts), SECCOMP_RET_ALLOW);
    umbb_filter_calls(&filter, elder_programs, COUNT(elder_programs), SECCOMP_RET_KILL_PROCESS);
    umbb_filter_calls(&filter, killed, COUNT(killed), SECCOMP_RET_KILL_PROCESS);
    allow_conditions(&filter, importer, socket);
    umbb_filter_calls(&filter, refused, COUNT(refused), REFUSE);
    umbb_filter_calls(&filter, stopped, COUNT(stopped), SECCOMP_RET_KILL_PROCESS);
    return umbb_filter_load(&filter, UNKNOWN);
}

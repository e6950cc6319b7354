/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The importer's list of allowed system calls (sandbox.h).
 *
 * Allowed are the calls that the importer was seen to make: memory, the clock, its own end,
 * messages to its parent over its two descriptors, and reads of the descriptors it was given. Calls
 * that libraries try and can do without get EACCES. Any other call kills the process: it comes from
 * an attacker, not from the importer.
 */
#define _GNU_SOURCE /* syscall numbers */
#include <errno.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "bake/sandbox/filter_program.h"
#include "bake/sandbox/sandbox_parts.h"
#include "scene/scene_contract.h"

#define COUNT(array) (sizeof(array) / sizeof((array)[0]))
#define REFUSE       (SECCOMP_RET_ERRNO | EACCES)

static const uint16_t allowed[] = {
    SYS_brk,          SYS_munmap,          SYS_mremap,
    SYS_madvise,      SYS_futex,           SYS_clock_gettime,
    SYS_gettimeofday, SYS_getrandom,       SYS_lseek,
    SYS_fstat,        SYS_close,           SYS_exit,
    SYS_exit_group,   SYS_rt_sigaction,    SYS_rt_sigprocmask,
    SYS_rt_sigreturn, SYS_restart_syscall, SYS_getpid,
    SYS_gettid,       SYS_sched_yield,
};

static const uint16_t refused[] = {
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
    const struct umbb_filter_condition conditions[] = {
        {SYS_write, 0, UINT32_MAX, STDERR_FILENO},
        {SYS_write, 0, UINT32_MAX, UMBS_CHILD_FD_OUTPUT},
        {SYS_sendmsg, 0, UINT32_MAX, UMBS_CHILD_FD_FILES},
        {SYS_recvmsg, 0, UINT32_MAX, UMBS_CHILD_FD_FILES},
        {SYS_mmap, 2, PROT_EXEC, 0},
        {SYS_mprotect, 2, PROT_EXEC, 0},
        {SYS_tgkill, 0, UINT32_MAX, (uint32_t)getpid()}, /* abort() */
    };
    struct umbb_filter filter = {.count = 0};
    umbb_filter_begin(&filter);
    umbb_filter_calls(&filter, allowed, COUNT(allowed), SECCOMP_RET_ALLOW);
    umbb_filter_calls(&filter, refused, COUNT(refused), REFUSE);
    for (size_t i = 0; i < COUNT(conditions); i++) {
        umbb_filter_if(&filter, &conditions[i]);
    }
    return umbb_filter_load(&filter, SECCOMP_RET_KILL_PROCESS);
}

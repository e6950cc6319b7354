/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The list of allowed system calls (sandbox.h).
 *
 * Allowed is what the importer was seen to need: memory, the clock, its own end, talk with its
 * parent over the two descriptors it has, the descriptors it was handed. What libraries only try
 * and cope without gets EACCES. Everything else kills the process: it is not the importer that
 * calls it any more. Source: seccomp(2), seccomp_rule_add(3).
 */
#include <errno.h>
#include <seccomp.h>
#include <sys/mman.h>
#include <unistd.h>

#include "bake/sandbox/sandbox_parts.h"
#include "common/scene_contract.h"

#define COUNT(array) (sizeof(array) / sizeof((array)[0]))

static const int allowed[] = {
    SCMP_SYS(brk),          SCMP_SYS(munmap),          SCMP_SYS(mremap),
    SCMP_SYS(madvise),      SCMP_SYS(futex),           SCMP_SYS(clock_gettime),
    SCMP_SYS(gettimeofday), SCMP_SYS(getrandom),       SCMP_SYS(lseek),
    SCMP_SYS(fstat),        SCMP_SYS(close),           SCMP_SYS(exit),
    SCMP_SYS(exit_group),   SCMP_SYS(rt_sigaction),    SCMP_SYS(rt_sigprocmask),
    SCMP_SYS(rt_sigreturn), SCMP_SYS(restart_syscall), SCMP_SYS(getpid),
    SCMP_SYS(gettid),       SCMP_SYS(sched_yield),
};

static const int refused[] = {
    SCMP_SYS(open),      SCMP_SYS(openat),     SCMP_SYS(openat2),
    SCMP_SYS(access),    SCMP_SYS(faccessat),  SCMP_SYS(faccessat2),
    SCMP_SYS(stat),      SCMP_SYS(lstat),      SCMP_SYS(newfstatat),
    SCMP_SYS(statx),     SCMP_SYS(readlink),   SCMP_SYS(readlinkat),
    SCMP_SYS(getcwd),    SCMP_SYS(getdents64), SCMP_SYS(ioctl),
    SCMP_SYS(fcntl),     SCMP_SYS(socket),     SCMP_SYS(read),
    SCMP_SYS(sysinfo),   SCMP_SYS(uname),      SCMP_SYS(sched_getaffinity),
    SCMP_SYS(prlimit64), SCMP_SYS(getrusage),
};

static int add_lists(scmp_filter_ctx filter)
{
    int code = 0;
    for (size_t i = 0; code == 0 && i < COUNT(allowed); i++) {
        code = seccomp_rule_add(filter, SCMP_ACT_ALLOW, allowed[i], 0);
    }
    for (size_t i = 0; code == 0 && i < COUNT(refused); i++) {
        code = seccomp_rule_add(filter, SCMP_ACT_ERRNO(EACCES), refused[i], 0);
    }
    return code;
}

/* Calls that are allowed with some arguments only. */
static int add_conditions(scmp_filter_ctx filter)
{
    static const int writable[] = {STDERR_FILENO, UMBS_CHILD_FD_OUTPUT};
    static const int paging[] = {SCMP_SYS(mmap), SCMP_SYS(mprotect)};
    static const int talking[] = {SCMP_SYS(sendmsg), SCMP_SYS(recvmsg)};
    int code = 0;
    for (size_t i = 0; code == 0 && i < COUNT(writable); i++) {
        code = seccomp_rule_add(filter, SCMP_ACT_ALLOW, SCMP_SYS(write), 1,
                                SCMP_A0(SCMP_CMP_EQ, (scmp_datum_t)writable[i], 0));
    }
    for (size_t i = 0; code == 0 && i < COUNT(paging); i++) {
        code = seccomp_rule_add(filter, SCMP_ACT_ALLOW, paging[i], 1,
                                SCMP_A2(SCMP_CMP_MASKED_EQ, PROT_EXEC, 0));
    }
    for (size_t i = 0; code == 0 && i < COUNT(talking); i++) {
        code = seccomp_rule_add(filter, SCMP_ACT_ALLOW, talking[i], 1,
                                SCMP_A0(SCMP_CMP_EQ, UMBS_CHILD_FD_FILES, 0));
    }
    if (code == 0) { /* abort() */
        code = seccomp_rule_add(filter, SCMP_ACT_ALLOW, SCMP_SYS(tgkill), 1,
                                SCMP_A0(SCMP_CMP_EQ, (scmp_datum_t)getpid(), 0));
    }
    return code;
}

int umbb_filter_enter(void)
{
    scmp_filter_ctx filter = seccomp_init(SCMP_ACT_KILL_PROCESS);
    if (filter == NULL) {
        errno = ENOMEM;
        return 0;
    }
    int code = add_lists(filter);
    if (code == 0) {
        code = add_conditions(filter);
    }
    if (code == 0) {
        code = seccomp_load(filter);
    }
    seccomp_release(filter);
    errno = -code;
    return code == 0;
}

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The list of allowed system calls (sandbox.h), as a program for the kernel's filter machine.
 *
 * Allowed is what the importer was seen to need: memory, the clock, its own end, talk with its
 * parent over the two descriptors it has, the descriptors it was handed. What libraries only try
 * and cope without gets EACCES. Everything else kills the process: it is not the importer that
 * calls it any more.
 *
 * The program is made here, call by call, because it must be whole or not there: libseccomp 2.5.4
 * allocates some 800 times on the way and, where one of them fails, can load a filter that lacks
 * rules (decision 7). Arguments are compared by their low 32 bits, which is all that the kernel
 * takes of descriptors, process numbers and protection bits. Source: seccomp(2), bpf_insn in
 * linux/filter.h.
 */
#define _GNU_SOURCE /* syscall */
#include <errno.h>
#include <linux/audit.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "bake/sandbox/sandbox_parts.h"
#include "common/scene_contract.h"

#if defined(__x86_64__)
#define ARCHITECTURE AUDIT_ARCH_X86_64
#elif defined(__aarch64__)
#define ARCHITECTURE AUDIT_ARCH_AARCH64
#else
#error "the importer's filter knows the system calls of x86-64 and AArch64 only"
#endif

#define COUNT(array) (sizeof(array) / sizeof((array)[0]))
#define REFUSE       (SECCOMP_RET_ERRNO | EACCES)
#define CODE_MAX     256

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

/* A call that is allowed if one argument, masked, has a value. */
struct condition {
    uint16_t call;
    uint8_t argument;
    uint32_t mask, value;
};

/* A program in the making; `count` goes on beyond the room, which shows at the end. */
struct program {
    struct sock_filter code[CODE_MAX];
    size_t count;
};

static void put(struct program *program, struct sock_filter instruction)
{
    if (program->count < CODE_MAX) {
        program->code[program->count] = instruction;
    }
    program->count++;
}

static void put_load(struct program *program, size_t offset)
{
    put(program, (struct sock_filter)BPF_STMT(BPF_LD | BPF_W | BPF_ABS, (uint32_t)offset));
}

/* If the loaded word is `value`, go on; else leave out the next `otherwise` instructions. */
static void put_if(struct program *program, uint32_t value, uint8_t otherwise)
{
    put(program, (struct sock_filter)BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, value, 0, otherwise));
}

static void put_return(struct program *program, uint32_t action)
{
    put(program, (struct sock_filter)BPF_STMT(BPF_RET | BPF_K, action));
}

static void put_calls(struct program *program, const uint16_t *calls, size_t count, uint32_t action)
{
    for (size_t i = 0; i < count; i++) {
        put_if(program, calls[i], 1);
        put_return(program, action);
    }
}

/* Leaves the call's number loaded, as it found it. */
static void put_condition(struct program *program, const struct condition *condition)
{
    put_if(program, condition->call, 5);
    put_load(program, offsetof(struct seccomp_data, args) + 8 * (size_t)condition->argument);
    put(program, (struct sock_filter)BPF_STMT(BPF_ALU | BPF_AND | BPF_K, condition->mask));
    put_if(program, condition->value, 1);
    put_return(program, SECCOMP_RET_ALLOW);
    put_load(program, offsetof(struct seccomp_data, nr));
}

static void build(struct program *program)
{
    const struct condition conditions[] = {
        {SYS_write, 0, UINT32_MAX, STDERR_FILENO},
        {SYS_write, 0, UINT32_MAX, UMBS_CHILD_FD_OUTPUT},
        {SYS_sendmsg, 0, UINT32_MAX, UMBS_CHILD_FD_FILES},
        {SYS_recvmsg, 0, UINT32_MAX, UMBS_CHILD_FD_FILES},
        {SYS_mmap, 2, PROT_EXEC, 0},
        {SYS_mprotect, 2, PROT_EXEC, 0},
        {SYS_tgkill, 0, UINT32_MAX, (uint32_t)getpid()}, /* abort() */
    };
    put_load(program, offsetof(struct seccomp_data, arch));
    put(program, (struct sock_filter)BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, ARCHITECTURE, 1, 0));
    put_return(program, SECCOMP_RET_KILL_PROCESS); /* numbers would mean other calls */
    put_load(program, offsetof(struct seccomp_data, nr));
    put_calls(program, allowed, COUNT(allowed), SECCOMP_RET_ALLOW);
    put_calls(program, refused, COUNT(refused), REFUSE);
    for (size_t i = 0; i < COUNT(conditions); i++) {
        put_condition(program, &conditions[i]);
    }
    put_return(program, SECCOMP_RET_KILL_PROCESS);
}

int umbb_filter_enter(void)
{
    struct program program = {.count = 0};
    build(&program);
    if (program.count > CODE_MAX) {
        errno = E2BIG;
        return 0;
    }
    const struct sock_fprog loaded = {(unsigned short)program.count, program.code};
    return syscall(SYS_seccomp, SECCOMP_SET_MODE_FILTER, 0U, &loaded) == 0;
}

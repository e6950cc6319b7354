/* SPDX-License-Identifier: Apache-2.0 */
/* The instructions behind filter_program.h. */
#define _GNU_SOURCE /* syscall */
#include "bake/sandbox/filter_program.h"

#include <errno.h>
#include <linux/audit.h>
#include <sys/syscall.h>
#include <unistd.h>

#if defined(__x86_64__)
#define ARCHITECTURE AUDIT_ARCH_X86_64
#elif defined(__aarch64__)
#define ARCHITECTURE AUDIT_ARCH_AARCH64
#else
#error "the filters know the system calls of x86-64 and AArch64 only"
#endif

static void put(struct umbb_filter *filter, struct sock_filter instruction)
{
    if (filter->count < UMBB_FILTER_CODE_MAX) {
        filter->code[filter->count] = instruction;
    }
    filter->count++;
}

static void put_load(struct umbb_filter *filter, size_t offset)
{
    put(filter, (struct sock_filter)BPF_STMT(BPF_LD | BPF_W | BPF_ABS, (uint32_t)offset));
}

/* Adds a test: if the loaded word is not `value`, the next `otherwise` instructions are skipped. */
static void put_if(struct umbb_filter *filter, uint32_t value, uint8_t otherwise)
{
    put(filter, (struct sock_filter)BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, value, 0, otherwise));
}

static void put_return(struct umbb_filter *filter, uint32_t action)
{
    put(filter, (struct sock_filter)BPF_STMT(BPF_RET | BPF_K, action));
}

static size_t argument_at(uint8_t argument)
{
    return offsetof(struct seccomp_data, args) + 8 * (size_t)argument;
}

void umbb_filter_begin(struct umbb_filter *filter)
{
    put_load(filter, offsetof(struct seccomp_data, arch));
    put(filter, (struct sock_filter)BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, ARCHITECTURE, 1, 0));
    put_return(filter, SECCOMP_RET_KILL_PROCESS);
    put_load(filter, offsetof(struct seccomp_data, nr));
}

void umbb_filter_calls(struct umbb_filter *filter, const uint16_t *calls, size_t count,
                       uint32_t action)
{
    for (size_t i = 0; i < count; i++) {
        put_if(filter, calls[i], 1);
        put_return(filter, action);
    }
}

/* Leaves the call's number loaded; so does umbb_filter_if_null. */
void umbb_filter_if(struct umbb_filter *filter, const struct umbb_filter_condition *condition)
{
    put_if(filter, condition->call, 5);
    put_load(filter, argument_at(condition->argument));
    put(filter, (struct sock_filter)BPF_STMT(BPF_ALU | BPF_AND | BPF_K, condition->mask));
    put_if(filter, condition->value, 1);
    put_return(filter, SECCOMP_RET_ALLOW);
    put_load(filter, offsetof(struct seccomp_data, nr));
}

void umbb_filter_if_null(struct umbb_filter *filter, uint16_t call, uint8_t argument)
{
    put_if(filter, call, 6);
    put_load(filter, argument_at(argument));
    put_if(filter, 0, 3);
    put_load(filter, argument_at(argument) + 4);
    put_if(filter, 0, 1);
    put_return(filter, SECCOMP_RET_ALLOW);
    put_load(filter, offsetof(struct seccomp_data, nr));
}

int umbb_filter_load(struct umbb_filter *filter, uint32_t otherwise)
{
    put_return(filter, otherwise);
    if (filter->count > UMBB_FILTER_CODE_MAX) {
        errno = E2BIG;
        return 0;
    }
    const struct sock_fprog loaded = {(unsigned short)filter->count, filter->code};
    return syscall(SYS_seccomp, SECCOMP_SET_MODE_FILTER, SECCOMP_FILTER_FLAG_TSYNC, &loaded) == 0;
}

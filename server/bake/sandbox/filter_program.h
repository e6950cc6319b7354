/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_SANDBOX_FILTER_PROGRAM_H
#define UMBRAGE_SERVER_BAKE_SANDBOX_FILTER_PROGRAM_H
/*
 * Programs for the kernel's system call filter, made call by call.
 *
 *     struct umbb_filter filter = {.count = 0};
 *     umbb_filter_begin(&filter);
 *     umbb_filter_calls(&filter, calls, count, SECCOMP_RET_ALLOW);
 *     umbb_filter_if(&filter, &condition);
 *     inside = umbb_filter_load(&filter, SECCOMP_RET_KILL_PROCESS);
 *
 * Why not libseccomp: a filter must be whole or absent. libseccomp 2.5.4 makes some 800 allocations
 * and, if one fails, can load a filter that lacks rules (decision 7). Sources: seccomp(2), bpf_insn
 * in linux/filter.h.
 */
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <stddef.h>
#include <stdint.h>

#define UMBB_FILTER_CODE_MAX 512

/* Program under construction. `count` may grow beyond the size of the array; umbb_filter_load then
 * fails. */
struct umbb_filter {
    struct sock_filter code[UMBB_FILTER_CODE_MAX];
    size_t count;
};

/* Call that is allowed if one argument, masked, has a value. The low 32 bits are compared, because
 * the kernel uses no more of descriptors, process numbers, commands and protection bits. */
struct umbb_filter_condition {
    uint16_t call;
    uint8_t argument;
    uint32_t mask, value;
};

/* Begins a program. Calls of another architecture have other numbers, so they kill the process. */
void umbb_filter_begin(struct umbb_filter *filter);

/* Sets the action of each of these calls: SECCOMP_RET_*. */
void umbb_filter_calls(struct umbb_filter *filter, const uint16_t *calls, size_t count,
                       uint32_t action);

void umbb_filter_if(struct umbb_filter *filter, const struct umbb_filter_condition *condition);

/* Allows a call whose argument is a null pointer: all 64 bits are compared. */
void umbb_filter_if_null(struct umbb_filter *filter, uint16_t call, uint8_t argument);

/* Ends the program with the action for every other call, and loads the program for all threads of
 * the process. Returns 1; or 0 and errno if nothing changed. */
int umbb_filter_load(struct umbb_filter *filter, uint32_t otherwise);

#endif

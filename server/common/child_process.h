/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_COMMON_CHILD_PROCESS_H
#define UMBRAGE_SERVER_COMMON_CHILD_PROCESS_H
/*
 * What all programs that are started here have in common: a near-empty environment, only the
 * descriptors that were agreed, signals as a fresh program expects them, a group of their own that
 * ends with them, and an end with their parent's. Linux only.
 *
 * Between fork and exec only async-signal-safe calls are made, because the caller may have many
 * threads: functions that say "in the child" make no others, and return 0 or -1 with errno.
 * Sources: fork(2), prctl(2), close_range(2), signal-safety(7).
 */
#include <stdint.h>
#include <sys/types.h>

#define UMBS_CHILD_ENVIRONMENT_MAX 8

/* The few variables that a program may see: where libraries are, how a sanitizer behaves; "C" is
 * its locale. NULL ends them. */
void umbs_child_environment(char *chosen[UMBS_CHILD_ENVIRONMENT_MAX]);

/* In the child: a process group of its own, and death with the parent's thread. In: parent: whom
 * the child must still have then. */
int umbs_child_own_group(pid_t parent);

/* In the child: sources[i] becomes descriptor i, for each i < count; -1: /dev/null. All others are
 * closed. Sources are parked out of the way first: a parent without standard streams has them among
 * these. In: count: at most 10. */
int umbs_child_lay_out(int *sources, int count);

/* In the child: setrlimit, but never above what we have ourselves, which would fail. */
int umbs_child_limit(int resource, uint64_t soft, uint64_t hard);

/* In the child: no signal is blocked, ignored or handled. */
int umbs_child_reset_signals(void);

/* 1 once the child has ended. Leaves it a zombie, so that its number, which is its group's too,
 * cannot be another's yet. */
int umbs_child_has_ended(pid_t child);

/* Kills the child's group, whatever it may have started, and takes its status; 0 if that is lost
 * (SIGCHLD is ignored here). Cost: waits for the child's end. */
int umbs_child_reap(pid_t child, int *exit_code, int *signal);

/* Closes a descriptor unless it is -1, which it is then. */
void umbs_hang_up(int *fd);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_COMMON_CHILD_PROCESS_H
#define UMBRAGE_SERVER_COMMON_CHILD_PROCESS_H
/*
 * Child processes of all server programs. A child has a near-empty environment, only the agreed
 * descriptors, default signals, and a process group that ends with it. A child dies when its parent
 * does. Linux only.
 *
 * Between fork and exec only async-signal-safe calls are made, because the caller may have many
 * threads. Functions marked "in the child" obey this rule, and return 0 or -1 with errno.
 * Sources: fork(2), prctl(2), close_range(2), signal-safety(7).
 */
#include <stdint.h>
#include <sys/types.h>

#define UMBS_CHILD_ENVIRONMENT_MAX 8

/* Chooses the environment of a child: the locale "C", the path of shared libraries, and the options
 * of a sanitizer. A NULL ends the list. */
void umbs_child_environment(char *chosen[UMBS_CHILD_ENVIRONMENT_MAX]);

/* In the child: makes a process group, and has the kernel kill the child when the parent's thread
 * ends. In: parent: the expected process id of the parent. */
int umbs_child_own_group(pid_t parent);

/* In the child: makes sources[i] descriptor i, for each i < count; -1 stands for /dev/null. All
 * other descriptors are closed. Sources may have numbers below count, if the parent has no standard
 * streams. They are first moved to higher numbers. In: count: at most 10. */
int umbs_child_lay_out(int *sources, int count);

/* In the child: setrlimit, capped at this process's own limit, because a higher value would
 * fail. */
int umbs_child_limit(int resource, uint64_t soft, uint64_t hard);

/* In the child: resets all signals: none is blocked, ignored or handled. */
int umbs_child_reset_signals(void);

/* Returns 1 once the child has ended. The child stays a zombie, so its number, which also names its
 * process group, cannot be given to another process yet. */
int umbs_child_has_ended(pid_t child);

/* Kills the child's process group and reaps the child. Returns its status; 0 if the status is lost
 * because this process ignores SIGCHLD. Cost: waits for the child's end. */
int umbs_child_reap(pid_t child, int *exit_code, int *signal);

/*
 * Opens /dev/null in place of each closed standard descriptor. Otherwise the next file or socket
 * would get that number: printed text would go into it, and libuv ends the process when it closes
 * it. Without a /dev/null nothing changes. Call this function before anything else is opened.
 */
void umbs_standard_streams_open(void);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_COMMON_CHILD_PROCESS_H
#define UMBRAGE_SERVER_COMMON_CHILD_PROCESS_H
/*
 * Child processes, as all programs of the server start them: a near-empty environment, only the
 * agreed descriptors, default signals, and a process group of their own that ends with them. A
 * child dies when its parent does. Linux only.
 *
 * Between fork and exec only async-signal-safe calls are made, because the caller may have many
 * threads. Functions marked "in the child" keep to that, and return 0 or -1 with errno.
 * Sources: fork(2), prctl(2), close_range(2), signal-safety(7).
 */
#include <stdint.h>
#include <sys/types.h>

#define UMBS_CHILD_ENVIRONMENT_MAX 8

/* Chooses the few variables that a program may see: where libraries are, and how a sanitizer
 * behaves. Its locale is "C". A NULL ends the list. */
void umbs_child_environment(char *chosen[UMBS_CHILD_ENVIRONMENT_MAX]);

/* In the child: makes a process group of its own, and has the child die with the parent's thread.
 * In: parent: process id that must still be the parent's. */
int umbs_child_own_group(pid_t parent);

/* In the child: makes sources[i] descriptor i, for each i < count; -1 stands for /dev/null. All
 * others are closed. Sources are parked out of the way first: a parent without standard streams may
 * have them among these numbers. In: count: at most 10. */
int umbs_child_lay_out(int *sources, int count);

/* In the child: setrlimit, capped at this process's own limit, because more would fail. */
int umbs_child_limit(int resource, uint64_t soft, uint64_t hard);

/* In the child: resets all signals: none is blocked, ignored or handled. */
int umbs_child_reset_signals(void);

/* 1 once the child has ended. Leaves it a zombie, so that its number, which is also its group's,
 * cannot be given to another process yet. */
int umbs_child_has_ended(pid_t child);

/* Kills the child's group with all that it started, and takes its status; 0 if the status is lost
 * (SIGCHLD is ignored here). Cost: waits for the child's end. */
int umbs_child_reap(pid_t child, int *exit_code, int *signal);

/* Closes a descriptor, unless it is -1, and sets it to -1. */
void umbs_hang_up(int *fd);

/*
 * Opens /dev/null in place of each closed standard descriptor. Without this the next file or socket
 * would get that number and all printed text; libuv ends the process when it closes one of them.
 * Without a /dev/null nothing changes. Call it before anything else is opened.
 */
void umbs_standard_streams_open(void);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_BASE_INTERRUPT_H
#define UMBRAGE_SERVER_BAKE_BASE_INTERRUPT_H
/*
 * SIGINT, SIGTERM, SIGHUP, SIGQUIT and SIGXCPU (the limit of CPU time) end a bake in order, with
 * the exit code of E_CANCELLED. While there is nothing to clean up, a signal ends the process at
 * once. After umbb_interrupt_defer a signal sets a flag that long work checks, so that the
 * temporary file is removed. Another signal more than a second later ends the process as usual. A
 * signal that was ignored when the program started (nohup) stays ignored.
 */

/* Installs the handlers, and makes a write to a closed pipe, or beyond the file size limit, fail
 * with an error instead of a signal. */
void umbb_interrupt_install(void);

/* From now on a signal only sets the flag. */
void umbb_interrupt_defer(void);

/* 1 after a caught signal. Threads: any. */
int umbb_interrupted(void);

#endif

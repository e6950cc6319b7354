/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_INTERRUPT_H
#define UMBRAGE_SERVER_BAKE_INTERRUPT_H
/*
 * SIGINT, SIGTERM, SIGHUP, SIGQUIT and SIGXCPU (the limit of CPU time) end a bake in order, with
 * the exit code of E_CANCELLED. While there is nothing to clean up they do so at once; from
 * umbb_interrupt_defer on they set a flag that long work looks at, so that the temporary file goes.
 * Another signal more than a second later ends the process as usual.
 * A signal that was ignored when the program started (nohup) stays so.
 */

/* Catches the signals from now on, and makes writing to a closed pipe or beyond the file size limit
 * an error of that write. */
void umbb_interrupt_install(void);

/* From now on a signal only sets the flag. */
void umbb_interrupt_defer(void);

/* 1 after a caught signal. Threads: any. */
int umbb_interrupted(void);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_INTERRUPT_H
#define UMBRAGE_SERVER_BAKE_INTERRUPT_H
/*
 * SIGINT and SIGTERM as a flag that long work looks at, so that the bake ends in order: temporary
 * file removed, exit code of E_CANCELLED. A second signal ends the process at once.
 */

/* Catches the two signals from now on. */
void umbb_interrupt_install(void);

/* 1 after a caught signal. Threads: any. */
int umbb_interrupted(void);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STORE_FAULT_GUARD_H
#define UMBRAGE_SERVER_STORE_FAULT_GUARD_H
/*
 * Guarded reads of mapped files that other processes may cut or overwrite meanwhile.
 *
 * Reading a page beyond the end of its file, or a page that the disk cannot deliver, raises SIGBUS
 * in the reading thread. Reading an unmapped address raises SIGSEGV. Inside umbs_fault_guarded such
 * a fault within the given range ends only the reading function, and the caller is told. Every
 * other fault is handled as if the guard did not exist.
 *
 * The handler leaves the reading function by siglongjmp. So that function must hold no lock, own no
 * memory and no descriptor, and may call only functions with the same restrictions, such as a query
 * kernel.
 *
 * Threads: any number at once, each with its own range; guards do not nest.
 * Cost:  10 ns for each guarded call (one sigsetjmp that saves no mask), 10 us for a fault.
 */
#include <stddef.h>

/* Installs the handlers of SIGBUS and SIGSEGV, unless they are installed. An earlier handler, such
 * as a sanitizer's, still gets every fault outside the guarded ranges. */
void umbs_fault_guard_install(void);

/*
 * Calls read(user). Returns 1 if read returned normally; 0 if it touched memory of [begin, begin +
 * bytes) that could not be read. Data written before the fault stays. Call umbs_fault_guard_install
 * first.
 */
int umbs_fault_guarded(const void *begin, size_t bytes, void (*read)(void *user), void *user);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STORE_FAULT_GUARD_H
#define UMBRAGE_SERVER_STORE_FAULT_GUARD_H
/*
 * Reading mapped files that other processes may cut or overwrite meanwhile.
 *
 * Reading a page beyond the end of its file, or one that the disk cannot deliver, raises SIGBUS in
 * the reading thread; reading an unmapped address raises SIGSEGV. Inside umbs_fault_guarded such a
 * fault within the given range ends the reading function only: the caller learns of it and goes on.
 * Every other fault is handled as if the guard did not exist.
 *
 * The handler leaves the reading function by siglongjmp. So that function must hold no lock, own no
 * memory and no descriptor, and may call only functions of the same kind, such as a query kernel.
 *
 * Threads: any number at once, each with its own range; guards do not nest.
 * Cost: 10 ns a guarded call (one sigsetjmp that saves no mask), 10 us for a fault.
 */
#include <stddef.h>

/* Installs the handlers of SIGBUS and SIGSEGV, unless they are installed. An earlier handler (of a
 * sanitizer, say) still gets every fault outside the guarded ranges. */
void umbs_fault_guard_install(void);

/*
 * Calls read(user). Returns 1 if it returned normally, 0 if it touched memory of [begin, begin +
 * bytes) that could not be read; what it had written by then stays. Call umbs_fault_guard_install
 * first.
 */
int umbs_fault_guarded(const void *begin, size_t bytes, void (*read)(void *user), void *user);

#endif

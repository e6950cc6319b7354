/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STORE_FAULT_GUARD_H
#define UMBRAGE_SERVER_STORE_FAULT_GUARD_H
/*
 * Reading mapped files that others may cut or overwrite meanwhile.
 *
 * A page of a mapping that lies beyond the end of its file, or that the disk cannot give, raises
 * SIGBUS in whoever reads it; an address that nothing is mapped at raises SIGSEGV. Inside
 * umbs_fault_guarded such a fault within the given range ends the reading function and nothing
 * else: the caller learns of it and goes on. Every other fault is handled as if this did not exist.
 *
 * The handler leaves the reading function by siglongjmp. So that function must hold no lock, own no
 * memory and no descriptor, and may call nothing that does: a query kernel is of that kind.
 *
 * Threads: any number at once, each with its own range; guards do not nest.
 * Cost: 10 ns a guarded call (one sigsetjmp that saves no mask), 10 us for a fault.
 */
#include <stddef.h>

/* Has SIGBUS and SIGSEGV come here first, if they do not yet. An earlier handler (of a sanitizer,
 * say) goes on getting what is not ours. */
void umbs_fault_guard_install(void);

/*
 * Calls read(user). Returns 1 if it came to its end, 0 if it touched memory of
 * [begin, begin + bytes) that could not be read; what it had written until then stays. The guard
 * must have been installed.
 */
int umbs_fault_guarded(const void *begin, size_t bytes, void (*read)(void *user), void *user);

#endif

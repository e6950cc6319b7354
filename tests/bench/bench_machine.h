/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_BENCH_MACHINE_H
#define UMBRAGE_TESTS_BENCH_MACHINE_H
/* What a fair race needs from the machine: one core, large pages. */
#include <stddef.h>

#define BENCH_PIN_ALL (~0U)

/*
 * Binds the calling thread, and the threads that it starts later, to the n-th core that the process
 * may use (modulo their number); BENCH_PIN_ALL sets it free again. Returns 1, or 0 if the system
 * refuses.
 */
int bench_pin(unsigned n);

/* Allocates zeroed memory, in large pages where the system has them. Ends the program if memory is
 * short. Free the result with free(). */
void *bench_large(size_t bytes);

#endif

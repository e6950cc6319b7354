/* SPDX-License-Identifier: Apache-2.0 */
/* One core, large pages; see bench_machine.h. */
#define _GNU_SOURCE /* sched_setaffinity, madvise: no POSIX names for these */
#include "bench_machine.h"

#include <sched.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include "bench_report.h"

#define LARGE_PAGE ((size_t)2 << 20)

/* The cores the process may use, before any pinning. */
static cpu_set_t allowed;
static int allowed_known;

int bench_pin(unsigned n)
{
    if (!allowed_known && sched_getaffinity(0, sizeof allowed, &allowed) != 0) {
        return 0;
    }
    allowed_known = 1;
    if (n == BENCH_PIN_ALL) {
        return sched_setaffinity(0, sizeof allowed, &allowed) == 0;
    }
    const int count = CPU_COUNT(&allowed);
    int left = count > 0 ? (int)(n % (unsigned)count) : -1;
    for (size_t cpu = 0; cpu < CPU_SETSIZE && left >= 0; cpu++) {
        if (CPU_ISSET(cpu, &allowed) && left-- == 0) {
            cpu_set_t one;
            CPU_ZERO(&one);
            CPU_SET(cpu, &one);
            return sched_setaffinity(0, sizeof one, &one) == 0;
        }
    }
    return 0;
}

void *bench_large(size_t bytes)
{
    void *memory = NULL;
    if (posix_memalign(&memory, LARGE_PAGE, bytes) != 0) {
        bench_fail("%zu bytes refused", bytes);
    }
    (void)madvise(memory, bytes, MADV_HUGEPAGE); /* a wish: small pages are slower, not wrong */
    memset(memory, 0, bytes);
    return memory;
}

/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_INSTRUCTIONS_H
#define UMBRAGE_SERVER_STUDY_INSTRUCTIONS_H
/*
 * Instructions of the calling thread in user space, counted by the processor (perf_event_open).
 * Equal work takes equal counts, however busy the machine is. Virtual machines and containers often
 * have no counter or do not allow it.
 */
#include <stddef.h>
#include <stdint.h>

/* Opens the counter. Returns a descriptor for close(); -1: `reason` says why there is none. */
int umbt_instructions_open(char *reason, size_t size);

/* Returns the count since the counter was opened; 0 for -1. */
uint64_t umbt_instructions_read(int counter);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_FUZZ_H
#define UMBRAGE_TESTS_FUZZ_H
/* What every fuzz target shares: the entry point that libFuzzer and the replayer call. */
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

/* Feeds one input; returns 0. */
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

/* A property that must hold whatever the input. */
#define FUZZ_DEMAND(condition)                                                                     \
    do {                                                                                           \
        if (!(condition)) {                                                                        \
            (void)fprintf(stderr, "%s:%d: %s\n", __FILE__, __LINE__, #condition);                  \
            abort();                                                                               \
        }                                                                                          \
    } while (0)

#endif

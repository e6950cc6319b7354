/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_BENCH_PEER_WORK_H
#define UMBRAGE_TESTS_BENCH_PEER_WORK_H
/*
 * The work of every server in a race apart from its protocol: it checks the points, and prepares
 * and runs the library's query on one asset. So the races differ by protocol alone.
 */
#include <stddef.h>
#include <stdint.h>
#include "umbrage/query.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Opens the asset; ends the program if it cannot. */
struct umb_asset *peer_asset(const char *path);

/* Answers count points with one byte each, one tap, no bias. Returns 0 if they are bad. */
int peer_answer(const struct umb_asset *asset, const void *points, size_t count, uint8_t *values);

/* Opens a listening socket on a free port of 127.0.0.1, and prints the port on stdout. */
int peer_listen(void);

/* Says the port. */
void peer_say_port(int port);

#ifdef __cplusplus
}
#endif
#endif

/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_BENCH_BENCH_PROTOCOL_H
#define UMBRAGE_TESTS_BENCH_BENCH_PROTOCOL_H
/*
 * Races of protocols: the CPU time of the server process for a request is compared between
 * umbraged, gRPC's C++ library and bare frames, all doing the same work for the same client
 * (bench_caller.h).
 */
#include <sys/types.h>

struct protocol_race {
    const char *asset; /* path of a packed asset, which the daemon knows as `name` */
    const char *name;
    const char *peers; /* folder of peer_raw and peer_grpcpp */
    pid_t daemon;
    unsigned daemon_port;
};

/* Runs all rows; a peer that is not built is named and its rows are left out. */
void protocol_races_run(const struct protocol_race *race);

#endif

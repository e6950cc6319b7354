/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_BENCH_BENCH_CALLER_H
#define UMBRAGE_TESTS_BENCH_BENCH_CALLER_H
/*
 * One client for all servers of a race: 4 connections, 8 requests under way on each, the same
 * request again and again. It checks every status, and every byte of the first replies.
 */
#include <stddef.h>
#include <stdint.h>

#define CALLER_CONNECTIONS 4
#define CALLER_UNDER_WAY   8

enum caller_protocol {
    CALLER_UNARY,  /* gRPC, a call for each request */
    CALLER_STREAM, /* gRPC, one QueryStream a connection */
    CALLER_RAW,    /* peer_raw.c */
};

struct caller_job {
    enum caller_protocol protocol;
    uint16_t port;          /* on 127.0.0.1 */
    const uint8_t *message; /* a QueryRequest */
    size_t message_size;
    const uint8_t *values; /* the answers that every reply must have */
    size_t value_bytes;
    size_t calls;
};

/* Does the calls; ends the program if one fails. */
void caller_run(const struct caller_job *job);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_BASE_TOKENS_H
#define UMBRAGE_SERVER_DAEMON_BASE_TOKENS_H
/*
 * Bearer tokens: the rights and rates of callers.
 *
 * The file has a line for each token: NAME SCOPES TOKEN [POINTS_PER_SECOND]. SCOPES is a
 * comma-separated list of query, submit, admin. A `#` after a blank begins a comment; elsewhere it
 * is refused. Only hashes are kept. Each call compares all of them, so the time reveals nothing.
 *
 * Threads: all functions from any thread. A set is immutable and reference-counted: the holder of a
 * set keeps its tokens across a reload.
 */
#include <stdatomic.h>
#include <stddef.h>
#include <stdint.h>
#include "umbrage/status.h"

#define UMBD_TOKEN_NAME_SIZE 64
#define UMBD_TOKEN_MIN       16 /* characters; `openssl rand -hex 32` gives 64 */
#define UMBD_TOKENS_MAX      1024
#define UMBD_HASH_BYTES      32

enum umbd_scope {
    UMBD_SCOPE_NONE = 0, /* Every caller may: health */
    UMBD_SCOPE_QUERY = 1,
    UMBD_SCOPE_SUBMIT = 2,
    UMBD_SCOPE_ADMIN = 4,
};

struct umbd_token {
    char name[UMBD_TOKEN_NAME_SIZE];
    unsigned scopes; /* Sum of enum umbd_scope */
    uint8_t hash[UMBD_HASH_BYTES];
    uint64_t points_per_second; /* Rate of its caller, 0 = no limit */
    atomic_uint_fast64_t paid_until_ns;
};

struct umbd_token_set; /* opaque */
struct umbd_tokens;    /* opaque: the set in use */

/* Reads a token file. Fails: E_NO_INPUT, E_PERMISSION (others may read the file), E_ARGUMENT naming
 * the line, E_NO_MEMORY. path must live as long as the object. */
UMB_CHECKED enum umb_status umbd_tokens_create(const char *path, struct umbd_tokens **out,
                                               struct umb_error *error);
void umbd_tokens_destroy(struct umbd_tokens *tokens);

/* Reads the file again; on failure the old tokens stay. */
UMB_CHECKED enum umb_status umbd_tokens_reload(struct umbd_tokens *tokens, struct umb_error *error);

/* Returns a number that grows with every reload; a set with a lower number is out of date. Cost:
 * one atomic read. */
unsigned umbd_tokens_generation(const struct umbd_tokens *tokens);

/* The set in use, counted. _release: NULL is allowed. */
struct umbd_token_set *umbd_tokens_acquire(struct umbd_tokens *tokens);
void umbd_token_set_release(struct umbd_token_set *set);

/* The token with that hash, or NULL; valid as long as the set. */
struct umbd_token *umbd_token_find(struct umbd_token_set *set, const uint8_t hash[UMBD_HASH_BYTES]);

#endif

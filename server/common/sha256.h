/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_COMMON_SHA256_H
#define UMBRAGE_SERVER_COMMON_SHA256_H
/* SHA-256 in the form that the core expects: single messages by OpenSSL, many at once in lanes. */
#include <openssl/sha.h>
#include "format/content.h"

/* SHA-256 functions for the core, for use from any thread. Digests cannot fail. */
extern const struct umb_sha256 umbs_sha256;

/* Digest of one buffer. */
void umbs_sha256_bytes(const void *bytes, size_t size, uint8_t out[UMB_ID_BYTES]);

/* Digest of bytes in pieces: call begin, then add any number of times, then end. */
struct umbs_sha256_run {
    SHA256_CTX context;
};

void umbs_sha256_begin(struct umbs_sha256_run *run);
void umbs_sha256_add(struct umbs_sha256_run *run, const void *bytes, size_t size);
void umbs_sha256_end(struct umbs_sha256_run *run, uint8_t out[UMB_ID_BYTES]);

/*
 * The chain: a digest of any amount of data that does not keep the data. Each block of equal size
 * is hashed together with the previous digest. The result is not the plain SHA-256 of the data, but
 * as hard to forge. Call init, then add any number of times, then end.
 */

#define UMBS_CHAIN_BLOCK ((size_t)18432) /* 256 triangles of nine doubles */

struct umbs_chain {
    uint8_t digest[UMB_ID_BYTES]; /* digest of all blocks before */
    size_t used;                  /* bytes used in block */
    uint8_t block[UMBS_CHAIN_BLOCK];
};

void umbs_chain_init(struct umbs_chain *chain);
void umbs_chain_add(struct umbs_chain *chain, const void *bytes, size_t count);

/* Hashes the rest of the data and writes the digest. Initialise the chain again before another
 * use. */
void umbs_chain_end(struct umbs_chain *chain, uint8_t digest[UMB_ID_BYTES]);

#define UMBS_KEY_BYTES 32U

/* HMAC-SHA256 (RFC 2104) of one buffer: only a holder of the key can make it. */
void umbs_hmac_sha256(const uint8_t key[UMBS_KEY_BYTES], const void *bytes, size_t size,
                      uint8_t out[UMB_ID_BYTES]);

/* 1 if two digests are equal; the time does not depend on the bytes. */
int umbs_digest_equal(const uint8_t a[UMB_ID_BYTES], const uint8_t b[UMB_ID_BYTES]);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_COMMON_SHA256_CHAIN_H
#define UMBRAGE_SERVER_COMMON_SHA256_CHAIN_H
/*
 * A digest of any amount of data that does not keep the data: each block of equal size is hashed
 * together with the previous digest. The result is not the plain SHA-256 of the data, but as hard
 * to forge.
 *
 *     umbs_chain_init(&chain);
 *     umbs_chain_add(&chain, bytes, count);    any number of times
 *     umbs_chain_end(&chain, digest);
 */
#include <stddef.h>
#include "common/sha256.h"

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

#endif

/* SPDX-License-Identifier: Apache-2.0 */
/* The chain: digest = SHA-256(digest before, block). */
#include "common/sha256_chain.h"

#include <string.h>

/* Hashes the block's content into the chain. */
static void flush(struct umbs_chain *chain)
{
    const void *const parts[] = {chain->digest, chain->block};
    const size_t sizes[] = {sizeof chain->digest, chain->used};
    uint8_t next[UMB_ID_BYTES];
    umbs_sha256.digest(umbs_sha256.user, parts, sizes, 2, next);
    memcpy(chain->digest, next, sizeof next);
    chain->used = 0;
}

void umbs_chain_init(struct umbs_chain *chain)
{
    memset(chain->digest, 0, sizeof chain->digest);
    chain->used = 0;
}

void umbs_chain_add(struct umbs_chain *chain, const void *bytes, size_t count)
{
    const uint8_t *from = bytes;
    while (count > 0) {
        const size_t room = UMBS_CHAIN_BLOCK - chain->used, part = count < room ? count : room;
        memcpy(chain->block + chain->used, from, part);
        chain->used += part;
        from += part;
        count -= part;
        if (chain->used == UMBS_CHAIN_BLOCK) {
            flush(chain);
        }
    }
}

void umbs_chain_end(struct umbs_chain *chain, uint8_t digest[UMB_ID_BYTES])
{
    flush(chain);
    memcpy(digest, chain->digest, UMB_ID_BYTES);
}

/* SPDX-License-Identifier: Apache-2.0 */
/* In place of nanovdb_peer.cc where the library is not installed. */
#include "study/nanovdb_peer.h"

int umbt_nanovdb_is_built(void)
{
    return 0;
}

struct umbt_nanovdb *umbt_nanovdb_make(uint32_t log2_size, const double world[3][4],
                                       umbt_nanovdb_block_fn block, const void *user)
{
    (void)log2_size;
    (void)world;
    (void)block;
    (void)user;
    return NULL;
}

void umbt_nanovdb_destroy(struct umbt_nanovdb *peer)
{
    (void)peer;
}

size_t umbt_nanovdb_bytes(const struct umbt_nanovdb *peer)
{
    (void)peer;
    return 0;
}

void umbt_nanovdb_run(const struct umbt_nanovdb_query *query)
{
    (void)query;
}

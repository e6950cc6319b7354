/* SPDX-License-Identifier: Apache-2.0 */
/* Token bucket and header budget. Both use integers, so rounding neither loses nor makes tokens. */
#include "daemon/transport/h2_guard.h"

void umbd_bucket_init(struct umbd_bucket *bucket, uint32_t burst, uint32_t per_second,
                      uint64_t now_ns)
{
    bucket->token_ns = (uint64_t)1000000000 / (per_second > 0 ? per_second : 1);
    bucket->burst_ns = bucket->token_ns * burst;
    bucket->tokens_ns = bucket->burst_ns;
    bucket->last_ns = now_ns;
}

static void add(struct umbd_bucket *bucket, uint64_t ns)
{
    uint64_t room = bucket->burst_ns - bucket->tokens_ns;
    bucket->tokens_ns += ns < room ? ns : room;
}

int umbd_bucket_take(struct umbd_bucket *bucket, uint64_t now_ns)
{
    if (now_ns > bucket->last_ns) {
        add(bucket, now_ns - bucket->last_ns);
        bucket->last_ns = now_ns;
    }
    if (bucket->tokens_ns < bucket->token_ns) {
        return 0;
    }
    bucket->tokens_ns -= bucket->token_ns;
    return 1;
}

void umbd_bucket_credit(struct umbd_bucket *bucket, uint32_t tokens)
{
    add(bucket, bucket->token_ns * tokens);
}

int umbd_header_take(struct umbd_header_budget *budget, size_t name_bytes, size_t value_bytes)
{
    if (budget->fields >= UMBD_HEADER_FIELDS_MAX || name_bytes > UMBD_HEADER_BYTES_MAX ||
        value_bytes > UMBD_HEADER_BYTES_MAX) {
        return 0;
    }
    uint32_t bytes = (uint32_t)(name_bytes + value_bytes) + 32;
    if (bytes > UMBD_HEADER_BYTES_MAX - budget->bytes) {
        return 0;
    }
    budget->fields++;
    budget->bytes += bytes;
    return 1;
}

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * SHA-256 by OpenSSL, in the shape the core asks for; many messages at once by sha256_lanes.h.
 *
 * The low-level functions: they allocate nothing and cannot fail, whereas the EVP interface sets
 * itself up at the first digest and, if memory is short just then, fails for ever after or crashes
 * (OpenSSL 3.0; found by tests/fault). They are marked as old, not as going away.
 */
#define OPENSSL_API_COMPAT 0x10100000L
#include "common/sha256.h"

#include <openssl/sha.h>

#include "common/sha256_lanes.h"

static void digest_parts(void *user, const void *const *parts, const size_t *sizes,
                         size_t part_count, uint8_t out[UMB_ID_BYTES])
{
    (void)user;
    SHA256_CTX context;
    (void)SHA256_Init(&context);
    for (size_t i = 0; i < part_count; i++) {
        if (sizes[i] > 0) {
            (void)SHA256_Update(&context, parts[i], sizes[i]);
        }
    }
    (void)SHA256_Final(out, &context);
}

/* With fewer messages most lanes would be idle. */
#define LANES_FROM 4U

static void digest_many(void *user, const uint8_t *const *messages, const size_t *sizes,
                        size_t count, uint8_t (*digests)[UMB_ID_BYTES])
{
    const umbs_sha256_lanes_fn lanes = umbs_sha256_lanes_avx512();
    if (lanes != NULL && count >= LANES_FROM) {
        lanes(messages, sizes, count, digests);
        return;
    }
    for (size_t i = 0; i < count; i++) {
        const void *parts[1] = {messages[i]};
        digest_parts(user, parts, &sizes[i], 1, digests[i]);
    }
}

const struct umb_sha256 umbs_sha256 = {
    .digest = digest_parts, .user = NULL, .digest_many = digest_many};

void umbs_sha256_bytes(const void *bytes, size_t size, uint8_t out[UMB_ID_BYTES])
{
    const void *parts[1] = {bytes};
    digest_parts(NULL, parts, &size, 1, out);
}

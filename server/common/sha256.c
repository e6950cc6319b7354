/* SPDX-License-Identifier: Apache-2.0 */
/*
 * SHA-256 by OpenSSL, in the shape the core asks for.
 *
 * The low-level functions: they allocate nothing and cannot fail, whereas the EVP interface sets
 * itself up at the first digest and, if memory is short just then, fails for ever after or crashes
 * (OpenSSL 3.0; found by tests/fault). They are marked as old, not as going away.
 */
#define OPENSSL_API_COMPAT 0x10100000L
#include "common/sha256.h"

#include <openssl/sha.h>

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

const struct umb_sha256 umbs_sha256 = {.digest = digest_parts, .user = NULL};

void umbs_sha256_bytes(const void *bytes, size_t size, uint8_t out[UMB_ID_BYTES])
{
    const void *parts[1] = {bytes};
    digest_parts(NULL, parts, &size, 1, out);
}

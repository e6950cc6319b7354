/* SPDX-License-Identifier: Apache-2.0 */
/*
 * SHA-256 through OpenSSL's low-level functions: they allocate nothing and cannot fail. The EVP
 * interface sets itself up at the first digest and, if memory is short just then, fails for ever
 * after or crashes (OpenSSL 3.0; found by tests/fault).
 */
#define OPENSSL_API_COMPAT 0x10100000L
#include "umbrage/region.h"

#include <openssl/sha.h>

static void digest(void *user, const void *const *parts, const size_t *sizes, size_t part_count,
                   uint8_t out[UMB_ID_BYTES])
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

const struct umb_sha256 *umb_sha256_openssl(void)
{
    static const struct umb_sha256 sha256 = {.digest = digest};
    return &sha256;
}

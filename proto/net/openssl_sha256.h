/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_NET_OPENSSL_SHA256_H
#define UMBRAGE_NET_OPENSSL_SHA256_H
/*
 * SHA-256 through OpenSSL's low-level functions, which allocate nothing and cannot fail. The EVP
 * interface initialises at the first digest. If memory is short at that moment, EVP fails from then
 * on or crashes (OpenSSL 3.0; found by tests/fault). The low-level functions are deprecated, but no
 * release has announced their removal. Include this header before all others of OpenSSL.
 */
#define OPENSSL_API_COMPAT 0x10100000L
#include <openssl/sha.h>
#include <stddef.h>
#include <stdint.h>

/* Digests parts one after another. The function is a member `digest` of struct umb_sha256. */
static inline void umbn_sha256(void *user, const void *const *parts, const size_t *sizes,
                               size_t part_count, uint8_t out[SHA256_DIGEST_LENGTH])
{
    SHA256_CTX context;
    (void)user;
    (void)SHA256_Init(&context);
    for (size_t i = 0; i < part_count; i++) {
        if (sizes[i] > 0) {
            (void)SHA256_Update(&context, parts[i], sizes[i]);
        }
    }
    (void)SHA256_Final(out, &context);
}

#endif

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * SHA-256 through OpenSSL's EVP interface. The core's interface cannot report a failure, and there
 * is none to expect but lack of memory; a digest that could not be made is all zeros, which no
 * comparison with a real identity accepts.
 */
#include "rpc_sha256.h"

#include <openssl/evp.h>
#include <string.h>

static void digest(void *user, const void *const *parts, const size_t *sizes, size_t part_count,
                   uint8_t out[UMB_ID_BYTES])
{
    (void)user;
    unsigned length = 0;
    memset(out, 0, UMB_ID_BYTES);
    EVP_MD_CTX *context = EVP_MD_CTX_new();
    int good = context != NULL && EVP_DigestInit_ex(context, EVP_sha256(), NULL) == 1;
    for (size_t i = 0; good && i < part_count; i++) {
        good = EVP_DigestUpdate(context, parts[i], sizes[i]) == 1;
    }
    if (!good || EVP_DigestFinal_ex(context, out, &length) != 1) {
        memset(out, 0, UMB_ID_BYTES);
    }
    EVP_MD_CTX_free(context);
}

const struct umb_sha256 umb__client_sha256 = {.digest = digest, .user = NULL};

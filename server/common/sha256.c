/* SPDX-License-Identifier: Apache-2.0 */
/*
 * SHA-256 by OpenSSL's EVP interface, in the shape the core asks for.
 *
 * The core's hasher cannot fail, so an OpenSSL that cannot make a context or lacks SHA-256 (a
 * broken installation, or no memory for a few hundred bytes) ends in an all-zero digest, which
 * never equals an identity: the caller's comparison then refuses the asset instead of trusting it.
 */
#include "common/sha256.h"

#include <string.h>

#include <openssl/evp.h>

static void digest_parts(void *user, const void *const *parts, const size_t *sizes,
                         size_t part_count, uint8_t out[UMB_ID_BYTES])
{
    (void)user;
    unsigned length = 0;
    memset(out, 0, UMB_ID_BYTES);
    EVP_MD_CTX *context = EVP_MD_CTX_new();
    if (context == NULL) {
        return;
    }
    int good = EVP_DigestInit_ex(context, EVP_sha256(), NULL);
    for (size_t i = 0; good == 1 && i < part_count; i++) {
        if (sizes[i] > 0) {
            good = EVP_DigestUpdate(context, parts[i], sizes[i]);
        }
    }
    if (good == 1) {
        good = EVP_DigestFinal_ex(context, out, &length);
    }
    if (good != 1 || length != UMB_ID_BYTES) {
        memset(out, 0, UMB_ID_BYTES);
    }
    EVP_MD_CTX_free(context);
}

const struct umb_sha256 umbs_sha256 = {.digest = digest_parts, .user = NULL};

void umbs_sha256_bytes(const void *bytes, size_t size, uint8_t out[UMB_ID_BYTES])
{
    const void *parts[1] = {bytes};
    digest_parts(NULL, parts, &size, 1, out);
}

/* SPDX-License-Identifier: Apache-2.0 */
/* SHA-256 by OpenSSL, in the form that the core expects. If the build has sha256_lanes.h, many
 * messages at once are hashed by it; OpenSSL hashes them if the lanes fail. */
#include "net/openssl_sha256.h"

#include "common/sha256.h"

#include <openssl/crypto.h>
#include <pthread.h>
#include <string.h>

#include "common/sha256_lanes.h"

/* Smallest number of messages for the lanes; with fewer, most lanes would be idle (measured: eight
 * messages are far faster in lanes, two are not). */
#define LANES_FROM 4U

/* Most idle sets of lanes kept for later callers. Each thread that hashes at the same time uses a
 * set. */
#define IDLE_MOST 16U

static struct {
    pthread_mutex_t lock;
    struct umbs_sha256_lanes *lanes[IDLE_MOST];
    unsigned count;
} idle = {.lock = PTHREAD_MUTEX_INITIALIZER};

/* Takes idle lanes; NULL if there are none. */
static struct umbs_sha256_lanes *lanes_take(void)
{
    struct umbs_sha256_lanes *lanes = NULL;
    pthread_mutex_lock(&idle.lock);
    if (idle.count > 0) {
        lanes = idle.lanes[--idle.count];
    }
    pthread_mutex_unlock(&idle.lock);
    return lanes != NULL ? lanes : umbs_sha256_lanes_create(NULL);
}

/* Returns lanes to the idle ones. In: lanes: may be NULL. */
static void lanes_give_back(struct umbs_sha256_lanes *lanes)
{
    pthread_mutex_lock(&idle.lock);
    if (lanes != NULL && idle.count < IDLE_MOST) {
        idle.lanes[idle.count++] = lanes;
        lanes = NULL;
    }
    pthread_mutex_unlock(&idle.lock);
    umbs_sha256_lanes_destroy(lanes);
}

static void digest_many(void *user, const uint8_t *const *messages, const size_t *sizes,
                        size_t count, uint8_t (*digests)[UMB_ID_BYTES])
{
    struct umbs_sha256_lanes *lanes = count < LANES_FROM ? NULL : lanes_take();
    const bool made =
        lanes != NULL && umbs_sha256_lanes_digest(lanes, messages, sizes, count, digests);
    lanes_give_back(lanes);
    for (size_t i = 0; i < count; i++) {
        if (!made || sizes[i] > UMBS_SHA256_LANES_LONGEST) {
            const void *parts[1] = {messages[i]};
            umbn_sha256(user, parts, &sizes[i], 1, digests[i]);
        }
    }
}

const struct umb_sha256 umbs_sha256 = {
    .digest = umbn_sha256, .user = NULL, .digest_many = digest_many};

void umbs_sha256_bytes(const void *bytes, size_t size, uint8_t out[UMB_ID_BYTES])
{
    const void *parts[1] = {bytes};
    umbn_sha256(NULL, parts, &size, 1, out);
}

void umbs_sha256_begin(struct umbs_sha256_run *run)
{
    (void)SHA256_Init(&run->context);
}

void umbs_sha256_add(struct umbs_sha256_run *run, const void *bytes, size_t size)
{
    (void)SHA256_Update(&run->context, bytes, size);
}

void umbs_sha256_end(struct umbs_sha256_run *run, uint8_t out[UMB_ID_BYTES])
{
    (void)SHA256_Final(out, &run->context);
}

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

#define HASH_BLOCK 64U /* block of SHA-256 in bytes: a shorter key is padded to it */

/* The keyed inner or outer hash: SHA-256(key XOR pad, message). */
static void padded(const uint8_t key[UMBS_KEY_BYTES], uint8_t pad, const void *bytes, size_t size,
                   uint8_t out[UMB_ID_BYTES])
{
    struct umbs_sha256_run run;
    uint8_t block[HASH_BLOCK];
    memset(block, pad, sizeof block);
    for (size_t i = 0; i < UMBS_KEY_BYTES; i++) {
        block[i] ^= key[i];
    }
    umbs_sha256_begin(&run);
    umbs_sha256_add(&run, block, sizeof block);
    umbs_sha256_add(&run, bytes, size);
    umbs_sha256_end(&run, out);
    OPENSSL_cleanse(block, sizeof block);
}

void umbs_hmac_sha256(const uint8_t key[UMBS_KEY_BYTES], const void *bytes, size_t size,
                      uint8_t out[UMB_ID_BYTES])
{
    uint8_t inner[UMB_ID_BYTES];
    padded(key, 0x36, bytes, size, inner);
    padded(key, 0x5c, inner, sizeof inner, out);
}

int umbs_digest_equal(const uint8_t a[UMB_ID_BYTES], const uint8_t b[UMB_ID_BYTES])
{
    return CRYPTO_memcmp(a, b, UMB_ID_BYTES) == 0;
}

/* SPDX-License-Identifier: Apache-2.0 */
#include "web/module/web_sha256.h"

#include <string.h>

#define BLOCK 64U

struct state {
    uint32_t word[8];
    uint8_t block[BLOCK];
    uint64_t bytes;
};

static const uint32_t constants[64] = {
    0x428a2f98, 0x71374491, 0xb5c0fbcf, 0xe9b5dba5, 0x3956c25b, 0x59f111f1, 0x923f82a4, 0xab1c5ed5,
    0xd807aa98, 0x12835b01, 0x243185be, 0x550c7dc3, 0x72be5d74, 0x80deb1fe, 0x9bdc06a7, 0xc19bf174,
    0xe49b69c1, 0xefbe4786, 0x0fc19dc6, 0x240ca1cc, 0x2de92c6f, 0x4a7484aa, 0x5cb0a9dc, 0x76f988da,
    0x983e5152, 0xa831c66d, 0xb00327c8, 0xbf597fc7, 0xc6e00bf3, 0xd5a79147, 0x06ca6351, 0x14292967,
    0x27b70a85, 0x2e1b2138, 0x4d2c6dfc, 0x53380d13, 0x650a7354, 0x766a0abb, 0x81c2c92e, 0x92722c85,
    0xa2bfe8a1, 0xa81a664b, 0xc24b8b70, 0xc76c51a3, 0xd192e819, 0xd6990624, 0xf40e3585, 0x106aa070,
    0x19a4c116, 0x1e376c08, 0x2748774c, 0x34b0bcb5, 0x391c0cb3, 0x4ed8aa4a, 0x5b9cca4f, 0x682e6ff3,
    0x748f82ee, 0x78a5636f, 0x84c87814, 0x8cc70208, 0x90befffa, 0xa4506ceb, 0xbef9a3f7, 0xc67178f2};

static uint32_t rotate(uint32_t x, unsigned by)
{
    return x >> by | x << (32 - by);
}

/* One round of SHA-256. The caller passes the eight words rotated by one in each round, so that no
 * word is copied. */
static inline void turn(uint32_t a, uint32_t b, uint32_t c, uint32_t *d, uint32_t e, uint32_t f,
                        uint32_t g, uint32_t *h, uint32_t word)
{
    const uint32_t choice = (e & f) ^ (~e & g), majority = (a & b) ^ (a & c) ^ (b & c);
    *h += (rotate(e, 6) ^ rotate(e, 11) ^ rotate(e, 25)) + choice + word;
    *d += *h;
    *h += (rotate(a, 2) ^ rotate(a, 13) ^ rotate(a, 22)) + majority;
}

static void compress(uint32_t word[8], const uint8_t block[BLOCK])
{
    uint32_t w[64], h[8];
    for (unsigned i = 0; i < 16; i++) {
        w[i] = (uint32_t)block[4 * i] << 24 | (uint32_t)block[4 * i + 1] << 16 |
               (uint32_t)block[4 * i + 2] << 8 | (uint32_t)block[4 * i + 3];
    }
    for (unsigned i = 16; i < 64; i++) {
        const uint32_t a = w[i - 15], b = w[i - 2];
        w[i] = w[i - 16] + (rotate(a, 7) ^ rotate(a, 18) ^ a >> 3) + w[i - 7] +
               (rotate(b, 17) ^ rotate(b, 19) ^ b >> 10);
    }
    memcpy(h, word, sizeof h);
    for (unsigned i = 0; i < 64; i += 8) {
        for (unsigned k = 0; k < 8; k++) {
            turn(h[(8 - k) & 7], h[(9 - k) & 7], h[(10 - k) & 7], &h[(11 - k) & 7], h[(12 - k) & 7],
                 h[(13 - k) & 7], h[(14 - k) & 7], &h[(15 - k) & 7], w[i + k] + constants[i + k]);
        }
    }
    for (unsigned i = 0; i < 8; i++) {
        word[i] += h[i];
    }
}

static void update(struct state *state, const uint8_t *bytes, size_t size)
{
    size_t used = (size_t)(state->bytes % BLOCK);
    state->bytes += size;
    while (size > 0) {
        const size_t part = size < BLOCK - used ? size : BLOCK - used;
        memcpy(state->block + used, bytes, part);
        bytes += part;
        size -= part;
        used += part;
        if (used == BLOCK) {
            compress(state->word, state->block);
            used = 0;
        }
    }
}

static void finish(struct state *state, uint8_t out[UMB_ID_BYTES])
{
    static const uint8_t end[BLOCK] = {0x80};
    const uint64_t bits = 8 * state->bytes;
    const size_t used = (size_t)(state->bytes % BLOCK);
    uint8_t length[8];
    for (unsigned i = 0; i < 8; i++) {
        length[i] = (uint8_t)(bits >> (56 - 8 * i));
    }
    update(state, end, used < BLOCK - 8 ? BLOCK - 8 - used : 2 * BLOCK - 8 - used);
    update(state, length, sizeof length);
    for (unsigned i = 0; i < UMB_ID_BYTES; i++) {
        out[i] = (uint8_t)(state->word[i / 4] >> (24 - 8 * (i % 4)));
    }
}

static void digest(void *user, const void *const *parts, const size_t *sizes, size_t part_count,
                   uint8_t out[UMB_ID_BYTES])
{
    struct state state = {.word = {0x6a09e667, 0xbb67ae85, 0x3c6ef372, 0xa54ff53a, 0x510e527f,
                                   0x9b05688c, 0x1f83d9ab, 0x5be0cd19}};
    (void)user;
    for (size_t i = 0; i < part_count; i++) {
        update(&state, parts[i], sizes[i]);
    }
    finish(&state, out);
}

const struct umb_sha256 *umbx_sha256(void)
{
    static const struct umb_sha256 sha256 = {.digest = digest};
    return &sha256;
}

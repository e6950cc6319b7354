/* SPDX-License-Identifier: Apache-2.0 */
/*
 * See sha256_lanes.h. A lane that has come to the end of its message takes the next one, so that
 * lanes stay busy until few messages are left. Integers only, so equal by construction.
 */
#include "common/sha256_lanes.h"

#if defined(__AVX512F__) && defined(__AVX512BW__)
#include <immintrin.h>
#include <stdbool.h>
#include <string.h>

enum {
    LANES = 16,
    BLOCK = 64,
    WORDS = 16,
    STATE = 8,
    ROUNDS = 64
};

/* FIPS 180-4, section 5.3.3. */
static const uint32_t first_state[STATE] = {0x6a09e667, 0xbb67ae85, 0x3c6ef372, 0xa54ff53a,
                                            0x510e527f, 0x9b05688c, 0x1f83d9ab, 0x5be0cd19};

/* FIPS 180-4, section 4.2.2. */
static const uint32_t round_constants[ROUNDS] = {
    0x428a2f98, 0x71374491, 0xb5c0fbcf, 0xe9b5dba5, 0x3956c25b, 0x59f111f1, 0x923f82a4, 0xab1c5ed5,
    0xd807aa98, 0x12835b01, 0x243185be, 0x550c7dc3, 0x72be5d74, 0x80deb1fe, 0x9bdc06a7, 0xc19bf174,
    0xe49b69c1, 0xefbe4786, 0x0fc19dc6, 0x240ca1cc, 0x2de92c6f, 0x4a7484aa, 0x5cb0a9dc, 0x76f988da,
    0x983e5152, 0xa831c66d, 0xb00327c8, 0xbf597fc7, 0xc6e00bf3, 0xd5a79147, 0x06ca6351, 0x14292967,
    0x27b70a85, 0x2e1b2138, 0x4d2c6dfc, 0x53380d13, 0x650a7354, 0x766a0abb, 0x81c2c92e, 0x92722c85,
    0xa2bfe8a1, 0xa81a664b, 0xc24b8b70, 0xc76c51a3, 0xd192e819, 0xd6990624, 0xf40e3585, 0x106aa070,
    0x19a4c116, 0x1e376c08, 0x2748774c, 0x34b0bcb5, 0x391c0cb3, 0x4ed8aa4a, 0x5b9cca4f, 0x682e6ff3,
    0x748f82ee, 0x78a5636f, 0x84c87814, 0x8cc70208, 0x90befffa, 0xa4506ceb, 0xbef9a3f7, 0xc67178f2};

/* What a lane works on: whole blocks of its message, then what is left of it with its length. */
struct lane {
    const uint8_t *at;
    size_t blocks; /* left at `at`; 0: the lane is idle */
    size_t message;
    size_t tail_blocks; /* still to come */
    uint8_t tail[2 * BLOCK];
};

struct lanes {
    struct lane lane[LANES];
    uint32_t state[STATE][LANES];
};

static void lane_begin(struct lanes *lanes, size_t number, size_t message, const uint8_t *bytes,
                       size_t size)
{
    struct lane *lane = &lanes->lane[number];
    const size_t rest = size % BLOCK;
    lane->message = message;
    lane->at = bytes;
    lane->blocks = size / BLOCK;
    lane->tail_blocks = rest + 9 <= BLOCK ? 1 : 2;
    memset(lane->tail, 0, sizeof lane->tail);
    if (rest > 0) {
        memcpy(lane->tail, bytes + (size - rest), rest);
    }
    lane->tail[rest] = 0x80;
    for (size_t i = 0; i < 8; i++) {
        lane->tail[lane->tail_blocks * BLOCK - 1 - i] = (uint8_t)((uint64_t)size * 8 >> (8 * i));
    }
    for (size_t i = 0; i < STATE; i++) {
        lanes->state[i][number] = first_state[i];
    }
}

/* Goes on to the tail, if that is still to come. */
static void lane_refill(struct lane *lane)
{
    if (lane->blocks == 0) {
        lane->at = lane->tail;
        lane->blocks = lane->tail_blocks;
        lane->tail_blocks = 0;
    }
}

static void lane_digest(const struct lanes *lanes, size_t number, uint8_t digest[32])
{
    for (size_t i = 0; i < 32; i++) {
        digest[i] = (uint8_t)(lanes->state[i / 4][number] >> (24 - 8 * (i % 4)));
    }
}

/* Turns rows (a lane's 16 words) into columns (a word of 16 lanes). */
static inline void transpose(__m512i r[WORDS])
{
    __m512i t[WORDS];
    for (int i = 0; i < 16; i += 2) {
        t[i] = _mm512_unpacklo_epi32(r[i], r[i + 1]);
        t[i + 1] = _mm512_unpackhi_epi32(r[i], r[i + 1]);
    }
    for (int i = 0; i < 16; i += 4) { /* r[i + k]: words k, k + 4, ... of rows i to i + 3 */
        r[i] = _mm512_unpacklo_epi64(t[i], t[i + 2]);
        r[i + 1] = _mm512_unpackhi_epi64(t[i], t[i + 2]);
        r[i + 2] = _mm512_unpacklo_epi64(t[i + 1], t[i + 3]);
        r[i + 3] = _mm512_unpackhi_epi64(t[i + 1], t[i + 3]);
    }
    for (int k = 0; k < 4; k++) {
        const __m512i low = _mm512_shuffle_i32x4(r[k], r[k + 4], 0x88);
        const __m512i high = _mm512_shuffle_i32x4(r[k], r[k + 4], 0xdd);
        const __m512i low8 = _mm512_shuffle_i32x4(r[k + 8], r[k + 12], 0x88);
        const __m512i high8 = _mm512_shuffle_i32x4(r[k + 8], r[k + 12], 0xdd);
        t[k] = _mm512_shuffle_i32x4(low, low8, 0x88);
        t[k + 8] = _mm512_shuffle_i32x4(low, low8, 0xdd);
        t[k + 4] = _mm512_shuffle_i32x4(high, high8, 0x88);
        t[k + 12] = _mm512_shuffle_i32x4(high, high8, 0xdd);
    }
    memcpy(r, t, sizeof t);
}

#define ROTATE(x, n)      _mm512_ror_epi32(x, n)
#define XOR3(x, y, z)     _mm512_ternarylogic_epi32(x, y, z, 0x96)
#define CHOOSE(x, y, z)   _mm512_ternarylogic_epi32(x, y, z, 0xca)
#define MAJORITY(x, y, z) _mm512_ternarylogic_epi32(x, y, z, 0xe8)

/* The next word of the message schedule, in place of that sixteen before. */
static inline __m512i schedule(__m512i w[WORDS], int i)
{
    const __m512i w1 = w[(i + 1) & 15], w14 = w[(i + 14) & 15];
    const __m512i s0 = XOR3(ROTATE(w1, 7), ROTATE(w1, 18), _mm512_srli_epi32(w1, 3));
    const __m512i s1 = XOR3(ROTATE(w14, 17), ROTATE(w14, 19), _mm512_srli_epi32(w14, 10));
    w[i & 15] =
        _mm512_add_epi32(_mm512_add_epi32(w[i & 15], s0), _mm512_add_epi32(w[(i + 9) & 15], s1));
    return w[i & 15];
}

/* One round; the caller turns the names of the state instead of moving it. */
#define ROUND(a, b, c, d, e, f, g, h, word, constant)                                              \
    do {                                                                                           \
        const __m512i s1 = XOR3(ROTATE(e, 6), ROTATE(e, 11), ROTATE(e, 25));                       \
        const __m512i s0 = XOR3(ROTATE(a, 2), ROTATE(a, 13), ROTATE(a, 22));                       \
        const __m512i kw = _mm512_add_epi32(word, _mm512_set1_epi32((int)(constant)));             \
        const __m512i t1 =                                                                         \
            _mm512_add_epi32(_mm512_add_epi32(h, kw), _mm512_add_epi32(s1, CHOOSE(e, f, g)));      \
        (d) = _mm512_add_epi32(d, t1);                                                             \
        (h) = _mm512_add_epi32(t1, _mm512_add_epi32(s0, MAJORITY(a, b, c)));                       \
    } while (0)

#define WORD(i) (round < 16 ? w[i] : schedule(w, i))

/* One block of each lane, word by word. */
static inline void compress(__m512i state[STATE], __m512i w[WORDS])
{
    __m512i a = state[0], b = state[1], c = state[2], d = state[3];
    __m512i e = state[4], f = state[5], g = state[6], h = state[7];
    for (int round = 0; round < ROUNDS; round += 16) {
        const uint32_t *k = round_constants + round;
        ROUND(a, b, c, d, e, f, g, h, WORD(0), k[0]);
        ROUND(h, a, b, c, d, e, f, g, WORD(1), k[1]);
        ROUND(g, h, a, b, c, d, e, f, WORD(2), k[2]);
        ROUND(f, g, h, a, b, c, d, e, WORD(3), k[3]);
        ROUND(e, f, g, h, a, b, c, d, WORD(4), k[4]);
        ROUND(d, e, f, g, h, a, b, c, WORD(5), k[5]);
        ROUND(c, d, e, f, g, h, a, b, WORD(6), k[6]);
        ROUND(b, c, d, e, f, g, h, a, WORD(7), k[7]);
        ROUND(a, b, c, d, e, f, g, h, WORD(8), k[8]);
        ROUND(h, a, b, c, d, e, f, g, WORD(9), k[9]);
        ROUND(g, h, a, b, c, d, e, f, WORD(10), k[10]);
        ROUND(f, g, h, a, b, c, d, e, WORD(11), k[11]);
        ROUND(e, f, g, h, a, b, c, d, WORD(12), k[12]);
        ROUND(d, e, f, g, h, a, b, c, WORD(13), k[13]);
        ROUND(c, d, e, f, g, h, a, b, WORD(14), k[14]);
        ROUND(b, c, d, e, f, g, h, a, WORD(15), k[15]);
    }
    const __m512i end[STATE] = {a, b, c, d, e, f, g, h};
    for (int i = 0; i < STATE; i++) {
        state[i] = _mm512_add_epi32(state[i], end[i]);
    }
}

/* So many blocks of every lane; idle ones read what a busy one does, in vain. */
static void run(struct lanes *lanes, size_t blocks, const uint8_t *const at[LANES])
{
    const __m512i big_endian =
        _mm512_broadcast_i32x4(_mm_set_epi8(12, 13, 14, 15, 8, 9, 10, 11, 4, 5, 6, 7, 0, 1, 2, 3));
    __m512i state[STATE], words[WORDS];
    for (int i = 0; i < STATE; i++) {
        state[i] = _mm512_loadu_si512(lanes->state[i]);
    }
    for (size_t block = 0; block < blocks; block++) {
        for (int i = 0; i < LANES; i++) {
            words[i] = _mm512_shuffle_epi8(_mm512_loadu_si512(at[i] + block * BLOCK), big_endian);
        }
        transpose(words);
        compress(state, words);
    }
    for (int i = 0; i < STATE; i++) {
        _mm512_storeu_si512(lanes->state[i], state[i]);
    }
}

/* As many blocks as no lane ends within. False: all lanes are idle. */
static bool advance(struct lanes *lanes)
{
    const uint8_t *at[LANES], *busy = NULL;
    size_t blocks = SIZE_MAX;
    for (size_t i = 0; i < LANES; i++) {
        lane_refill(&lanes->lane[i]);
        if (lanes->lane[i].blocks > 0) {
            busy = lanes->lane[i].at;
            blocks = lanes->lane[i].blocks < blocks ? lanes->lane[i].blocks : blocks;
        }
    }
    if (busy == NULL) {
        return false;
    }
    for (size_t i = 0; i < LANES; i++) {
        at[i] = lanes->lane[i].blocks > 0 ? lanes->lane[i].at : busy;
    }
    run(lanes, blocks, at);
    for (size_t i = 0; i < LANES; i++) {
        if (lanes->lane[i].blocks > 0) {
            lanes->lane[i].blocks -= blocks;
            lanes->lane[i].at += blocks * BLOCK;
        }
    }
    return true;
}

static void digest_all(const uint8_t *const *messages, const size_t *sizes, size_t count,
                       uint8_t (*digests)[32])
{
    struct lanes lanes;
    bool busy[LANES] = {false};
    size_t next = 0;
    memset(&lanes, 0, sizeof lanes);
    do {
        for (size_t i = 0; i < LANES; i++) {
            const bool ended = lanes.lane[i].blocks + lanes.lane[i].tail_blocks == 0;
            if (ended && busy[i]) {
                lane_digest(&lanes, i, digests[lanes.lane[i].message]);
                busy[i] = false;
            }
            if (ended && next < count) {
                lane_begin(&lanes, i, next, messages[next], sizes[next]);
                busy[i] = true;
                next++;
            }
        }
    } while (advance(&lanes));
}

umbs_sha256_lanes_fn umbs_sha256_lanes_avx512(void)
{
    const int has = __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw");
    return has ? digest_all : NULL;
}

#else

umbs_sha256_lanes_fn umbs_sha256_lanes_avx512(void)
{
    return NULL;
}

#endif

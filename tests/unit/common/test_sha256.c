/* SPDX-License-Identifier: Apache-2.0 */
/* SHA-256 of many messages at once, compared with OpenSSL's of each, and with a known answer. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include "common/sha256.h"
#include "umbrage/asset.h"
#include "common/sha256_lanes.h"

#define MOST 64U /* messages at a time */

static uint64_t random_bits(uint64_t *state)
{
    uint64_t z = (*state += 0x9e3779b97f4a7c15ULL); /* splitmix64 */
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
    return z ^ (z >> 31);
}

/* Random messages, each in a block of its own size, and their digests by OpenSSL. */
struct messages {
    size_t count;
    uint8_t *bytes[MOST];
    size_t sizes[MOST];
    uint8_t digests[MOST][UMB_ID_BYTES];
};

/* In: sizes: [size_count], taken in turn. */
static void make_messages(struct messages *m, size_t count, const size_t *sizes, size_t size_count)
{
    uint64_t random = 11 + count;
    m->count = count;
    for (size_t i = 0; i < count; i++) {
        m->sizes[i] = sizes[i % size_count];
        m->bytes[i] = malloc(m->sizes[i] > 0 ? m->sizes[i] : 1);
        assert_non_null(m->bytes[i]);
        for (size_t k = 0; k < m->sizes[i]; k++) {
            m->bytes[i][k] = (uint8_t)random_bits(&random);
        }
        umbs_sha256_bytes(m->bytes[i], m->sizes[i], m->digests[i]);
    }
}

static void free_messages(struct messages *m)
{
    for (size_t i = 0; i < m->count; i++) {
        free(m->bytes[i]);
    }
}

/* Tests the hasher, which may not use lanes, and lanes by themselves. */
static void compare(const struct messages *m)
{
    const uint8_t *bytes[MOST] = {NULL};
    static const uint8_t nothing[UMB_ID_BYTES];
    uint8_t digests[MOST][UMB_ID_BYTES];
    memcpy(bytes, m->bytes, m->count * sizeof bytes[0]);
    umbs_sha256.digest_many(umbs_sha256.user, bytes, m->sizes, m->count, digests);
    assert_memory_equal(digests, m->digests, m->count * UMB_ID_BYTES);
    struct umbs_sha256_lanes *lanes = umbs_sha256_lanes_create(NULL);
    for (int round = 0; lanes != NULL && round < 2; round++) {
        memset(digests, 0, sizeof digests);
        assert_true(umbs_sha256_lanes_digest(lanes, bytes, m->sizes, m->count, digests));
        for (size_t i = 0; i < m->count; i++) {
            const uint8_t *wanted =
                m->sizes[i] > UMBS_SHA256_LANES_LONGEST ? nothing : m->digests[i];
            assert_memory_equal(digests[i], wanted, UMB_ID_BYTES);
        }
    }
    umbs_sha256_lanes_destroy(lanes);
}

static const size_t counts[] = {1, 2, 3, 4, 15, 16, 17, 63, 64};
static const size_t lengths[] = {0, 1, 55, 56, 63, 64, 65, 119, 120, 65534, 65535, (size_t)1 << 20};

static void many_messages_of_one_length_have_the_digests_of_each(void **state)
{
    (void)state;
    for (size_t i = 0; i < sizeof counts / sizeof counts[0]; i++) {
        for (size_t k = 0; k < sizeof lengths / sizeof lengths[0]; k++) {
            struct messages m;
            if (counts[i] > 17 && lengths[k] > 120) {
                continue; /* 64 MiB say no more than 17 */
            }
            make_messages(&m, counts[i], &lengths[k], 1);
            compare(&m);
            free_messages(&m);
        }
    }
}

static void many_messages_of_mixed_lengths_have_the_digests_of_each(void **state)
{
    uint64_t random = 5;
    (void)state;
    for (size_t i = 0; i < sizeof counts / sizeof counts[0]; i++) {
        size_t sizes[MOST];
        struct messages m;
        make_messages(&m, counts[i], lengths, sizeof lengths / sizeof lengths[0]);
        compare(&m);
        free_messages(&m);
        for (size_t k = 0; k < MOST; k++) {
            sizes[k] = (size_t)(random_bits(&random) % 30000);
        }
        make_messages(&m, counts[i], sizes, MOST);
        compare(&m);
        free_messages(&m);
    }
}

/* FIPS 180-4's example of one block, "abc". */
static void known_messages_have_their_known_digest(void **state)
{
    static const uint8_t wanted[UMB_ID_BYTES] = {0xba, 0x78, 0x16, 0xbf, 0x8f, 0x01, 0xcf, 0xea,
                                                 0x41, 0x41, 0x40, 0xde, 0x5d, 0xae, 0x22, 0x23,
                                                 0xb0, 0x03, 0x61, 0xa3, 0x96, 0x17, 0x7a, 0x9c,
                                                 0xb4, 0x10, 0xff, 0x61, 0xf2, 0x00, 0x15, 0xad};
    const uint8_t *messages[16];
    size_t sizes[16];
    uint8_t digests[16][UMB_ID_BYTES];
    (void)state;
    for (size_t i = 0; i < 16; i++) {
        messages[i] = (const uint8_t *)"abc";
        sizes[i] = 3;
    }
    umbs_sha256.digest_many(umbs_sha256.user, messages, sizes, 16, digests);
    for (size_t i = 0; i < 16; i++) {
        assert_memory_equal(digests[i], wanted, sizeof wanted);
    }
}

static void *refuse(void *user, void *block, size_t bytes)
{
    (void)user;
    (void)bytes;
    assert_null(block); /* nothing was given, so nothing is freed */
    return NULL;
}

static void without_memory_there_are_no_lanes(void **state)
{
    const struct umb_alloc nothing = {refuse, NULL};
    (void)state;
    assert_null(umbs_sha256_lanes_create(&nothing));
    umbs_sha256_lanes_destroy(NULL);
}

static void *hash_again(void *user)
{
    for (int round = 0; round < 20; round++) {
        const struct messages *m = user;
        uint8_t digests[MOST][UMB_ID_BYTES];
        umbs_sha256.digest_many(umbs_sha256.user, (const uint8_t *const *)m->bytes, m->sizes,
                                m->count, digests);
        if (memcmp(digests, m->digests, m->count * UMB_ID_BYTES) != 0) {
            return user;
        }
    }
    return NULL;
}

/* Starts more threads than lanes are kept for. */
static void threads_do_not_share_lanes(void **state)
{
    static const size_t sizes[] = {700, 64, 5000, 0, 1};
    enum {
        THREADS = 20
    };
    pthread_t threads[THREADS];
    struct messages m[THREADS];
    (void)state;
    for (size_t i = 0; i < THREADS; i++) {
        make_messages(&m[i], 16 + i, sizes, sizeof sizes / sizeof sizes[0]);
        assert_int_equal(pthread_create(&threads[i], NULL, hash_again, &m[i]), 0);
    }
    for (size_t i = 0; i < THREADS; i++) {
        void *wrong;
        assert_int_equal(pthread_join(threads[i], &wrong), 0);
        assert_null(wrong);
        free_messages(&m[i]);
    }
}

/* RFC 4231, test case 2: its key is padded by zeros to any length up to a block. */
static void keyed_digest_is_that_of_the_rfc(void **state)
{
    static const uint8_t key[UMBS_KEY_BYTES] = "Jefe";
    static const char data[] = "what do ya want for nothing?";
    uint8_t mac[UMB_ID_BYTES];
    uint8_t other[UMB_ID_BYTES];
    char text[UMB_ID_TEXT_SIZE];
    (void)state;
    umbs_hmac_sha256(key, data, sizeof data - 1, mac);
    umb_id_to_text(mac, text);
    assert_string_equal(text, "5bdcc146bf60754e6a042426089575c75a003f089d2739839dec58b964ec3843");
    memcpy(other, mac, sizeof other);
    assert_true(umbs_digest_equal(mac, other));
    for (size_t i = 0; i < sizeof other; i++) {
        other[i] ^= 1;
        assert_false(umbs_digest_equal(mac, other));
        other[i] ^= 1;
    }
}

static void pieces_have_the_digest_of_the_whole(void **state)
{
    static const char text[] = "a message that comes in three pieces, one of them empty";
    struct umbs_sha256_run run;
    uint8_t whole[UMB_ID_BYTES];
    uint8_t pieces[UMB_ID_BYTES];
    (void)state;
    umbs_sha256_bytes(text, sizeof text, whole);
    umbs_sha256_begin(&run);
    umbs_sha256_add(&run, text, 10);
    umbs_sha256_add(&run, text, 0);
    umbs_sha256_add(&run, text + 10, sizeof text - 10);
    umbs_sha256_end(&run, pieces);
    assert_memory_equal(whole, pieces, sizeof whole);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(many_messages_of_one_length_have_the_digests_of_each),
        cmocka_unit_test(many_messages_of_mixed_lengths_have_the_digests_of_each),
        cmocka_unit_test(known_messages_have_their_known_digest),
        cmocka_unit_test(without_memory_there_are_no_lanes),
        cmocka_unit_test(threads_do_not_share_lanes),
        cmocka_unit_test(keyed_digest_is_that_of_the_rfc),
        cmocka_unit_test(pieces_have_the_digest_of_the_whole),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

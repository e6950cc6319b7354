/* SPDX-License-Identifier: Apache-2.0 */
/* SHA-256 of many messages at once against OpenSSL's of each, and a known answer. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <stdlib.h>
#include <string.h>

#include "common/sha256.h"
#include "common/sha256_lanes.h"

#define MOST 70U /* messages at a time */

static uint64_t random_state = 11;

/* splitmix64 */
static uint64_t random_bits(void)
{
    uint64_t z = (random_state += 0x9e3779b97f4a7c15ULL);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
    return z ^ (z >> 31);
}

/* In: sizes: of messages whose bytes are random, each in a block of its own size. */
static void compare(const size_t *sizes, size_t count)
{
    const uint8_t *messages[MOST] = {NULL};
    uint8_t digests[MOST][UMB_ID_BYTES], wanted[UMB_ID_BYTES];
    for (size_t i = 0; i < count; i++) {
        uint8_t *bytes = malloc(sizes[i] > 0 ? sizes[i] : 1);
        assert_non_null(bytes);
        for (size_t k = 0; k < sizes[i]; k++) {
            bytes[k] = (uint8_t)random_bits();
        }
        messages[i] = bytes;
    }
    umbs_sha256.digest_many(umbs_sha256.user, messages, sizes, count, digests);
    for (size_t i = 0; i < count; i++) {
        umbs_sha256_bytes(messages[i], sizes[i], wanted);
        assert_memory_equal(digests[i], wanted, sizeof wanted);
        free((void *)(uintptr_t)messages[i]);
    }
}

static void many_messages_have_the_digests_of_each(void **state)
{
    size_t sizes[MOST];
    (void)state;
    if (umbs_sha256_lanes_avx512() == NULL) {
        print_message("no lanes on this machine: one after the other\n");
    }
    for (size_t count = 0; count <= MOST; count++) {
        for (size_t i = 0; i < count; i++) {
            sizes[i] = (size_t)(random_bits() % (count % 3 == 0 ? 200 : 9000));
        }
        compare(sizes, count);
    }
    for (size_t base = 0; base < 200; base += 10) { /* every length around one and two blocks */
        for (size_t i = 0; i < 20; i++) {
            sizes[i] = base + i;
        }
        compare(sizes, 20);
    }
}

static void a_known_message_has_its_known_digest(void **state)
{
    /* FIPS 180-2, appendix B.1 */
    static const uint8_t known[4] = {0xba, 0x78, 0x16, 0xbf};
    static const uint8_t message[3] = {'a', 'b', 'c'};
    const uint8_t *messages[5] = {message, message, message, message, message};
    const size_t sizes[5] = {3, 3, 3, 3, 3};
    uint8_t digests[5][UMB_ID_BYTES];
    (void)state;
    umbs_sha256.digest_many(umbs_sha256.user, messages, sizes, 5, digests);
    for (size_t i = 0; i < 5; i++) {
        assert_memory_equal(digests[i], known, sizeof known);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(many_messages_have_the_digests_of_each),
        cmocka_unit_test(a_known_message_has_its_known_digest),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

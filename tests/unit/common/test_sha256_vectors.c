/* SPDX-License-Identifier: Apache-2.0 */
/* SHA-256 against its published vectors. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include <string.h>

#include "common/sha256.h"

static void sha256_equals_the_published_vectors(void **state)
{
    /* FIPS 180-2, appendix B.1 and B.2, and the empty string. */
    static const char *const texts[3] = {
        "abc", "abcdbcdecdefdefgefghfghighijhijkijkljklmklmnlmnomnopnopq", ""};
    static const char *const digests[3] = {
        "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad",
        "248d6a61d20638b8e5c026930c3e6039a33ce45964ff2167f6ecedd419db06c1",
        "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855",
    };
    (void)state;
    for (size_t i = 0; i < 3; i++) {
        uint8_t digest[UMB_ID_BYTES];
        char text[UMB_ID_TEXT_SIZE];
        size_t size = strlen(texts[i]);
        umbs_sha256_bytes(texts[i], size, digest);
        umb_id_to_text(digest, text);
        assert_string_equal(text, digests[i]);
        /* The same in two parts. */
        const void *parts[2] = {texts[i], texts[i] + size / 2};
        size_t sizes[2] = {size / 2, size - size / 2};
        umbs_sha256.digest(umbs_sha256.user, parts, sizes, 2, digest);
        umb_id_to_text(digest, text);
        assert_string_equal(text, digests[i]);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(sha256_equals_the_published_vectors),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

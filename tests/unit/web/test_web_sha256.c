/* SPDX-License-Identifier: Apache-2.0 */
/* SHA-256 of the WebAssembly module against OpenSSL's: every length to four blocks, in parts. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>
#include <openssl/sha.h>

#include "web/module/web_sha256.h"

static void all_lengths(void **state)
{
    uint8_t bytes[300], ours[UMB_ID_BYTES], theirs[UMB_ID_BYTES];
    (void)state;
    for (size_t i = 0; i < sizeof bytes; i++) {
        bytes[i] = (uint8_t)(i * 167 + 13);
    }
    for (size_t size = 0; size <= 256; size++) {
        for (size_t cut = 0; cut <= size; cut += 1 + size / 7) {
            const void *const parts[] = {bytes, bytes + cut, bytes};
            const size_t sizes[] = {cut, size - cut, 0};
            umbx_sha256()->digest(NULL, parts, sizes, 3, ours);
            SHA256(bytes, size, theirs);
            assert_memory_equal(ours, theirs, sizeof ours);
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(all_lengths)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}

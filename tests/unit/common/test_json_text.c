/* SPDX-License-Identifier: Apache-2.0 */
/* Strings in JSON: whatever the bytes, the output is valid UTF-8 and ends where it should. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/json_text.h"

static void json_strings_are_always_utf8(void **state)
{
    (void)state;
    static const struct {
        const char *text, *want;
    } cases[] = {
        {"a\"b\\c\n", "\"a\\\"b\\\\c\\u000a\""},
        {"Gr\xc3\xbc\xc3\x9f", "\"Gr\xc3\xbc\xc3\x9f\""},
        {"\xff.png", "\"\\ufffd.png\""},
        {"\xe2\x82", "\"\\ufffd\\ufffd\""},
        {"\xed\xa0\x80", "\"\\ufffd\\ufffd\\ufffd\""}, /* a surrogate */
        {"\xc0\xaf", "\"\\ufffd\\ufffd\""},            /* over-long */
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        char have[64] = {0};
        FILE *file = tmpfile();
        assert_non_null(file);
        umbs_json_text(file, cases[i].text);
        rewind(file);
        have[fread(have, 1, sizeof have - 1, file)] = 0;
        (void)fclose(file);
        assert_string_equal(have, cases[i].want);
    }
}

static void bytes_may_hold_nuls_and_end_within_a_character(void **state)
{
    (void)state;
    char *text = NULL;
    size_t size = 0;
    FILE *file = open_memstream(&text, &size);
    assert_non_null(file);
    umbs_json_bytes(file, "a\0b\xe2\x82\xac", 5); /* the last character is cut */
    assert_int_equal(fclose(file), 0);
    assert_string_equal(text, "\"a\\u0000b\\ufffd\\ufffd\"");
    free(text);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(json_strings_are_always_utf8),
        cmocka_unit_test(bytes_may_hold_nuls_and_end_within_a_character),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

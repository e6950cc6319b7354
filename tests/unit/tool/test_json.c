/* SPDX-License-Identifier: Apache-2.0 */
/* The JSON writer: its output must be valid JSON and UTF-8, whatever it is given. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "tool/json.h"

static char *text; /* of the memory stream */
static size_t text_size;

static FILE *open_text(void)
{
    FILE *file = open_memstream(&text, &text_size);
    assert_non_null(file);
    return file;
}

static void expect_text(FILE *file, const char *wanted)
{
    assert_int_equal(fclose(file), 0);
    assert_string_equal(text, wanted);
    free(text);
    text = NULL;
}

static void json_puts_commas_and_escapes(void **state)
{
    FILE *file = open_text();
    struct umbu_json json = {.file = file};
    const double vector[3] = {1, -0.5, NAN};
    (void)state;
    umbu_json_begin(&json, NULL, '{');
    umbu_json_text(&json, "a\"b", "line\nbreak \\ \"quoted\" \t\x1b[0m\x7f");
    umbu_json_begin(&json, "list", '[');
    umbu_json_end(&json, ']');
    umbu_json_integer(&json, "big", UINT64_MAX);
    umbu_json_signed(&json, "low", INT64_MIN);
    umbu_json_bool(&json, "yes", true);
    umbu_json_vector(&json, "v", vector);
    umbu_json_number(&json, "infinite", INFINITY);
    umbu_json_end(&json, '}');
    expect_text(file, "{\"a\\\"b\":\"line\\nbreak \\\\ \\\"quoted\\\" \\u0009\\u001b[0m\\u007f\","
                      "\"list\":[],\"big\":18446744073709551615,\"low\":-9223372036854775808,"
                      "\"yes\":true,\"v\":[1,-0.5,null],\"infinite\":null}");
}

static void json_that_is_given_up_is_closed_where_it_stands(void **state)
{
    FILE *file = open_text();
    struct umbu_json json = {.file = file};
    (void)state;
    umbu_json_close(&json); /* nothing began: nothing is written */
    umbu_json_begin(&json, NULL, '{');
    umbu_json_begin(&json, "list", '[');
    umbu_json_integer(&json, NULL, 7);
    umbu_json_begin(&json, NULL, '{');
    umbu_json_close(&json);
    umbu_json_close(&json);
    expect_text(file, "{\"list\":[7,{}]}\n");
}

static void json_is_utf8_whatever_it_is_given(void **state)
{
    FILE *file = open_text();
    struct umbu_json json = {.file = file};
    (void)state;
    umbu_json_text(&json, NULL, "caf\xc3\xa9 \xff \xc3 \xed\xa0\x80.");
    expect_text(file, "\"caf\xc3\xa9 \\ufffd \\ufffd \\ufffd\\ufffd\\ufffd.\"");
}

static void json_strings_are_always_utf8(void **state)
{
    (void)state;
    static const struct {
        const char *text, *want;
    } cases[] = {
        {"a\"b\\c\n", "\"a\\\"b\\\\c\\n\""},
        {"Gr\xc3\xbc\xc3\x9f", "\"Gr\xc3\xbc\xc3\x9f\""},
        {"\xff.png", "\"\\ufffd.png\""},
        {"\xe2\x82", "\"\\ufffd\\ufffd\""},
        {"\xed\xa0\x80", "\"\\ufffd\\ufffd\\ufffd\""}, /* a surrogate */
        {"\xc0\xaf", "\"\\ufffd\\ufffd\""},            /* over-long */
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        FILE *file = open_text();
        umbu_json_text(&(struct umbu_json){.file = file}, NULL, cases[i].text);
        expect_text(file, cases[i].want);
    }
}

static void bytes_may_hold_nuls_and_end_within_a_character(void **state)
{
    (void)state;
    FILE *file = open_text();
    struct umbu_json json = {.file = file};
    umbu_json_bytes(&json, NULL, "a\0b\xe2\x82\xac", 5); /* the last character is cut */
    expect_text(file, "\"a\\u0000b\\ufffd\\ufffd\"");
}

static void numbers_are_rounded_to_their_digits(void **state)
{
    FILE *file = open_text();
    struct umbu_json json = {.file = file};
    (void)state;
    umbu_json_begin(&json, NULL, '[');
    umbu_json_rounded(&json, NULL, 2.0 / 3, 3);
    umbu_json_rounded(&json, NULL, 2.0 / 3, 9);
    umbu_json_rounded(&json, NULL, NAN, 9);
    umbu_json_number(&json, NULL, 0.1);
    umbu_json_close(&json);
    expect_text(file, "[0.667,0.666666667,null,0.10000000000000001]\n");
}

static void lists_of_numbers_are_members_in_their_order(void **state)
{
    FILE *file = open_text();
    struct umbu_json json = {.file = file};
    (void)state;
    umbu_json_begin(&json, NULL, '{');
    UMBU_JSON_VALUES(&json, 3, {"a", 2.0 / 3}, {"b", INFINITY});
    UMBU_JSON_COUNTS(&json, {"c", UINT64_MAX}, {"d", 0});
    umbu_json_close(&json);
    expect_text(file, "{\"a\":0.667,\"b\":null,\"c\":18446744073709551615,\"d\":0}\n");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(json_puts_commas_and_escapes),
        cmocka_unit_test(json_that_is_given_up_is_closed_where_it_stands),
        cmocka_unit_test(json_is_utf8_whatever_it_is_given),
        cmocka_unit_test(json_strings_are_always_utf8),
        cmocka_unit_test(bytes_may_hold_nuls_and_end_within_a_character),
        cmocka_unit_test(numbers_are_rounded_to_their_digits),
        cmocka_unit_test(lists_of_numbers_are_members_in_their_order),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

/* SPDX-License-Identifier: Apache-2.0 */
/* grpc-timeout values, status message escapes, code names. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <stdio.h>
#include <string.h>
#include "grpc/grpc.h"
#include "base/utf8.h"
#include "wire_samples.h"

static void timeout_parse_knows_every_unit(void **state)
{
    static const struct {
        const char *text;
        int64_t nanoseconds;
    } good[] = {
        {"1n", 1},
        {"0n", 0},
        {"0H", 0},
        {"99999999n", 99999999},
        {"1u", 1000},
        {"5m", 5000000},
        {"00000005m", 5000000},
        {"2S", 2000000000},
        {"3M", INT64_C(180000000000)},
        {"1H", INT64_C(3600000000000)},
        {"2562047H", INT64_C(2562047) * 3600 * 1000000000},
        {"2562048H", INT64_MAX},
        {"99999999H", INT64_MAX},
        {"99999999M", INT64_C(99999999) * 60 * 1000000000},
    };
    (void)state;
    for (size_t i = 0; i < sizeof good / sizeof good[0]; i++) {
        int64_t value = -1;
        print_message("%s\n", good[i].text);
        assert_int_equal(umbw_timeout_parse(good[i].text, strlen(good[i].text), &value), UMB_OK);
        assert_true(value == good[i].nanoseconds);
    }
}

static void timeout_parse_rejects_everything_else(void **state)
{
    static const char *const bad[] = {"",     "1",          "n",   "1s",  "1 n",
                                      " 1n",  "-1n",        "+1n", "1.5", "1nn",
                                      "0x1n", "123456789n", "1N",  "H1",  "1h"};
    (void)state;
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        int64_t value = 7;
        print_message("'%s'\n", bad[i]);
        assert_int_equal(umbw_timeout_parse(bad[i], strlen(bad[i]), &value), UMB_E_ARGUMENT);
        assert_true(value == 0);
    }
}

/* A value moves to the next unit at 1e8; the widest step is 1000, so that at least 1e5 units remain
 * and rounding up adds at most 1e-5 of the value. */
static void timeout_format_rounds_up_and_parses_back(void **state)
{
    uint64_t seed = 20261121;
    (void)state;
    print_message("seed %llu\n", (unsigned long long)seed);
    for (int i = 0; i < 20000; i++) {
        int64_t wanted = (int64_t)(sample_random(&seed) >> (1 + sample_random(&seed) % 63));
        char text[16];
        int64_t got;
        size_t length = umbw_timeout_format(wanted, text);
        assert_true(length == strlen(text) && length <= 9);
        assert_int_equal(umbw_timeout_parse(text, length, &got), UMB_OK);
        assert_true(got >= wanted);
        assert_true((double)(got - wanted) <= (double)wanted * 1e-5);
    }
    char text[16];
    assert_int_equal(umbw_timeout_format(-5, text), 2);
    assert_string_equal(text, "0n");
    assert_int_equal(umbw_timeout_format(INT64_MAX, text), 8);
    assert_string_equal(text, "2562048H");
}

static void escape_keeps_printable_ascii_and_encodes_the_rest(void **state)
{
    char text[64];
    (void)state;
    assert_int_equal(umbw_message_escape("taps: 4 is not odd", text, sizeof text), 18);
    assert_string_equal(text, "taps: 4 is not odd");
    (void)umbw_message_escape("50%\n\xc3\xa9~\x7f", text, sizeof text);
    assert_string_equal(text, "50%25%0A%C3%A9~%7F");
    (void)umbw_message_escape("a\xff"
                              "b\xc3",
                              text, sizeof text);
    assert_string_equal(text, "a%EF%BF%BDb%EF%BF%BD");
}

static void escape_cuts_at_a_whole_character(void **state)
{
    (void)state;
    for (size_t capacity = 1; capacity <= 16; capacity++) {
        char text[16];
        memset(text, 'x', sizeof text);
        size_t length = umbw_message_escape("ab\xe2\x82\xac"
                                            "c",
                                            text, capacity);
        assert_true(length < capacity);
        assert_true(text[length] == '\0');
        /* The escaped euro sign takes nine bytes: all of them are there, or none. */
        assert_true(length <= 2 || length == 11 || length == 12);
    }
    char nothing = 'x';
    assert_int_equal(umbw_message_escape("abc", &nothing, 0), 0);
    assert_int_equal(nothing, 'x');
}

static void unescape_keeps_bad_escapes(void **state)
{
    char message[64];
    static const char text[] = "100%, %4, %zz %00 %41%";
    (void)state;
    (void)umbw_message_unescape(text, strlen(text), message, sizeof message);
    assert_string_equal(message, "100%, %4, %zz %00 A%");
    assert_int_equal(umbw_message_unescape("%e2%82%AC", 9, message, sizeof message), 3);
    assert_string_equal(message, "\xe2\x82\xac");
    /* If the text is cut inside the character, the whole character is left out. */
    assert_int_equal(umbw_message_unescape("a%e2%82%AC", 10, message, 4), 1);
    assert_string_equal(message, "a");
}

static void unescape_reverses_escape_for_any_text(void **state)
{
    uint64_t seed = 77;
    (void)state;
    print_message("seed %llu\n", (unsigned long long)seed);
    for (int round = 0; round < 2000; round++) {
        char message[40];
        char escaped[200];
        char back[200];
        size_t length = sample_random(&seed) % 12;
        size_t at = 0;
        for (size_t i = 0; i < length; i++) {
            static const char *const pieces[] = {
                "a", "%", "\n", "\xc3\xa9", "~", "\xe2\x82\xac", "\xf0\x9f\x98\x80", " "};
            const char *piece = pieces[sample_random(&seed) % 8];
            memcpy(message + at, piece, strlen(piece));
            at += strlen(piece);
            if (at > 30) {
                break;
            }
        }
        message[at] = '\0';
        size_t size = umbw_message_escape(message, escaped, sizeof escaped);
        for (size_t i = 0; i < size; i++) {
            assert_true(escaped[i] >= 0x20 && escaped[i] <= 0x7e);
        }
        assert_int_equal(umbw_message_unescape(escaped, size, back, sizeof back), at);
        assert_string_equal(back, message);
    }
}

static void escape_survives_any_bytes(void **state)
{
    uint64_t seed = 4711;
    (void)state;
    print_message("seed %llu\n", (unsigned long long)seed);
    for (int round = 0; round < 5000; round++) {
        char message[33];
        char escaped[64];
        char back[64];
        for (size_t i = 0; i < 32; i++) {
            message[i] = (char)(1 + sample_random(&seed) % 255);
        }
        message[32] = '\0';
        size_t capacity = 1 + sample_random(&seed) % sizeof escaped;
        size_t size = umbw_message_escape(message, escaped, capacity);
        assert_true(size < capacity);
        size = umbw_message_unescape(escaped, size, back, sizeof back);
        assert_true(umb__utf8_valid((const uint8_t *)back, size));
        (void)umbw_message_unescape(message, 32, back, 1 + sample_random(&seed) % sizeof back);
    }
}

static void utf8_refuses_overlong_surrogates_and_cut_forms(void **state)
{
    static const char *const bad[] = {
        "\x80",         "\xc0\x80",         "\xc1\xbf",         "\xe0\x80\x80",
        "\xed\xa0\x80", "\xf0\x80\x80\x80", "\xf4\x90\x80\x80", "\xf5\x80\x80\x80",
        "\xe2\x82",     "\xc3\xc3"};
    (void)state;
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        assert_false(umb__utf8_valid((const uint8_t *)bad[i], strlen(bad[i])));
    }
    assert_true(umb__utf8_valid((const uint8_t *)"\xed\x9f\xbf\xee\x80\x80\xf4\x8f\xbf\xbf", 10));
    assert_false(umb__utf8_valid((const uint8_t *)"a\0b", 3));
    assert_true(umb__utf8_valid(NULL, 0));
}

static void grpc_name_is_never_null(void **state)
{
    (void)state;
    assert_string_equal(umbw_grpc_name(UMBW_GRPC_NOT_FOUND), "NOT_FOUND");
    assert_string_equal(umbw_grpc_name(16), "UNAUTHENTICATED");
    assert_string_equal(umbw_grpc_name(17), "UNRECOGNISED");
    assert_string_equal(umbw_grpc_name(-1), "UNRECOGNISED");
}

static void grpc_codes_have_a_status_and_keep_their_sense(void **state)
{
    static const enum umb_status statuses[] = {
#define ROW(name, value, text) UMB_##name,
        UMB_STATUS_LIST(ROW)
#undef ROW
    };
    (void)state;
    for (size_t i = 0; i < sizeof statuses / sizeof statuses[0]; i++) {
        assert_in_range(umbw_grpc_code(statuses[i]), 0, 16);
        assert_int_not_equal(umbw_grpc_code(statuses[i]), 2); /* UNKNOWN: it has no row */
        assert_int_equal(umbw_grpc_code(statuses[i]) == 0, statuses[i] == UMB_OK);
    }
    assert_int_equal(umbw_grpc_code((enum umb_status)(-999)), 2);
    assert_int_equal(umbw_grpc_status(0), UMB_OK);
    for (int code = 1; code <= 16; code++) {
        enum umb_status status = umbw_grpc_status(code);
        assert_int_not_equal(status, UMB_OK);
        assert_int_not_equal(status, UMB_E_PROTOCOL);
    }
    assert_int_equal(umbw_grpc_status(8), UMB_E_TOO_LARGE); /* without a hint to come again */
    assert_int_equal(umbw_grpc_status(17), UMB_E_PROTOCOL);
    assert_int_equal(umbw_grpc_status(-1), UMB_E_PROTOCOL);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(grpc_codes_have_a_status_and_keep_their_sense),
        cmocka_unit_test(timeout_parse_knows_every_unit),
        cmocka_unit_test(timeout_parse_rejects_everything_else),
        cmocka_unit_test(timeout_format_rounds_up_and_parses_back),
        cmocka_unit_test(escape_keeps_printable_ascii_and_encodes_the_rest),
        cmocka_unit_test(escape_cuts_at_a_whole_character),
        cmocka_unit_test(unescape_keeps_bad_escapes),
        cmocka_unit_test(unescape_reverses_escape_for_any_text),
        cmocka_unit_test(escape_survives_any_bytes),
        cmocka_unit_test(utf8_refuses_overlong_surrogates_and_cut_forms),
        cmocka_unit_test(grpc_name_is_never_null),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

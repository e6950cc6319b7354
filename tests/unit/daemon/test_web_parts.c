/* SPDX-License-Identifier: Apache-2.0 */
/* Ranges, entity tags and paths of HTTP requests. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdio.h>
#include <string.h>

#include "daemon/service/web_parts.h"
#include "net/http1_fields.h"

static struct umbn_http1_text text(const char *string)
{
    return (struct umbn_http1_text){string, strlen(string)};
}

static void ranges_are_resolved_against_the_size(void **state)
{
    static const struct {
        const char *field;
        uint64_t size;
        enum umbn_ranges_result result;
        size_t count;
        struct umb_range ranges[3];
    } cases[] = {
        {"bytes=0-0", 10, UMBN_RANGES_OK, 1, {{0, 1}}},
        {"BYTES=3-", 10, UMBN_RANGES_OK, 1, {{3, 7}}},
        {"bytes=-4", 10, UMBN_RANGES_OK, 1, {{6, 4}}},
        {"bytes=-40", 10, UMBN_RANGES_OK, 1, {{0, 10}}},
        {"bytes=9-99999999999999999999999", 10, UMBN_RANGES_OK, 1, {{9, 1}}},
        {"bytes=0-1,\t4-5 ,8-", 10, UMBN_RANGES_OK, 3, {{0, 2}, {4, 2}, {8, 2}}},
        {"bytes=8-9,0-1", 10, UMBN_RANGES_OK, 2, {{8, 2}, {0, 2}}},
        {"bytes=0-1,10-11", 10, UMBN_RANGES_OK, 1, {{0, 2}}},
        {"bytes=0-4,5-9", 10, UMBN_RANGES_OK, 2, {{0, 5}, {5, 5}}},
        {"bytes=10-", 10, UMBN_RANGES_BEYOND, 0, {{0, 0}}},
        {"bytes=99999999999999999999-", 10, UMBN_RANGES_BEYOND, 0, {{0, 0}}},
        {"bytes=-0", 10, UMBN_RANGES_BEYOND, 0, {{0, 0}}},
        {"bytes=0-", 0, UMBN_RANGES_BEYOND, 0, {{0, 0}}},
        {"bytes=0-4,4-9", 10, UMBN_RANGES_OVERLAP, 2, {{0, 5}, {4, 6}}},
        {"bytes=0-,-1", 10, UMBN_RANGES_OVERLAP, 2, {{0, 10}, {9, 1}}},
        {"pages=0-1", 10, UMBN_RANGES_NONE, 0, {{0, 0}}},
    };
    static const char *const malformed[] = {
        "bytes=",     "bytes=-",    "bytes=1", "bytes=a-b", "bytes=2-1",  "bytes=0-1-2",
        "bytes=0-1,", "bytes=,0-1", "bytes",   "bytes 0-1", "bytes=0 -1", "bytes=0-1;2-3"};
    struct umb_range ranges[UMBN_RANGES_MAX];
    size_t count;
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        assert_int_equal(umbn_ranges_parse(text(cases[i].field), cases[i].size, ranges, &count),
                         cases[i].result);
        assert_int_equal(count, cases[i].count);
        for (size_t k = 0; k < count; k++) {
            assert_int_equal(ranges[k].offset, cases[i].ranges[k].offset);
            assert_int_equal(ranges[k].length, cases[i].ranges[k].length);
        }
    }
    for (size_t i = 0; i < sizeof malformed / sizeof malformed[0]; i++) {
        assert_int_equal(umbn_ranges_parse(text(malformed[i]), 10, ranges, &count),
                         UMBN_RANGES_MALFORMED);
    }
}

static void ranges_are_limited_in_number(void **state)
{
    char field[4096] = "bytes=";
    struct umb_range ranges[UMBN_RANGES_MAX];
    size_t count;
    size_t size = strlen(field);
    (void)state;
    for (unsigned i = 0; i < UMBN_RANGES_MAX; i++) {
        size += (size_t)snprintf(field + size, sizeof field - size, "%s%u-%u", i > 0 ? "," : "",
                                 2 * i, 2 * i);
    }
    assert_int_equal(umbn_ranges_parse(text(field), 1000, ranges, &count), UMBN_RANGES_OK);
    assert_int_equal(count, UMBN_RANGES_MAX);
    (void)snprintf(field + size, sizeof field - size, ",999-");
    assert_int_equal(umbn_ranges_parse(text(field), 1000, ranges, &count), UMBN_RANGES_TOO_MANY);
    /* Ranges that have no byte of the file are counted too. */
    assert_int_equal(umbn_ranges_parse(text(field), 1, ranges, &count), UMBN_RANGES_TOO_MANY);
}

static void tags_are_compared_strongly_or_weakly(void **state)
{
    (void)state;
    assert_int_equal(umbn_tags_have(text("\"a\""), "\"a\"", 0), 1);
    assert_int_equal(umbn_tags_have(text("\"b\" , \"a\""), "\"a\"", 0), 1);
    assert_int_equal(umbn_tags_have(text("W/\"a\""), "\"a\"", 0), 0);
    assert_int_equal(umbn_tags_have(text("W/\"a\""), "\"a\"", 1), 1);
    assert_int_equal(umbn_tags_have(text("*"), "\"a\"", 0), 1);
    assert_int_equal(umbn_tags_have(text("\"b, \"a\""), "\"a\"", 1), 0);
    assert_int_equal(umbn_tags_have(text("\"b,\", \"a\""), "\"a\"", 1), 1);
    assert_int_equal(umbn_tags_have(text("a"), "\"a\"", 1), 0);
    assert_int_equal(umbn_tags_have(text("\"a"), "\"a\"", 1), 0);
    assert_int_equal(umbn_tags_have(text(""), "\"a\"", 1), 0);
    assert_int_equal(umbn_tags_have(text("\"b\", *"), "\"a\"", 1), 0);
}

#define ID "00112233445566778899aabbccddeeff00112233445566778899aabbccddeeff"

static void paths_name_assets_in_one_spelling(void **state)
{
    struct umbd_web_route route;
    char longest[UMBS_STORE_NAME_MAX + 32];
    (void)state;
    assert_int_equal(umbd_web_route(text("/assets/city.umb"), &route), 1);
    assert_string_equal(route.asset, "city");
    assert_int_equal(route.by_id, 0);
    assert_int_equal(umbd_web_route(text("/assets/folder/v1.umb.umb"), &route), 1);
    assert_string_equal(route.asset, "folder/v1.umb");
    assert_int_equal(umbd_web_route(text("/assets/by-id/" ID ".umb"), &route), 1);
    assert_string_equal(route.asset, ID);
    assert_int_equal(route.by_id, 1);
    static const char *const none[] = {
        "/",
        "/assets/",
        "/assets/.umb",
        "/assets/city",
        "/assets/city.UMB",
        "/Assets/city.umb",
        "assets/city.umb",
        "/assets/ci%74y.umb",
        "/assets/ci\\ty.umb",
        "/assets/by-id/city.umb",
        "/assets/by-id/" ID "0.umb",
        "/assets/by-id/0A112233445566778899aabbccddeeff00112233445566778899aabbccddeeff.umb",
        "/assets/by-id/.umb",
    };
    for (size_t i = 0; i < sizeof none / sizeof none[0]; i++) {
        assert_int_equal(umbd_web_route(text(none[i]), &route), 0);
    }
    for (int length = UMBS_STORE_NAME_MAX; length <= UMBS_STORE_NAME_MAX + 1; length++) {
        (void)snprintf(longest, sizeof longest, "/assets/%0*d.umb", length, 0);
        assert_int_equal(umbd_web_route(text(longest), &route), length == UMBS_STORE_NAME_MAX);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(ranges_are_resolved_against_the_size),
        cmocka_unit_test(ranges_are_limited_in_number),
        cmocka_unit_test(tags_are_compared_strongly_or_weakly),
        cmocka_unit_test(paths_name_assets_in_one_spelling),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

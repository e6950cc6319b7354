/* SPDX-License-Identifier: Apache-2.0 */
/* The options of `umbrage query`. Usage errors go to stderr. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "cli/cli_query_options.h"

enum {
    WORDS_MAX = 24
};

/* Splits a line at blanks into argv; "''" is an empty argument. */
struct line {
    char text[256];
    char *words[WORDS_MAX + 1];
    int count;
};

static struct line *split(const char *text)
{
    static struct line line;
    memset(&line, 0, sizeof line);
    assert_true(strlen(text) < sizeof line.text);
    memcpy(line.text, text, strlen(text));
    for (char *at = line.text; *at != '\0';) {
        char *end = at + strcspn(at, " ");
        char *next = *end == '\0' ? end : end + 1;
        *end = '\0';
        assert_true(line.count < WORDS_MAX);
        line.words[line.count++] = strcmp(at, "''") == 0 ? end : at;
        at = next;
    }
    return &line;
}

static void files_are_told_from_assets(void **state)
{
    (void)state;
    assert_true(umbc_is_file("./a"));
    assert_true(umbc_is_file("a/b/c"));
    assert_true(umbc_is_file("missing.umb"));
    assert_true(umbc_is_file("missing.umbm"));
    assert_true(umbc_is_file(".umb")); /* what no asset can be called */
    assert_true(umbc_is_file(""));
    assert_false(umbc_is_file("city"));
    assert_false(umbc_is_file("city/latest"));
    assert_false(umbc_is_file("tests")); /* a folder is no asset file */
}

static int query(const char *text, struct umbc_query_options *parsed)
{
    struct line *line = split(text);
    return umbc_query_options_parse(line->count, line->words, parsed);
}

static void query_options_have_their_defaults(void **state)
{
    struct umbc_query_options parsed;
    (void)state;
    assert_int_equal(query("query city --points -", &parsed), -1);
    assert_string_equal(parsed.target, "city");
    assert_string_equal(parsed.points, "-");
    assert_string_equal(parsed.out, "-");
    assert_null(parsed.session.address);
    assert_int_equal(parsed.format, UMBC_POINTS_TEXT);
    assert_int_equal(parsed.encoding, UMBC_ENCODING_TEXT);
    assert_int_equal(parsed.settings.format, UMB_ANSWER_F32);
    assert_int_equal(parsed.settings.taps, 1);
    assert_int_equal(parsed.settings.bias_mode, UMB_BIAS_AUTO);
    assert_int_equal(parsed.batch, 65536);
    assert_true(parsed.origin[0] == 0 && parsed.origin[1] == 0 && parsed.origin[2] == 0);
}

static void query_options_are_taken(void **state)
{
    struct umbc_query_options parsed;
    (void)state;
    assert_int_equal(query("query a.umb --points p --format f32 --normals --light 3 --taps 17 "
                           "--bias 0.25m --batch 9 --encoding bit -o out",
                           &parsed),
                     -1);
    assert_int_equal(parsed.format, UMBC_POINTS_F32);
    assert_true(parsed.with_normals);
    assert_int_equal(parsed.settings.light, 3);
    assert_int_equal(parsed.settings.taps, 17);
    assert_int_equal(parsed.settings.bias_mode, UMB_BIAS_METRES);
    assert_true(parsed.settings.bias == 0.25);
    assert_int_equal(parsed.batch, 9);
    assert_int_equal(parsed.settings.format, UMB_ANSWER_BIT);
    assert_int_equal(query("query a --points p --bias 1.5vox --origin -1e6,2,3.5", &parsed), -1);
    assert_int_equal(parsed.settings.bias_mode, UMB_BIAS_VOXELS);
    assert_true(parsed.settings.bias == 1.5);
    assert_true(parsed.origin[0] == -1e6 && parsed.origin[1] == 2 && parsed.origin[2] == 3.5);
    assert_int_equal(query("query a --points p --bias none --encoding u8 --json -o f", &parsed),
                     -1);
    assert_int_equal(parsed.settings.bias_mode, UMB_BIAS_NONE);
}

static void volume_queries_and_lists_of_lights_are_taken(void **state)
{
    struct umbc_query_options parsed;
    (void)state;
    assert_int_equal(query("query a.umb --segments s --format f64 --light 2", &parsed), -1);
    assert_int_equal(parsed.volume_query, UMBC_ASK_SEGMENTS);
    assert_string_equal(parsed.points, "s");
    assert_int_equal(parsed.settings.light, 2);
    assert_int_equal(query("query a.umb --columns -", &parsed), -1);
    assert_int_equal(parsed.volume_query, UMBC_ASK_COLUMNS);
    assert_int_equal(query("query a.umb --boxes b", &parsed), -1);
    assert_int_equal(query("query a --boxes b --address tcp:h:1 --opaque-only", &parsed), -1);
    assert_true(parsed.volume_query == UMBC_ASK_BOXES && parsed.settings.opaque_only);
    assert_int_equal(parsed.volume_query, UMBC_ASK_BOXES);
    assert_int_equal(query("query a.umb --points p --light 4,0,7", &parsed), -1);
    assert_int_equal(parsed.light_count, 3);
    assert_int_equal(parsed.settings.light, 4);
    assert_true(parsed.lights[0] == 4 && parsed.lights[1] == 0 && parsed.lights[2] == 7);
    assert_int_equal(query("query a.umb --points p --light all --encoding u8", &parsed), -1);
    assert_true(parsed.all_lights);
    assert_int_equal(query("query a.umb --points p --footprint 0.5 --filter tent", &parsed), -1);
    assert_int_equal(parsed.settings.taps, 0);
    assert_true(parsed.settings.footprint_m == 0.5);
    assert_int_equal(parsed.settings.filter, UMB_FILTER_TENT);
    assert_int_equal(query("query a --points p --filter footprint --taps 5 --footprint 2", &parsed),
                     -1);
    assert_int_equal(parsed.settings.taps, 5);
    assert_true(parsed.settings.footprint_m == 2);
    assert_int_equal(
        query("query a --points p --filter footprint --eye 1,2,3 --pixel 0.01", &parsed), -1);
    assert_true(parsed.settings.eye[2] == 3 && parsed.settings.pixel_rad == 0.01);
    assert_int_equal(query("query a --points p --filter footprint --footprints f", &parsed), -1);
    assert_string_equal(parsed.footprints, "f");
    assert_int_equal(query("query a --points p", &parsed), -1);
    assert_int_equal(parsed.light_count, 1);
}

static void dials_replace_taps(void **state)
{
    struct umbc_query_options parsed;
    (void)state;
    assert_int_equal(query("query a.umb --points p --max-error 0.05", &parsed), -1);
    assert_true(parsed.has_dial && parsed.dial.max_error_m == 0.05 && parsed.settings.taps == 0);
    assert_int_equal(query("query a --points p --budget 50", &parsed), -1);
    assert_true(parsed.dial.budget_ns == 50 && parsed.settings.taps == 0);
    assert_int_equal(query("query a.umb --points p --max-error 0.5m --budget 40ns", &parsed), -1);
    assert_true(parsed.dial.max_error_m == 0.5 && parsed.dial.budget_ns == 40);
    assert_int_equal(query("query a.umb --points p --max-error 0.1vis", &parsed), -1);
    assert_true(parsed.dial.max_visibility == 0.1 && parsed.dial.max_error_m == 0);
    assert_int_equal(query("query a.umb --points p --level 5", &parsed), -1);
    assert_true(!parsed.has_dial && parsed.settings.level == 5 && parsed.settings.taps == 1);
}

static void bad_query_options_are_usage_errors(void **state)
{
    static const char *const bad[] = {
        "query --points p",
        "query a.umb --points p --segments p",
        "query a.umb --boxes p --columns p",
        "query a.umb --segments p --taps 3",
        "query a.umb --segments p --encoding f32",
        "query a.umb --boxes p --explain",
        "query a.umb --columns p --bias none",
        "query a.umb --columns p --light 1,2",
        "query a.umb --points p --taps 3 --footprint 1",
        "query a.umb --points p --footprint 0",
        "query a.umb --points p --footprint x",
        "query a.umb --points p --filter gauss",
        "query a.umb --points p --filter footprint",
        "query a.umb --points p --filter footprint --eye 1,2,3",
        "query a.umb --points p --filter footprint --eye 1,2 --pixel 0.1",
        "query a.umb --points p --filter footprint --eye 1,2,3 --pixel 2",
        "query a.umb --points p --filter footprint --footprint 1 --footprints f",
        "query a.umb --points p --eye 1,2,3 --pixel 0.1",
        "query a.umb --segments p --pixel 0.1",
        "query a.umb --points p --max-error 0",
        "query a.umb --points p --max-error 1km",
        "query a.umb --points p --max-error m",
        "query a.umb --points p --max-error 1 --taps 3",
        "query a.umb --points p --budget -1",
        "query a.umb --points p --budget 5ms",
        "query a.umb --points p --budget 50 --level 3",
        "query a.umb --points p --level x",
        "query a.umb --boxes p --max-error 1",
        "query a --points p --filter penumbra --light-size 0",
        "query a --points p --light-size 1",
        "query a --points p --filter penumbra --light-size 58",
        "query a --points p --filter penumbra --light-size 3m",
        "query a --points p --footprint 1",
        "query a.umb --boxes p --footprint 1",
        "query a.umb --points p --light ''",
        "query a.umb --points p --light 1,",
        "query a.umb --points p --light ,1",
        "query a.umb --points p --light 1,x",
        "query a.umb --points p --light all,1",
        "query a.umb --points p --light 1,2 --explain",
        "query a.umb --points p --light all --encoding bit",
        "query a --points p --light 1,2",
        "query a",
        "query a b --points p",
        "query a --points p --taps 2",
        "query a --points p --taps 0",
        "query a --points p --taps 19",
        "query a --points p --taps -1",
        "query a --points p --light -1",
        "query a --points p --light 4294967296",
        "query a --points p --batch 0",
        "query a --points p --batch 16777217",
        "query a --points p --bias 1",
        "query a --points p --bias m",
        "query a --points p --bias vox",
        "query a --points p --bias nanm",
        "query a --points p --bias 1e999m",
        "query a --points p --bias ''",
        "query a --points p --origin 1,2",
        "query a --points p --origin 1,2,3,4",
        "query a --points p --origin 1,,3",
        "query a --points p --origin 1,2,inf",
        "query a --points p --origin ''",
        "query a --points p --format f16",
        "query a --points p --encoding png",
        "query a --points p --normals",
        "query a --points p --explain",
        "query a.umb --points p --explain --encoding u8",
        "query a --points p --json --encoding u8",
    };
    struct umbc_query_options parsed;
    (void)state;
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        if (query(bad[i], &parsed) != 2) {
            fail_msg("'%s' is not a usage error", bad[i]);
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(files_are_told_from_assets),
        cmocka_unit_test(query_options_have_their_defaults),
        cmocka_unit_test(query_options_are_taken),
        cmocka_unit_test(volume_queries_and_lists_of_lights_are_taken),
        cmocka_unit_test(dials_replace_taps),
        cmocka_unit_test(bad_query_options_are_usage_errors),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

/* SPDX-License-Identifier: Apache-2.0 */
/* Output of the command line: answers, and text that cannot command a terminal. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "cli/cli_answers.h"
#include "cli/cli_query_options.h"

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

static void text_from_strangers_commands_no_terminal(void **state)
{
    FILE *file = open_text();
    char wanted[1024], given[1024];
    (void)state;
    static const char hostile[] = "a\x1b[2J\xc2\x9b\x0d\xff.";
    umbc_print_text(file, hostile, sizeof hostile - 1);
    expect_text(file, "a [2J   ?.");
    /* Pieces of the copy never cut a character. */
    for (size_t shift = 0; shift < 4; shift++) {
        memset(given, 'x', sizeof given);
        for (size_t i = shift; i + 3 < sizeof given - 4; i += 3) {
            memcpy(given + i, "\xe2\x82\xac", 3);
        }
        given[sizeof given - 1] = '\0';
        memcpy(wanted, given, sizeof wanted);
        file = open_text();
        umbc_print_text(file, given, strlen(given));
        expect_text(file, wanted);
    }
}

static void answers_that_are_no_numbers_are_null_in_json(void **state)
{
    char path[] = "umbrage-answers-XXXXXX", content[200] = "";
    const float values[3] = {0.5F, NAN, 1};
    struct umbc_query_options options = {.json = true, .out = path};
    struct umbc_query_total total = {.points = 3};
    struct umbc_answers answers;
    struct umb_error error;
    (void)state;
    assert_true(mkstemp(path) >= 0);
    assert_int_equal(umbc_answers_begin(&options, &answers, &error), UMB_OK);
    assert_true(umbc_answers_put(&answers, &(const void *){values}, 1, 2));
    assert_true(umbc_answers_put(&answers, &(const void *){values + 2}, 1, 1));
    assert_int_equal(umbc_answers_end(&answers, &total, &error), UMB_OK);
    FILE *file = fopen(path, "r");
    assert_non_null(file);
    assert_non_null(fgets(content, sizeof content, file));
    assert_memory_equal(content, "{\"answers\":[0.5,null,1],\"asset\":\"", 33);
    (void)fclose(file);
    (void)unlink(path);
}

static void several_lights_stand_side_by_side(void **state)
{
    static const struct {
        struct umbc_query_options options;
        const char *start;
    } kinds[] = {
        {{.encoding = UMBC_ENCODING_TEXT}, "0.5 0 1\n0.25 1 0.75\n"},
        {{.json = true}, "{\"answers\":[[0.5,0,1],[0.25,1,0.75]],\"asset\":\""},
    };
    const float values[3][2] = {{0.5F, 0.25F}, {0, 1}, {1, 0.75F}};
    const void *const planes[3] = {values[0], values[1], values[2]};
    const uint32_t lights[3] = {4, 0, 2};
    (void)state;
    for (size_t i = 0; i < 2; i++) {
        char path[] = "umbrage-answers-XXXXXX", content[400] = "";
        struct umbc_query_options options = kinds[i].options;
        struct umbc_query_total total = {.points = 2, .lights = lights, .light_count = 3};
        struct umbc_answers answers;
        struct umb_error error;
        options.out = path;
        assert_true(mkstemp(path) >= 0);
        assert_int_equal(umbc_answers_begin(&options, &answers, &error), UMB_OK);
        assert_true(umbc_answers_put(&answers, planes, 3, 2));
        assert_int_equal(umbc_answers_end(&answers, &total, &error), UMB_OK);
        FILE *file = fopen(path, "r");
        assert_non_null(file);
        assert_true(fread(content, 1, sizeof content - 1, file) > 0);
        assert_memory_equal(content, kinds[i].start, strlen(kinds[i].start));
        assert_true(!options.json || strstr(content, "\"lights\":[4,0,2]") != NULL);
        (void)fclose(file);
        (void)unlink(path);
    }
}

static void words_mean_files_or_assets(void **state)
{
    (void)state;
    static const char *const files[] = {".",        "..",        "./city",    "/city", "../a/city",
                                        "city.umb", "city.umbm", "my city",   "",      "city/",
                                        "city/.a",  "a/b/c",     "city/x.umb"};
    static const char *const assets[] = {"city", "city/latest", "a-1_x.v2"};
    for (size_t i = 0; i < sizeof files / sizeof files[0]; i++) {
        assert_true(umbc_is_file(files[i]));
    }
    for (size_t i = 0; i < sizeof assets / sizeof assets[0]; i++) {
        assert_false(umbc_is_file(assets[i]));
    }
}

static void errors_name_the_options_that_people_type(void **state)
{
    (void)state;
    static const char *const pairs[][2] = {
        {"footprint_m: 7, too wide", "--footprint: 7, too wide"},
        {"max_error, budget: no curve", "--max-error, --budget: no curve"},
        {"taps, other: x", "--taps, other: x"},
        {"light_extent: 2 rad", "--light-size: 2 rad"},
        {"footprint_metres: 7", "footprint_metres: 7"},
        {"light 3 is not calibrated", "light 3 is not calibrated"},
        {"", ""},
    };
    for (size_t i = 0; i < sizeof pairs / sizeof pairs[0]; i++) {
        struct umb_error error;
        assert_int_equal(umb_fail(&error, UMB_E_ARGUMENT, "%s", pairs[i][0]), UMB_E_ARGUMENT);
        umbu_name_options(&umbc_query_command, &error);
        assert_string_equal(error.message, pairs[i][1]);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(text_from_strangers_commands_no_terminal),
        cmocka_unit_test(answers_that_are_no_numbers_are_null_in_json),
        cmocka_unit_test(several_lights_stand_side_by_side),
        cmocka_unit_test(words_mean_files_or_assets),
        cmocka_unit_test(errors_name_the_options_that_people_type),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

/* SPDX-License-Identifier: Apache-2.0 */
/* Options by table: every kind of value, every form of a command line, and what is refused. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "tool/bake_settings.h"

struct settings {
    const char *scene, *other, *output;
    bool json, quiet, version;
    int copy, offset;
    uint32_t taps, log2, side[2], kind, mode;
    uint64_t seed, bytes, time_ms;
    double reach, extent, seconds, origin[3];
    const char *list[4];
    const char *executor;
    struct umb_query_settings query;
};
#define AT(field) UMBU_AT(struct settings, field)

static const struct umbu_option OPTIONS[] = {
    {"SCENE", NULL, "the scene", UMBU_TEXT, AT(scene), .needed = true},
    {"OTHER", NULL, "one more", UMBU_TEXT, AT(other)},
    {"output", "FILE", "where to", UMBU_TEXT, AT(output), .letter = 'o'},
    {"json", NULL, "one object", UMBU_FLAG, AT(json), .excludes = "output=-"},
    {"quiet", NULL, "less talk", UMBU_FLAG, AT(quiet), .letter = 'q'},
    {"copy", NULL, "a copy", UMBU_FLAG, AT(copy)},
    {"offset", "N", "signed", UMBU_NUMBER(-10, 10), AT(offset), .standard = "0"},
    {"taps", "N", "width", UMBU_ODD(1, 17), AT(taps), .standard = "3", .fields = "taps|tap_count"},
    {"resolution", "N", "side", UMBU_LOG2(64, 1024), AT(log2), .standard = "64"},
    {"size", "WxH", "pixels", UMBU_SIDES(100), .high = 2000, AT(side), .standard = "4x3"},
    {"kind", "KIND", "which", UMBU_CHOICE("one||three"), AT(kind), .standard = "three"},
    {"mode", "MODE", "rights", UMBU_MODE(0600, 0777), AT(mode), .standard = "0660"},
};
static const struct umbu_option MORE[] = {
    {"seed", "N", "seed", UMBU_COUNT(0, UINT64_MAX), AT(seed)},
    {"memory", "BYTES", "bytes", UMBU_BYTES(1024, (uint64_t)1 << 40), AT(bytes),
     .standard = "64KiB"},
    {"wait", "TIME", "time", UMBU_TIME(0, 3600000), AT(time_ms), .standard = "2s"},
    {"reach", "M", "metres", UMBU_ABOVE(0, HUGE_VAL), .unit = "m", AT(reach), .needs = "kind=one"},
    {"extent", "DEG", "angle", UMBU_ABOVE(0, 90), .unit = "deg", .scale = 2, AT(extent)},
    {"warm-up", "TIME", "time", UMBU_TIME(0, 60000), .above = true, AT(seconds), .standard = "0.5"},
    {"origin", "X,Y,Z", "place", UMBU_NUMBERS(3), AT(origin), .excludes = "reach seed"},
    {"store", "DIR", "folders", UMBU_LIST(3), AT(list)},
    {"executor", NULL, "by", UMBU_CHOICE("local|slurm"), AT(executor), .standard = "local"},
    {"bias", "BIAS", "bias", UMBU_BIAS, AT(query), .needs = "seed|store"},
    {"version", NULL, "the version", UMBU_FLAG, AT(version), .alone = true, .not_in_file = true},
};
static const struct umbu_command COMMAND = {
    .name = "thing",
    .usage = "thing SCENE [OTHER] [options]",
    .summary = "Does.",
    .notes = "Notes.",
    .sections = {{"options", UMBU_ROWS(OPTIONS)}, {"more", UMBU_ROWS(MORE)}}};

static struct settings settings;
static struct umbu_parsed parsed;
static struct umb_error error;

/* Splits a line at blanks and parses; '' is an empty word. */
static enum umb_status parse(const char *line)
{
    static char copy[600];
    char *words[40], program[] = "thing";
    int count = 1;
    words[0] = program;
    (void)snprintf(copy, sizeof copy, "%s", line);
    for (char *at = copy; *at != '\0';) {
        char *end = at + strcspn(at, " ");
        char *next = *end == '\0' ? end : end + 1;
        *end = '\0';
        assert_true(count < 40);
        words[count++] = strcmp(at, "''") == 0 ? end : at;
        at = next;
    }
    memset(&settings, 0, sizeof settings);
    memset(&error, 0, sizeof error);
    return umbu_parse(&parsed, &COMMAND, count, words, &settings, &error);
}

static void defaults_are_read_like_values(void **state)
{
    (void)state;
    assert_int_equal(parse("a"), UMB_OK);
    assert_int_equal(settings.taps, 3);
    assert_int_equal(settings.log2, 6);
    assert_int_equal(settings.kind, 2);
    assert_int_equal(settings.mode, 0660);
    assert_int_equal(settings.bytes, 65536);
    assert_int_equal(settings.time_ms, 2000);
    assert_true(settings.seconds == 0.5 && settings.side[0] == 4 && settings.side[1] == 3);
    assert_string_equal(settings.executor, "local");
    assert_false(umbu_given(&parsed, "taps"));
    assert_true(umbu_given(&parsed, "SCENE"));
}

static void options_may_stand_anywhere_and_in_any_form(void **state)
{
    static const char *const forms[] = {
        "a -o x --json",       "-ox a --json",        "--output x --json a",
        "--output=x a --json", "-o y a --json -o x ", "--json -o x -- a",
    };
    (void)state;
    for (size_t i = 0; i < sizeof forms / sizeof forms[0]; i++) {
        assert_int_equal(parse(forms[i]), UMB_OK);
        assert_string_equal(settings.output, "x");
        assert_true(settings.json && !settings.quiet);
        assert_string_equal(settings.scene, "a");
        assert_null(settings.other);
    }
    assert_int_equal(parse("-o -5 - -- -q"), UMB_OK);
    assert_string_equal(settings.output, "-5");
    assert_string_equal(settings.scene, "-");
    assert_string_equal(settings.other, "-q");
}

static void values_of_every_kind_are_stored(void **state)
{
    (void)state;
    assert_int_equal(
        parse("a --copy --offset -10 --taps 17 --resolution 1024 --size 100x1 --kind one "
              "--mode 600 --seed 18446744073709551615 --memory 1TiB --wait 0.25s --reach 2e3m "
              "--extent 45deg --warm-up 1m --store x --store y --executor slurm --bias 1.5vox"),
        UMB_OK);
    assert_true(settings.copy == 1 && settings.offset == -10 && settings.taps == 17);
    assert_true(settings.log2 == 10 && settings.side[0] == 100 && settings.kind == 0);
    assert_true(settings.mode == 0600 && settings.seed == UINT64_MAX);
    assert_true(settings.bytes == (uint64_t)1 << 40 && settings.time_ms == 250);
    assert_true(settings.reach == 2000 && settings.extent == 90 && settings.seconds == 60);
    assert_string_equal(settings.list[1], "y");
    assert_null(settings.list[2]);
    assert_string_equal(settings.executor, "slurm");
    assert_true(settings.query.bias_mode == UMB_BIAS_VOXELS && settings.query.bias == 1.5);
    assert_int_equal(parse("a --origin -1e6,2,.5 --memory 64K --wait 1m"), UMB_OK);
    assert_true(settings.origin[0] == -1e6 && settings.origin[2] == 0.5);
    assert_true(settings.bytes == 65536 && settings.time_ms == 60000);
}

static void sizes_and_biases_have_limits(void **state)
{
    static const char *const sizes[] = {"''",  "12",       "0x1",  "1x0",    "101x1", "1.5x2",
                                        "12x", "12x3 x y", "-1x1", "0x10x5", "50x41"};
    static const char *const biases[] = {"''",  "1",    "-1m",  "2000000m", "1mm",
                                         "vox", "nanm", "0x1m", "1e999m",   "m"};
    char line[100];
    (void)state;
    for (size_t i = 0; i < sizeof sizes / sizeof sizes[0]; i++) {
        (void)snprintf(line, sizeof line, "a --size %s", sizes[i]);
        assert_int_equal(parse(line), UMB_E_ARGUMENT);
    }
    for (size_t i = 0; i < sizeof biases / sizeof biases[0]; i++) {
        (void)snprintf(line, sizeof line, "a --seed 1 --bias %s", biases[i]);
        assert_int_equal(parse(line), UMB_E_ARGUMENT);
    }
    assert_int_equal(parse("a --size 50x40 --seed 1 --bias 0.02m"), UMB_OK);
    assert_true(settings.query.bias_mode == UMB_BIAS_METRES && settings.query.bias == 0.02);
    assert_int_equal(parse("a --seed 1 --bias none"), UMB_OK);
    assert_int_equal(settings.query.bias_mode, UMB_BIAS_NONE);
}

/* 16.1 * 1000 and others are no integers in binary. */
static void times_with_a_fraction_are_whole_milliseconds(void **state)
{
    char line[60];
    (void)state;
    for (unsigned tenths = 0; tenths < 36000; tenths++) {
        (void)snprintf(line, sizeof line, "a --seed 1 --wait %u.%us", tenths / 10, tenths % 10);
        assert_int_equal(parse(line), UMB_OK);
        assert_int_equal(settings.time_ms, tenths * 100);
    }
    assert_int_equal(parse("a --seed 1 --wait 0.0001s"), UMB_E_ARGUMENT);
}

/* Texts that are no number, size or time. */
static void hostile_values_are_refused_by_every_kind(void **state)
{
    static const char *const options[] = {"offset", "taps",    "resolution", "size",     "kind",
                                          "mode",   "seed",    "memory",     "wait",     "reach",
                                          "extent", "warm-up", "origin",     "executor", "bias"};
    static const char *const values[] = {"''",
                                         "nan",
                                         "inf",
                                         "-inf",
                                         "NaN",
                                         "1e999",
                                         "0x10",
                                         "1e",
                                         "--1",
                                         "+",
                                         "-",
                                         ".",
                                         "e5",
                                         "1,5",
                                         "1\t",
                                         "1;",
                                         "\xff\xfe",
                                         "\xc2\x9b",
                                         "99999999999999999999999999999999999999999x",
                                         "%s%n",
                                         "18446744073709551616y",
                                         "1vis"};
    char line[200];
    (void)state;
    for (size_t i = 0; i < sizeof options / sizeof options[0]; i++) {
        for (size_t k = 0; k < sizeof values / sizeof values[0]; k++) {
            (void)snprintf(line, sizeof line, "a --%s %s", options[i], values[k]);
            if (parse(line) != UMB_E_ARGUMENT || strncmp(error.message, "--", 2) != 0 ||
                strstr(error.message, options[i]) == NULL ||
                strstr(error.message, "; give ") == NULL) {
                fail_msg("'%s': '%s'", line, error.message);
            }
        }
    }
}

static void refusals_name_option_value_and_what_to_give(void **state)
{
    static const struct {
        const char *line, *message;
    } cases[] = {
        {"a --taps 4", "--taps: '4' is not valid; give an odd number from 1 to 17"},
        {"a --taps 19", "--taps: '19' is not valid; give an odd number from 1 to 17"},
        {"a --taps", "--taps: needs a value; give an odd number from 1 to 17"},
        {"a --resolution 100",
         "--resolution: '100' is not valid; give a power of two from 64 to 1024"},
        {"a --kind ''", "--kind: '' is not valid; give one or three"},
        {"a --kind two", "--kind: 'two' is not valid; give one or three"},
        {"a --offset 1.5", "--offset: '1.5' is not valid; give a whole number from -10 to 10"},
        {"a --reach -1", "--reach: '-1' is not valid; give a number above 0 (m)"},
        {"a --extent 90.1deg",
         "--extent: '90.1deg' is not valid; give a number above 0 and at most 90 (deg)"},
        {"a --memory 1023", "--memory: '1023' is not valid; give a size from 1KiB to 1TiB (bytes, "
                            "KiB, MiB, GiB, TiB)"},
        {"a --wait 61m", "--wait: '61m' is not valid; give a time from 0ms to 60m (ms, s, m; bare: "
                         "seconds)"},
        {"a --wait 0.5ms", "--wait: '0.5ms' is not valid; give a time from 0ms to 60m (ms, s, m; "
                           "bare: seconds)"},
        {"a --size 101x1", "--size: '101x1' is not valid; give WIDTHxHEIGHT, each from 1 to 100, "
                           "together at most 2000"},
        {"a --mode 0060", "--mode: '0060' is not valid; give an octal mode from 0600 to 0777"},
        {"a --origin 1,2", "--origin: '1,2' is not valid; give 3 finite numbers X,Y,Z"},
        {"a --store ''", "--store: '' is not valid; give DIR, not empty"},
        {"a --store 1 --store 2 --store 3 --store 4",
         "--store: '4' is one too many; give at most 3"},
        {"a --json=1", "--json: takes no value, but has one"},
        {"a -q1", "--quiet: takes no value, but has one"},
        {"a --outpu x", "option '--outpu' is not known; see --help"},
        {"a --outputs=x", "option '--outputs=x' is not known; see --help"},
        {"a -o=x", "option '-o=x' is not known; see --help"},
        {"a -x", "option '-x' is not known; see --help"},
        {"a ---", "option '---' is not known; see --help"},
        {"a --=x", "option '--=x' is not known; see --help"},
        {"a --SCENE x", "option '--SCENE' is not known; see --help"},
        {"", "SCENE: is needed; see --help"},
        {"''", "SCENE: '' is not valid; give SCENE, not empty"},
        {"a b c", "argument 'c' is one too many; give at most 2; see --help"},
        {"a --reach 1", "--reach: needs --kind one"},
        {"a --bias none", "--bias: needs --seed or --store"},
        {"a --origin 1,2,3 --seed 1", "--origin: does not go with --seed; give one"},
        {"a --json -o -", "--json: does not go with --output -; give one"},
    };
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        assert_int_equal(parse(cases[i].line), UMB_E_ARGUMENT);
        assert_string_equal(error.message, cases[i].message);
    }
}

static void help_and_options_that_stand_alone_need_nothing_else(void **state)
{
    (void)state;
    assert_int_equal(parse("--help"), UMB_OK);
    assert_true(parsed.help);
    assert_int_equal(parse("-h --nonsense"), UMB_OK);
    assert_int_equal(parse("--version --nonsense"), UMB_OK);
    assert_true(settings.version && parsed.alone != NULL);
    assert_int_equal(parse("-- --help"), UMB_OK);
    assert_false(parsed.help);
    assert_string_equal(settings.scene, "--help");
}

static void a_later_source_replaces_lists_and_values(void **state)
{
    char program[] = "thing", store[] = "--store=c", scene[] = "s";
    char *words[] = {program, store, scene};
    (void)state;
    memset(&settings, 0, sizeof settings);
    umbu_begin(&parsed, &COMMAND, &settings);
    assert_int_equal(umbu_take_setting(&parsed, "store", "a", &error), UMB_OK);
    assert_int_equal(umbu_take_setting(&parsed, "store", "b", &error), UMB_OK);
    assert_int_equal(umbu_take_setting(&parsed, "json", "true", &error), UMB_OK);
    assert_int_equal(umbu_take_setting(&parsed, "copy", "yes", &error), UMB_E_ARGUMENT);
    assert_int_equal(umbu_take_setting(&parsed, "json", "true", &error), UMB_E_ARGUMENT);
    assert_string_equal(error.message, "'json' is given twice; give it once");
    static const char *const unknown[] = {"version", "SCENE", "nothing", ""};
    for (size_t i = 0; i < 4; i++) {
        assert_int_equal(umbu_take_setting(&parsed, unknown[i], "x", &error), UMB_E_ARGUMENT);
    }
    assert_int_equal(umbu_take_arguments(&parsed, 3, words, &error), UMB_OK);
    assert_string_equal(settings.list[0], "c");
    assert_null(settings.list[1]);
    assert_true(settings.json);
}

/* What a function prints; freed by the next call. */
static const char *printed(void (*print)(FILE *))
{
    static char *text;
    size_t size;
    free(text);
    text = NULL;
    FILE *file = open_memstream(&text, &size);
    assert_non_null(file);
    print(file);
    assert_int_equal(fclose(file), 0);
    return text;
}

static void print_settings(FILE *file)
{
    umbu_print_settings(&COMMAND, &settings, 60, file);
}

static void print_help(FILE *file)
{
    umbu_print_help(&COMMAND, file);
}

static void print_rows(FILE *file)
{
    umbu_print_rows(&COMMAND, file);
}

static void settings_are_printed_as_they_are_read(void **state)
{
    static const char *const lines[] = {
        "taps = 5\n",    "wait = 250ms\n",        "mode = 0600\n",    "; output = \n",
        "json = true\n", "kind = one\n",          "memory = 65536\n", "executor = local\n",
        "seed = 7\n",    "store = a\nstore=; b\n"};
    (void)state;
    assert_int_equal(parse("s --taps 5 --wait 250ms --mode 600 --json --kind one --seed 7"),
                     UMB_OK);
    settings.list[0] = "a";
    settings.list[1] = "; b";
    const char *text = printed(print_settings);
    for (size_t i = 0; i < sizeof lines / sizeof lines[0]; i++) {
        assert_non_null(strstr(text, lines[i]));
    }
    assert_null(strstr(text, "version"));
    assert_null(strstr(text, "SCENE"));
}

static void help_has_every_option_and_fits_eighty_columns(void **state)
{
    (void)state;
    const char *text = printed(print_help);
    assert_non_null(strstr(text, "usage: thing SCENE [OTHER] [options]\n\nDoes.\n\noptions:\n"));
    assert_non_null(strstr(text, "\n  -o, --output FILE       where to\n"));
    assert_non_null(strstr(text, "width: an odd number from 1 to 17 (default: 3)\n"));
    assert_non_null(strstr(text, "\n  -h, --help              this text\n\nmore:\n"));
    assert_non_null(strstr(text, "\n  --executor local|slurm  by (default: local)\n"));
    assert_non_null(strstr(text, "\n\nNotes.\n"));
    for (const char *at = text; *at != '\0'; at += strcspn(at, "\n") + 1) {
        assert_true(strcspn(at, "\n") <= 80);
    }
    assert_non_null(strstr(printed(print_rows),
                           "thing\t--kind\t\tKIND\tchoice\tone||three\tthree\tfile\twhich\n"));
}

static void errors_of_the_library_name_the_option(void **state)
{
    static const char *const pairs[][2] = {
        {"tap_count: 4 is even", "--taps: 4 is even"},
        {"taps, tap_count: x", "--taps, --taps: x"},
        {"taps, other: x", "--taps, other: x"},
        {"other: x", "other: x"},
        {"", ""},
    };
    (void)state;
    for (size_t i = 0; i < sizeof pairs / sizeof pairs[0]; i++) {
        assert_int_equal(umb_fail(&error, UMB_E_ARGUMENT, "%s", pairs[i][0]), UMB_E_ARGUMENT);
        umbu_name_options(&COMMAND, &error);
        assert_string_equal(error.message, pairs[i][1]);
    }
}

/* Returns whether a table of one row ends the program. */
static bool is_refused(const struct umbu_option *row)
{
    const struct umbu_command command = {.name = "x", .sections = {{"options", row, 1, 0}}};
    int state;
    const pid_t child = fork();
    assert_true(child >= 0);
    if (child == 0) {
        umbu_begin(&parsed, &command, &settings);
        _exit(0);
    }
    assert_int_equal(waitpid(child, &state, 0), child);
    return WIFSIGNALED(state) && WTERMSIG(state) == SIGABRT;
}

static void tables_that_do_not_fit_their_fields_end_the_program(void **state)
{
    static const struct umbu_option bad[] = {
        {"a", "N", "count in a double", UMBU_COUNT(0, 9), AT(reach)},
        {"a", "N", "too wide", UMBU_COUNT(0, UINT64_MAX), AT(taps)},
        {"a", "N", "number in an integer", UMBU_NUMBER(0, 9), AT(taps)},
        {"a", NULL, "flag in a text", UMBU_FLAG, AT(scene)},
        {"a", "X", "text in a list", UMBU_TEXT, AT(list)},
        {"a", "X", "list in a text", UMBU_LIST(3), AT(scene)},
        {"a", "X,Y", "numbers in a number", UMBU_NUMBERS(2), AT(reach)},
        {"a", "WxH", "sides in an integer", UMBU_SIDES(9), AT(taps)},
        {"a", "X", "no reader", UMBU_READ(NULL, "x"), AT(query)},
        {"a", "N", "bad standard", UMBU_COUNT(1, 9), AT(taps), .standard = "0"},
    };
    static const struct umbu_option good = {"a", "N", "count", UMBU_COUNT(0, 9), AT(taps)};
    (void)state;
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        assert_true(is_refused(&bad[i]));
    }
    assert_false(is_refused(&good));
}

static void bake_settings_are_collected_in_their_order(void **state)
{
    static const struct umbu_command submit = {
        .name = "submit",
        .sections = {{"bake options", UMBU_BAKE_SETTINGS, UMBU_BAKE_SETTING_COUNT, 0}}};
    char program[] = "submit", sun[] = "--sun=1,2", still[] = "--static", again[] = "--sun=3,4",
         empty[] = "--sun=", value[] = "--static=1";
    char *words[] = {program, sun, still, again, NULL};
    static struct umbu_bake_settings collected;
    (void)state;
    assert_int_equal(umbu_parse(&parsed, &submit, 4, words, &collected, &error), UMB_OK);
    assert_int_equal(collected.count, 3);
    assert_string_equal(collected.list[0].name, "sun");
    assert_string_equal(collected.list[1].value, "");
    assert_string_equal(collected.list[2].value, "3,4");
    words[1] = empty;
    assert_int_equal(umbu_parse(&parsed, &submit, 2, words, &collected, &error), UMB_E_ARGUMENT);
    words[1] = value;
    assert_int_equal(umbu_parse(&parsed, &submit, 2, words, &collected, &error), UMB_E_ARGUMENT);
    assert_non_null(umbu_bake_setting("max-error"));
    assert_null(umbu_bake_setting("threads"));
}

/* Rows of settings supply what a row leaves out; "*" stands for a row for each of the others. */
static void settings_of_queries_are_options(void **state)
{
    static const struct umbu_option rows[] = {
        {.setting = "taps", AT(taps), .standard = "3"},
        {"width", "M", "width", .setting = "footprint_m", AT(reach), .unit = "m"},
        {UMBU_LIGHT_SIZE_ROW(struct settings, query.light_extent)},
        {UMBU_BIAS_ROW(struct settings, query)},
        {UMBU_OTHER_SETTINGS(struct settings, query, "format|eye"), .needs = "width"},
    };
    static const struct umbu_command command = {
        .name = "thing", .sections = {{"options", UMBU_ROWS(rows)}, {"more", UMBU_ROWS(MORE)}}};
    static char *good[] = {
        "thing",         "--width",   "2.5m",     "--light-size", "45deg",       "--pixel-rad", "1",
        "--opaque-only", "--level=5", "--filter", "tent",         "--bias=2vox", "--seed=7"};
    static char *bad[][3] = {{"thing", "--width=1", "--pixel-rad=1.5"},
                             {"thing", "--width=0"},
                             {"thing", "--taps=19"},
                             {"thing", "--light-size=57.3"},
                             {"thing", "--level=5"},
                             {"thing", "--width=1", "--filter=gauss"},
                             {"thing", "--width=1", "--eye=1,2,3"},
                             {"thing", "--width=1", "--bias-mode=none"}};
    (void)state;
    memset(&settings, 0, sizeof settings);
    assert_int_equal(
        umbu_parse(&parsed, &command, sizeof good / sizeof good[0], good, &settings, &error),
        UMB_OK);
    assert_int_equal(settings.taps, 3);
    assert_true(settings.reach == 2.5 && settings.query.pixel_rad == 1);
    assert_true(fabs(settings.query.light_extent - 0.7853981633974483) < 1e-15);
    assert_int_equal(settings.query.level, 5);
    assert_int_equal(settings.query.filter, UMB_FILTER_TENT);
    assert_true(settings.query.opaque_only && settings.query.bias == 2);
    assert_int_equal(settings.seed, 7);
    assert_true(umbu_given(&parsed, "seed") && !umbu_given(&parsed, "light"));
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        const int count = bad[i][2] != NULL ? 3 : 2;
        if (umbu_parse(&parsed, &command, count, bad[i], &settings, &error) != UMB_E_ARGUMENT) {
            fail_msg("%s %s is taken", bad[i][1], bad[i][2]);
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(defaults_are_read_like_values),
        cmocka_unit_test(options_may_stand_anywhere_and_in_any_form),
        cmocka_unit_test(values_of_every_kind_are_stored),
        cmocka_unit_test(sizes_and_biases_have_limits),
        cmocka_unit_test(times_with_a_fraction_are_whole_milliseconds),
        cmocka_unit_test(hostile_values_are_refused_by_every_kind),
        cmocka_unit_test(refusals_name_option_value_and_what_to_give),
        cmocka_unit_test(help_and_options_that_stand_alone_need_nothing_else),
        cmocka_unit_test(a_later_source_replaces_lists_and_values),
        cmocka_unit_test(settings_are_printed_as_they_are_read),
        cmocka_unit_test(help_has_every_option_and_fits_eighty_columns),
        cmocka_unit_test(errors_of_the_library_name_the_option),
        cmocka_unit_test(tables_that_do_not_fit_their_fields_end_the_program),
        cmocka_unit_test(bake_settings_are_collected_in_their_order),
        cmocka_unit_test(settings_of_queries_are_options),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

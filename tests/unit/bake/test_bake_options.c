/* SPDX-License-Identifier: Apache-2.0 */
/* The command line of umbrage-bake: what it accepts and refuses. A refusal must name the option and
 * the value. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <stdio.h>
#include <string.h>

#include "bake/options/bake_options.h"
#include "tool/exit_code.h"

#define MAX_WORDS 16

/* Splits at blanks and parses. */
static enum umb_status parse(const char *line, struct umbb_options *options,
                             struct umb_error *error)
{
    static char copy[512];
    char *words[MAX_WORDS];
    char program[] = "umbrage-bake";
    int count = 1;
    assert_true(strlen(line) < sizeof copy);
    memcpy(copy, line, strlen(line) + 1);
    words[0] = program;
    for (char *at = copy; *at != '\0';) {
        assert_true(count < MAX_WORDS);
        words[count++] = at;
        at += strcspn(at, " ");
        if (*at == ' ') {
            *at++ = '\0';
        }
    }
    memset(error, 0, sizeof *error);
    return umbb_options_parse(count, words, options, error);
}

static void defaults_are_those_of_the_manual(void **state)
{
    (void)state;
    struct umbb_options o;
    struct umb_error e;
    assert_int_equal(parse("city.obj -o city.umb", &o, &e), UMB_OK);
    assert_string_equal(o.scene, "city.obj");
    assert_string_equal(o.output, "city.umb");
    assert_int_equal(o.resolution_log2, 14);
    assert_int_equal(o.tile_log2, 12);
    assert_int_equal(o.memory_bytes, (uint64_t)4 << 30);
    assert_int_equal(o.verify_points, 1000000);
    assert_int_equal(o.closed, UMBB_CLOSED_AUTO);
    assert_int_equal(o.depth, UMBB_DEPTH_AUTO);
    assert_int_equal(o.up, UMBB_UP_OF_SCENE);
    assert_true(o.threads >= 1 && o.threads <= UMBB_THREADS_MAX);
    assert_false(o.lights.count > 0 || o.plan || o.json || o.quiet);
    assert_false(o.lights.has_size_m || o.lights.has_size_deg);
}

static void every_option_is_read_with_blank_or_equals_sign(void **state)
{
    (void)state;
    static const char *const lines[] = {
        "s.ply --output o.umb --resolution 64 --sun -90,12.5 --up y --closed on --threads 256 "
        "--json",
        "s.ply --output=o.umb --resolution=64 --sun=-90,12.5 --up=y --closed=on --threads=256 "
        "--json",
    };
    for (size_t i = 0; i < 2; i++) {
        struct umbb_options o;
        struct umb_error e;
        assert_int_equal(parse(lines[i], &o, &e), UMB_OK);
        assert_string_equal(o.output, "o.umb");
        assert_int_equal(o.resolution_log2, 6);
        assert_int_equal(o.tile_log2, 6); /* never larger than the resolution */
        assert_int_equal(o.lights.count, 1);
        assert_int_equal(o.lights.items[0].kind, UMBB_REQUEST_SUN);
        assert_true(o.lights.items[0].azimuth_deg == -90.0);
        assert_true(o.lights.items[0].elevation_deg == 12.5);
        assert_int_equal(o.up, UMBB_UP_Y);
        assert_int_equal(o.closed, UMBB_CLOSED_ON);
        assert_int_equal(o.threads, 256);
        assert_true(o.json);
    }
    struct umbb_options o;
    struct umb_error e;
    assert_int_equal(parse("--memory 900MiB --tile 128 --depth embree --verify 0 --light Key "
                           "--quiet -o x -- -odd-name",
                           &o, &e),
                     UMB_OK);
    assert_int_equal(o.memory_bytes, (uint64_t)900 << 20);
    assert_int_equal(o.tile_log2, 7);
    assert_int_equal(o.depth, UMBB_DEPTH_EMBREE);
    assert_int_equal(o.verify_points, 0);
    assert_int_equal(o.lights.items[0].kind, UMBB_REQUEST_NAME);
    assert_string_equal(o.lights.items[0].name, "Key");
    assert_string_equal(o.scene, "-odd-name");
}

static void tile_and_merge_are_tasks_with_options_of_their_own(void **state)
{
    (void)state;
    struct umbb_options o;
    struct umb_error e;
    assert_int_equal(parse("s.ply -o o --cache c --cache-size 3MiB", &o, &e), UMB_OK);
    assert_int_equal(o.task, UMBB_TASK_BAKE);
    assert_string_equal(o.cache, "c");
    assert_int_equal(o.cache_bytes, 3 << 20);
    assert_int_equal(parse("tile s.ply -o d --only 5-17", &o, &e), UMB_OK);
    assert_int_equal(o.task, UMBB_TASK_TILE);
    assert_string_equal(o.scene, "s.ply");
    assert_int_equal(o.only_first, 5);
    assert_int_equal(o.only_last, 17);
    assert_int_equal(parse("tile s.ply -o d --only 5", &o, &e), UMB_OK);
    assert_int_equal(o.only_last, 5);
    assert_int_equal(parse("merge s.ply --from d -o o", &o, &e), UMB_OK);
    assert_int_equal(o.task, UMBB_TASK_MERGE);
    assert_string_equal(o.from, "d");
    assert_int_equal(parse("./tile -o d", &o, &e), UMB_OK); /* a scene of that name */
    assert_int_equal(o.task, UMBB_TASK_BAKE);
}

static void lights_are_kept_in_the_order_given(void **state)
{
    (void)state;
    struct umbb_options o;
    struct umb_error e;
    assert_int_equal(parse("s -o o --sun 1,2 --light A --sun-path -33.5,151.25,2024-02-29,7.5 "
                           "--sun 3,4",
                           &o, &e),
                     UMB_OK);
    assert_int_equal(o.lights.count, 4);
    assert_true(o.lights.items[0].azimuth_deg == 1.0 && o.lights.items[3].azimuth_deg == 3.0);
    assert_string_equal(o.lights.items[1].name, "A");
    const struct umbb_sun_path *path = &o.lights.items[2].path;
    assert_int_equal(o.lights.items[2].kind, UMBB_REQUEST_PATH);
    assert_true(path->latitude_deg == -33.5 && path->longitude_deg == 151.25);
    assert_true(path->year == 2024 && path->month == 2 && path->day == 29);
    assert_true(path->step_minutes == 7.5);
    assert_int_equal(parse("s -o o --point 1,-2,3e6 --spot 1,2,3,0,0,-4,30 --light-size 0.25m "
                           "--light-size 2deg",
                           &o, &e),
                     UMB_OK);
    assert_int_equal(o.lights.items[0].kind, UMBB_REQUEST_POINT);
    assert_true(o.lights.items[0].position[1] == -2.0 && o.lights.items[0].position[2] == 3e6);
    assert_int_equal(o.lights.items[1].kind, UMBB_REQUEST_SPOT);
    assert_true(o.lights.items[1].direction[2] == -4.0 && o.lights.items[1].half_deg == 30.0);
    assert_true(o.lights.has_size_m && o.lights.size_m == 0.25);
    assert_true(o.lights.has_size_deg && o.lights.size_deg == 2.0);
    assert_int_equal(parse("s -o o --area 1,2,3,0,0,-4,0.5 --area 1,2,3,0,0,-4,2,1 "
                           "--area 1,2,3,0,0,-4,2,1,0,5,0",
                           &o, &e),
                     UMB_OK);
    const struct umbb_light_request *areas = o.lights.items;
    assert_true(areas[0].width == 0.0 && areas[0].height == 0.5 && areas[0].axis[1] == 0.0);
    assert_true(areas[1].kind == UMBB_REQUEST_AREA && areas[1].position[2] == 3.0);
    assert_true(areas[1].width == 2.0 && areas[1].height == 1.0 && areas[1].axis[1] == 0.0);
    assert_true(areas[2].direction[2] == -4.0 && areas[2].axis[1] == 5.0);
}

static void more_lights_than_there_is_room_for_are_refused(void **state)
{
    (void)state;
    static char *words[2 * UMBB_LIGHT_REQUESTS_MAX + 8];
    int count = 0;
    struct umbb_options o;
    struct umb_error e;
    static char program[] = "umbrage-bake", scene[] = "s", option[] = "--sun", value[] = "1,2";
    words[count++] = program;
    words[count++] = scene;
    for (unsigned i = 0; i <= UMBB_LIGHT_REQUESTS_MAX; i++) {
        words[count++] = option;
        words[count++] = value;
    }
    assert_int_equal(umbb_options_parse(count, words, &o, &e), UMB_E_ARGUMENT);
    assert_non_null(strstr(e.message, "at most 512 lights"));
}

static void help_version_and_plan_need_no_output(void **state)
{
    (void)state;
    struct umbb_options o;
    struct umb_error e;
    assert_int_equal(parse("--help", &o, &e), UMB_OK);
    assert_true(o.help);
    assert_int_equal(parse("--version", &o, &e), UMB_OK);
    assert_true(o.version);
    assert_int_equal(parse("s.obj --plan", &o, &e), UMB_OK);
    assert_true(o.plan);
    assert_int_equal(parse("import s.obj --plan", &o, &e), UMB_OK);
    assert_true(o.plan && o.task == UMBB_TASK_IMPORT);
}

/* A line is refused with a message that names both. */
static void assert_refused(const char *line, const char *option, const char *value)
{
    struct umbb_options o;
    struct umb_error e;
    const enum umb_status status = parse(line, &o, &e);
    if (status != UMB_E_ARGUMENT || strstr(e.message, option) == NULL ||
        strstr(e.message, value) == NULL) {
        fail_msg("'%s': status %d, message '%s'", line, (int)status, e.message);
    }
    assert_int_equal(umbu_exit_code(status), 2);
}

static void options_of_tiles_are_refused_where_they_mean_nothing(void **state)
{
    (void)state;
    static const struct {
        const char *line, *option, *value;
    } cases[] = {
        {"s -o o --cache=", "--cache", "''"},
        {"s -o o --cache c --cache-size 1KiB", "--cache-size", "1KiB"},
        {"s -o o --cache c --depth embree", "--depth", "embree"},
        {"s -o o --only 3", "--only", "umbrage-bake tile"},
        {"s -o o --from d", "--from", "umbrage-bake merge"},
        {"tile s -o d --only 3-", "--only", "'3-'"},
        {"tile s -o d --only 4-3", "--only", "'4-3'"},
        {"tile s -o d --only -1", "--only", "'-1'"},
        {"tile s -o d --cache c", "--cache", "folder"},
        {"tile s -o d --depth embree", "--depth", "embree"},
        {"tile s", "-o", "no output"},
        {"import s", "-o", "no output"},
        {"merge s -o o", "--from", "is needed"},
        {"s --scene-buffer b -o o", "SCENE", "'b'"},
        {"--scene-buffer b s -o o", "SCENE", "'s'"},
        {"--scene-buffer b --scene-buffer c -o o", "SCENE", "'c'"},
        {"--scene-buffer= -o o", "--scene-buffer", "''"},
        {"import --scene-buffer b -o o", "--scene-buffer", "'b'"},
        {"s -o o --sandbox on", "--sandbox", "'on'"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        assert_refused(cases[i].line, cases[i].option, cases[i].value);
    }
}

static void a_scene_buffer_is_asked_for_by_name(void **state)
{
    static const char *const tasks[] = {"", "--plan ", "tile ", "merge --from d "};
    static const char *const modes[] = {"available", "required", "off"};
    struct umbb_options o;
    struct umb_error e;
    char line[200];
    (void)state;
    for (int i = 0; i < 4; i++) {
        snprintf(line, sizeof line, "%s-o o --scene-buffer=b", tasks[i]);
        assert_int_equal(parse(line, &o, &e), UMB_OK);
        assert_int_equal(o.scene_buffer, 1);
        assert_string_equal(o.scene, "b");
        assert_int_equal(o.sandbox, UMBB_SANDBOX_AVAILABLE);
    }
    for (int i = 0; i < 3; i++) {
        snprintf(line, sizeof line, "s -o o --sandbox %s", modes[i]);
        assert_int_equal(parse(line, &o, &e), UMB_OK);
        assert_int_equal(o.scene_buffer, 0);
        assert_int_equal(o.sandbox, i);
    }
}

static void effects_are_overruled_by_name(void **state)
{
    (void)state;
    struct umbb_options o;
    struct umb_error e;
    assert_int_equal(parse("s.ply -o o --effect closed=on", &o, &e), UMB_OK);
    assert_int_equal(o.closed, UMBB_CLOSED_ON);
    assert_int_equal(o.opaque_translucents, 0);
    assert_int_equal(parse("s.ply -o o --closed on --effect=closed=off", &o, &e), UMB_OK);
    assert_int_equal(o.closed, UMBB_CLOSED_OFF);
    assert_int_equal(
        parse("s.ply -o o --effect cut-out=off --effect penumbra=off --effect mraa=off", &o, &e),
        UMB_OK);
    assert_int_equal(o.opaque_translucents, 0);
    assert_int_equal(o.opaque_cut_outs, 1);
    assert_int_equal(o.penumbra, UMBB_PENUMBRA_OFF);
    assert_int_equal(o.occluder_depth, 0);
    assert_int_equal(parse("s.ply -o o --effect cut-out=on", &o, &e), UMB_OK);
    assert_int_equal(o.opaque_cut_outs, 0);
    assert_int_equal(parse("s.ply -o o --effect transmittance=off", &o, &e), UMB_OK);
    assert_int_equal(o.opaque_translucents, 1);
    assert_int_equal(parse("s.ply -o o --effect=transmittance=on", &o, &e), UMB_OK);
    assert_int_equal(o.opaque_translucents, 0);
    assert_int_equal(parse("s.ply -o o --effect penumbra=on", &o, &e), UMB_OK);
    assert_true(o.penumbra == UMBB_PENUMBRA_ON && o.occluder_depth);
    assert_int_equal(parse("s.ply -o o --effect penumbra=on --effect penumbra=off", &o, &e),
                     UMB_OK);
    assert_true(o.penumbra == UMBB_PENUMBRA_OFF && !o.occluder_depth);
    assert_int_equal(
        parse("s.ply -o o --closed off --effect penumbra=on --effect front=off", &o, &e), UMB_OK);
    assert_true(o.penumbra == UMBB_PENUMBRA_ON && !o.occluder_depth);
    assert_int_equal(parse("s.ply -o o", &o, &e), UMB_OK);
    assert_true(o.penumbra == UMBB_PENUMBRA_AUTO && !o.occluder_depth);
    assert_int_equal(o.closed, UMBB_CLOSED_AUTO);
    assert_int_equal(parse("tile s -o o --effect penumbra=on", &o, &e), UMB_OK);
    assert_true(o.occluder_depth);
    static const struct {
        const char *line, *value;
    } cases[] = {
        {"s -o o --effect closed", "'closed' is not valid; give NAME=on or NAME=off"},
        {"s -o o --effect closed=auto", "'closed=auto' is not valid; give NAME=on"},
        {"s -o o --effect =on", "'=on' is not valid; give NAME=on or NAME=off"},
        {"s -o o --effect close=on", "'close=on' is not valid; give NAME=on or NAME=off"},
        {"s -o o --effect suns=off", "'suns=off': the effect follows from the lights"},
        {"s -o o --effect mraa=on", "this version does not have the effect"},
        {"s -o o --effect voaa=on", "this version does not have the effect"},
        {"s -o o --effect front=off --effect penumbra=on", "'front=off' leaves out"},
        {"s -o o --effect penumbra=on --effect front=off", "'front=off' leaves out"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        assert_refused(cases[i].line, "--effect", cases[i].value);
    }
}

static void refusals_name_the_option_and_the_value(void **state)
{
    (void)state;
    static const struct {
        const char *line, *option, *value;
    } cases[] = {
        {"s -o o --resolution 100", "--resolution", "100"},
        {"s -o o --max-error 0", "--max-error", "0"},
        {"s -o o --max-error -1", "--max-error", "-1"},
        {"s -o o --max-error 1cm", "--max-error", "1cm"},
        {"s -o o --resolution 32", "--resolution", "32"},
        {"s -o o --resolution 524288", "--resolution", "524288"},
        {"s -o o --resolution -64", "--resolution", "-64"},
        {"s -o o --resolution 64x", "--resolution", "64x"},
        {"s -o o --resolution 0", "--resolution", "0"},
        {"s -o o --resolution 99999999999999999999999", "--resolution", "99999999999999999999999"},
        {"s -o o --sun 135", "--sun", "135"},
        {"s -o o --sun 135,91", "--sun", "135,91"},
        {"s -o o --sun 135,-1", "--sun", "135,-1"},
        {"s -o o --sun 361,5", "--sun", "361,5"},
        {"s -o o --sun nan,5", "--sun", "nan,5"},
        {"s -o o --sun 5,inf", "--sun", "5,inf"},
        {"s -o o --sun 1e999,5", "--sun", "1e999,5"},
        {"s -o o --sun 5,5,5", "--sun", "5,5,5"},
        {"s -o o --sun 0x10,5", "--sun", "0x10,5"},
        {"s -o o --json=yes", "--json", "takes no value"},
        {"s -o o --up x", "--up", "x"},
        {"s -o o --closed maybe", "--closed", "maybe"},
        {"s -o o --threads 0", "--threads", "0"},
        {"s -o o --threads 257", "--threads", "257"},
        {"s -o o --threads +2", "--threads", "+2"},
        {"s -o o --memory 1MiB", "--memory", "1MiB"},
        {"s -o o --memory 4GB", "--memory", "4GB"},
        {"s -o o --memory 99999999999TiB", "--memory", "99999999999TiB"},
        {"s -o o --tile 48", "--tile", "48"},
        {"s -o o --tile 32", "--tile", "32"},
        {"s -o o --resolution 1024 --tile 2048", "--tile", "2048"},
        {"s -o o --depth guess", "--depth", "guess"},
        {"s -o o --verify many", "--verify", "many"},
        {"s -o o --verify 1000000001", "--verify", "1000000001"},
        {"s -o o --static=on", "--static", "takes no value"},
        {"s -o o --static --effect front=on", "front=on", "static"},
        {"s -o o --effect static=on --effect penumbra=on", "penumbra=on", "static"},
        {"s -o o -x", "option", "-x"},
        {"s -o o -o=y", "option", "-o=y"},
        {"s -o o second", "argument", "second"},
        {"s -o o --sun-path 52,5,2024-06-21", "--sun-path", "52,5,2024-06-21"},
        {"s -o o --sun-path 52,5,2024-6-21,10", "--sun-path", "2024-6-21"},
        {"s -o o --sun-path 52,5,2023-02-29,10", "--sun-path", "2023-02-29"},
        {"s -o o --sun-path 52,5,1900-02-29,10", "--sun-path", "1900-02-29"},
        {"s -o o --sun-path 52,5,1899-01-01,10", "--sun-path", "1899-01-01"},
        {"s -o o --sun-path 91,5,2024-06-21,10", "--sun-path", "91,5"},
        {"s -o o --sun-path 52,181,2024-06-21,10", "--sun-path", "52,181"},
        {"s -o o --sun-path 52,5,2024-06-21,0", "--sun-path", ",0"},
        {"s -o o --sun-path 52,5,2024-06-21,10min", "--sun-path", "10min"},
        {"s -o o --point 1,2", "--point", "'1,2'"},
        {"s -o o --point 1,2,3,4", "--point", "'1,2,3,4'"},
        {"s -o o --point 1,2,2e12", "--point", "2e12"},
        {"s -o o --area 1,2,3,0,0,0,1", "--area", "0,0,0,1"},
        {"s -o o --area 1,2,3,0,0,1,0", "--area", "1,0"},
        {"s -o o --area 1,2,3,0,0,1,-1,1", "--area", "-1,1"},
        {"s -o o --area 1,2,3,0,0,1,1,nan", "--area", "nan"},
        {"s -o o --area 1,2,3,0,0,1,1,1e7", "--area", "1e7"},
        {"s -o o --area 1,2,3,0,0,1,1,1,0,0,0", "--area", "0,0,0"},
        {"s -o o --spot 1,2,3,0,0,0,30", "--spot", "0,0,0,30"},
        {"s -o o --spot 1,2,3,0,0,1,91", "--spot", "91"},
        {"s -o o --spot 1,2,3,0,0,1,0", "--spot", "1,0"},
        {"s -o o --light-size 3", "--light-size", "'3'"},
        {"s -o o --light-size -3m", "--light-size", "'-3m'"},
        {"s -o o --light-size 91deg", "--light-size", "'91deg'"},
        {"- -o o", "SCENE", "'-' is not valid"},
        {"s -o -", "-o", "'-'"},
        {"s --output=-", "--output", "'-'"},
        {"s -o o --tile", "--tile", "value"},
        {"s -o o --light=", "--light", "''"},
        {"-o o", "SCENE", "no scene"},
        {"s", "-o", "no output"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        assert_refused(cases[i].line, cases[i].option, cases[i].value);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(defaults_are_those_of_the_manual),
        cmocka_unit_test(every_option_is_read_with_blank_or_equals_sign),
        cmocka_unit_test(lights_are_kept_in_the_order_given),
        cmocka_unit_test(tile_and_merge_are_tasks_with_options_of_their_own),
        cmocka_unit_test(more_lights_than_there_is_room_for_are_refused),
        cmocka_unit_test(help_version_and_plan_need_no_output),
        cmocka_unit_test(options_of_tiles_are_refused_where_they_mean_nothing),
        cmocka_unit_test(a_scene_buffer_is_asked_for_by_name),
        cmocka_unit_test(effects_are_overruled_by_name),
        cmocka_unit_test(refusals_name_the_option_and_the_value),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

/* SPDX-License-Identifier: Apache-2.0 */
/* Points as people and programs write them: text and raw, valid and invalid, in batches of any
 * size. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "cli/shared/cli_points.h"

static char folder[] = "umbrage-points-XXXXXX";
static char path[64];

static int make_folder(void **state)
{
    (void)state;
    if (mkdtemp(folder) == NULL) {
        return -1;
    }
    (void)snprintf(path, sizeof path, "%s/points", folder);
    return 0;
}

static int remove_folder(void **state)
{
    (void)state;
    (void)unlink(path);
    return rmdir(folder);
}

static void write_file(const void *bytes, size_t size)
{
    FILE *file = fopen(path, "wb");
    assert_non_null(file);
    assert_int_equal(fwrite(bytes, 1, size, file), size);
    assert_int_equal(fclose(file), 0);
}

/* Reads all points of the file in batches of `capacity`. */
struct all {
    double positions[4096][3];
    float normals[4096][3];
    size_t count;
    bool any_normals;
};

static enum umb_status read_all(enum umbc_points_format format, bool with_normals, size_t capacity,
                                struct all *all, struct umb_error *error)
{
    static struct umbc_points points;
    struct umbc_batch batch;
    const double origin[3] = {0, 0, 0};
    memset(all, 0, sizeof *all);
    assert_int_equal(umbc_points_open(path, format, with_normals, &points, error), UMB_OK);
    assert_int_equal(umbc_batch_init(&batch, capacity, format, error), UMB_OK);
    enum umb_status status;
    while ((status = umbc_points_read(&points, &batch, error)) == UMB_OK && batch.count > 0) {
        struct umb_points view = umbc_batch_view(&batch, format, origin);
        assert_int_equal(batch.first, all->count);
        assert_true(all->count + batch.count <= 4096 && batch.count <= capacity);
        for (size_t i = 0; i < 3 * batch.count; i++) {
            size_t point = all->count + i / 3;
            all->positions[point][i % 3] = view.format == UMB_POINT_F32
                                               ? (double)((const float *)view.positions)[i]
                                               : ((const double *)view.positions)[i];
            if (view.normals != NULL) {
                all->normals[point][i % 3] = ((const float *)view.normals)[i];
                all->any_normals = true;
            }
        }
        all->count += batch.count;
    }
    umbc_batch_finish(&batch);
    umbc_points_close(&points);
    return status;
}

static void text_is_read_as_it_is_meant(void **state)
{
    static const char text[] = "# a comment\n"
                               "1 2 3\r\n"
                               "\n"
                               "  \t-4.5e-3\t+6.25 1e2   0 0 -1  # behind a point\n"
                               "   # alone\n"
                               "0.1 .5 7.\n"
                               "84616.123456789012 447423.25 -3";
    static struct all all;
    struct umb_error error;
    (void)state;
    write_file(text, sizeof text - 1);
    for (size_t capacity = 1; capacity <= 8; capacity++) {
        assert_int_equal(read_all(UMBC_POINTS_TEXT, false, capacity, &all, &error), UMB_OK);
        assert_int_equal(all.count, 4);
        assert_true(all.positions[0][2] == 3 && all.positions[1][0] == -4.5e-3);
        assert_true(all.positions[1][1] == 6.25 && all.positions[1][2] == 100);
        assert_true(all.positions[2][0] == 0.1 && all.positions[2][1] == 0.5);
        assert_true(all.positions[3][0] == 84616.123456789012); /* all digits of a double */
        assert_true(all.normals[1][2] == -1 && all.normals[0][2] == 0 && all.normals[3][2] == 0);
    }
}

static void pairs_stay_together_and_have_six_numbers(void **state)
{
    static const char text[] = "1 2 3 4 5 6\n# apart\n7 8 9 10 11 12.5\n";
    static const double raw[12] = {1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12.5};
    const double origin[3] = {0, 0, 0};
    (void)state;
    for (int wide = 0; wide < 2; wide++) {
        static struct umbc_points points;
        enum umbc_points_format format = wide ? UMBC_POINTS_F64 : UMBC_POINTS_TEXT;
        struct umbc_batch batch;
        struct umb_error error;
        double found[12];
        size_t count = 0;
        write_file(wide ? (const char *)raw : text, wide ? sizeof raw : sizeof text - 1);
        assert_int_equal(umbc_points_open(path, format, false, &points, &error), UMB_OK);
        points.pairs = true;
        assert_int_equal(umbc_batch_init(&batch, 3, format, &error), UMB_OK); /* room for one */
        while (umbc_points_read(&points, &batch, &error) == UMB_OK && batch.count > 0) {
            struct umb_points view = umbc_batch_view(&batch, format, origin);
            assert_int_equal(batch.count, 2);
            assert_null(view.normals);
            memcpy(found + 3 * count, view.positions, 6 * sizeof(double));
            count += batch.count;
        }
        assert_int_equal(count, 4);
        assert_memory_equal(found, raw, sizeof raw);
        umbc_points_close(&points);
        if (wide) {
            write_file(raw, sizeof raw - 4);
            assert_int_equal(umbc_points_open(path, format, false, &points, &error), UMB_OK);
            points.pairs = true;
            assert_int_equal(umbc_points_read(&points, &batch, &error), UMB_OK);
            assert_int_equal(umbc_points_read(&points, &batch, &error), UMB_E_TRUNCATED);
            assert_non_null(
                strstr(error.message, "the last 44 bytes are no whole record of 48 bytes"));
            umbc_points_close(&points);
        }
        umbc_batch_finish(&batch);
    }
}

static void bad_text_is_named_by_line_and_column(void **state)
{
    static const struct {
        const char *text;
        size_t size; /* 0 = strlen */
        const char *words;
    } cases[] = {
        {"1 2\n", 0, ":1:4: must have 3 or 6 numbers in '1 2'"},
        {"1 2 3\n1 2 3 4\n", 0, ":2:"},
        {"1 2 3 4 5 6 7\n", 0, ":1:13: more than six numbers"},
        {"1 2 x\n", 0, ":1:5: not a finite decimal number"},
        {"1 2 nan\n", 0, ":1:5:"},
        {"1 inf 2\n", 0, ":1:3:"},
        {"0x10 1 2\n", 0, ":1:1:"},
        {"1e999 1 2\n", 0, ":1:1:"},
        {"1,5 2 3\n", 0, ":1:1:"},
        {"1 2 3e\n", 0, ":1:5:"},
        {"1 2 --3\n", 0, ":1:5:"},
        {"1 2 3 \x1b[2J\n", 0, "?[2J"},
        {"1 2 3\0 4\n", 9, ":1:5:"},
    };
    static struct all all;
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct umb_error error = {0};
        write_file(cases[i].text, cases[i].size != 0 ? cases[i].size : strlen(cases[i].text));
        assert_int_equal(read_all(UMBC_POINTS_TEXT, false, 4, &all, &error), UMB_E_FORMAT);
        if (strstr(error.message, cases[i].words) == NULL) {
            fail_msg("'%s' does not say '%s'", error.message, cases[i].words);
        }
    }
}

static void lines_may_cross_the_buffer_but_have_a_limit(void **state)
{
    static struct all all;
    static char text[3 * UMBC_LINE_MAX];
    struct umb_error error = {0};
    (void)state;
    /* Comments of growing length put the ends of lines at every place around the buffer's end. */
    size_t size = 0;
    for (int i = 0; size < 2 * UMBC_LINE_MAX + 4000; i++) {
        size += (size_t)snprintf(text + size, 100, "%d 0.25 -%d #", i, i);
        size_t filler = (size_t)i * 37 % 211;
        memset(text + size, 'x', filler);
        size += filler;
        text[size++] = '\n';
    }
    write_file(text, size);
    assert_int_equal(read_all(UMBC_POINTS_TEXT, false, 100, &all, &error), UMB_OK);
    assert_true(all.count > 700);
    for (size_t i = 0; i < all.count; i++) {
        assert_true(all.positions[i][0] == (double)i && all.positions[i][2] == -(double)i);
    }
    /* The longest line is one of UMBC_LINE_MAX bytes with its newline. */
    memset(text, ' ', sizeof text);
    memcpy(text, "1 2 3", 5);
    text[UMBC_LINE_MAX - 1] = '\n';
    write_file(text, UMBC_LINE_MAX);
    assert_int_equal(read_all(UMBC_POINTS_TEXT, false, 100, &all, &error), UMB_OK);
    assert_int_equal(all.count, 1);
    text[UMBC_LINE_MAX - 1] = ' ';
    text[UMBC_LINE_MAX] = '\n';
    write_file(text, UMBC_LINE_MAX + 1);
    assert_int_equal(read_all(UMBC_POINTS_TEXT, false, 100, &all, &error), UMB_E_FORMAT);
    assert_non_null(strstr(error.message, "limit of 65536 bytes"));
}

static void raw_points_are_little_endian_numbers(void **state)
{
    enum {
        COUNT = 1500
    };
    static double wide[COUNT][6];
    static float narrow[COUNT][6];
    static struct all all;
    struct umb_error error;
    (void)state;
    for (int i = 0; i < COUNT; i++) {
        for (int k = 0; k < 6; k++) {
            wide[i][k] = i * 7 + k + 1.0 / 3;
            narrow[i][k] = (float)wide[i][k];
        }
    }
    for (size_t capacity = 1; capacity < 2000; capacity = capacity * 3 + 1) {
        write_file(wide, sizeof wide);
        assert_int_equal(read_all(UMBC_POINTS_F64, true, capacity, &all, &error), UMB_OK);
        assert_int_equal(all.count, COUNT);
        assert_true(all.any_normals);
        assert_true(all.positions[COUNT - 1][2] == wide[COUNT - 1][2]);
        assert_true(all.normals[COUNT - 1][2] == (float)wide[COUNT - 1][5]);
        write_file(narrow, sizeof narrow);
        assert_int_equal(read_all(UMBC_POINTS_F32, false, capacity, &all, &error), UMB_OK);
        assert_int_equal(all.count, 2 * COUNT);
        assert_false(all.any_normals);
        assert_true(all.positions[2 * COUNT - 1][0] == (double)narrow[COUNT - 1][3]);
    }
}

static void raw_rests_and_infinities_are_refused(void **state)
{
    static struct all all;
    float bad[3][3] = {{1, 2, 3}, {4, 5, 6}, {7, 8, 9}};
    struct umb_error error;
    (void)state;
    for (size_t cut = 1; cut < 12; cut++) {
        write_file(bad, sizeof bad - cut);
        assert_int_equal(read_all(UMBC_POINTS_F32, false, 2, &all, &error), UMB_E_TRUNCATED);
        assert_non_null(strstr(error.message, "no whole point of 12 bytes"));
    }
    uint32_t infinity = 0x7f800000;
    memcpy(&bad[2][1], &infinity, sizeof infinity);
    write_file(bad, sizeof bad);
    assert_int_equal(read_all(UMBC_POINTS_F32, false, 2, &all, &error), UMB_E_FORMAT);
    assert_non_null(strstr(error.message, "point 2 "));
    write_file(bad, 0);
    assert_int_equal(read_all(UMBC_POINTS_F64, true, 2, &all, &error), UMB_OK);
    assert_int_equal(all.count, 0);
}

static void what_is_no_readable_file_is_no_input(void **state)
{
    static struct umbc_points points;
    struct umb_error error;
    (void)state;
    assert_int_equal(umbc_points_open(folder, UMBC_POINTS_TEXT, false, &points, &error),
                     UMB_E_NO_INPUT);
    assert_non_null(strstr(error.message, "folder"));
    assert_int_equal(umbc_points_open("no/such/file", UMBC_POINTS_TEXT, false, &points, &error),
                     UMB_E_NO_INPUT);
    assert_non_null(strstr(error.message, "no/such/file"));
}

enum {
    MANY = 800000
};

/* Each point's coordinates are its own number. The sample must be in order, in intervals, and from
 * the whole file. */
static void check_sample(enum umbc_points_format format, bool with_normals, size_t total)
{
    struct umbc_batch sample;
    struct umb_error error;
    size_t steps = 0, quarters[4] = {0};
    assert_int_equal(
        umbc_points_sample(path, format, with_normals, UMBC_SAMPLE_POINTS, &sample, &error),
        UMB_OK);
    for (size_t i = 0; i < sample.count; i++) {
        const double x = sample.wide ? sample.wide[3 * i] : (double)sample.narrow[3 * i];
        const double last = i == 0        ? -1
                            : sample.wide ? sample.wide[3 * i - 3]
                                          : (double)sample.narrow[3 * i - 3];
        const double y = sample.wide ? sample.wide[3 * i + 1] : (double)sample.narrow[3 * i + 1];
        assert_true(x >= 0 && x < (double)total && y == 7);
        assert_true(!sample.has_normals || sample.normals[3 * i + 2] == 1);
        steps += x != last + 1;
        quarters[(size_t)(4 * x / (double)total)]++;
    }
    assert_true(sample.has_normals == with_normals || format == UMBC_POINTS_TEXT);
    assert_int_equal(sample.count, total < MANY ? total : (size_t)64 * 4096);
    assert_int_equal(steps, total < MANY ? 0 : 63); /* the first interval goes on from -1 */
    for (size_t q = 0; q < 4; q++) {
        assert_true(quarters[q] > sample.count / 5);
    }
    umbc_batch_finish(&sample);
}

static void samples_come_in_intervals_from_all_over_a_file(void **state)
{
    (void)state;
    static float raw[MANY][6];
    static char text[(size_t)MANY * 16];
    size_t length = 0;
    for (size_t i = 0; i < MANY; i++) {
        const float point[6] = {(float)i, 7, 0, 0, 0, 1};
        memcpy(raw[i], point, sizeof point);
        length += (size_t)snprintf(text + length, sizeof text - length, "%zu 7 0\n", i);
    }
    write_file(raw, sizeof raw);
    check_sample(UMBC_POINTS_F32, true, MANY);
    write_file(text, length);
    check_sample(UMBC_POINTS_TEXT, false, MANY);
    write_file(raw, 1000 * sizeof *raw);
    check_sample(UMBC_POINTS_F32, true, 1000);
}

static void what_cannot_be_sampled_gives_no_points(void **state)
{
    (void)state;
    struct umbc_batch sample;
    const char *const names[] = {"-", "no/such/file", folder, path};
    write_file("1 2 three\n", 10);
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++) {
        assert_int_equal(umbc_points_sample(names[i], UMBC_POINTS_TEXT, false, 10, &sample, NULL),
                         UMB_OK);
        assert_int_equal(sample.count, 0);
        umbc_batch_finish(&sample);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(text_is_read_as_it_is_meant),
        cmocka_unit_test(pairs_stay_together_and_have_six_numbers),
        cmocka_unit_test(bad_text_is_named_by_line_and_column),
        cmocka_unit_test(lines_may_cross_the_buffer_but_have_a_limit),
        cmocka_unit_test(raw_points_are_little_endian_numbers),
        cmocka_unit_test(raw_rests_and_infinities_are_refused),
        cmocka_unit_test(what_is_no_readable_file_is_no_input),
        cmocka_unit_test(samples_come_in_intervals_from_all_over_a_file),
        cmocka_unit_test(what_cannot_be_sampled_gives_no_points),
    };
    return cmocka_run_group_tests(tests, make_folder, remove_folder);
}

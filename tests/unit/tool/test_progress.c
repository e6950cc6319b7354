/* SPDX-License-Identifier: Apache-2.0 */
/* The text of the progress line, and that it appears on terminals only. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <fcntl.h>
#include <string.h>
#include <unistd.h>

#include "tool/progress.h"

static void text_has_share_rate_and_time_left(void **state)
{
    char text[160];
    (void)state;
    umbu_progress_text(text, sizeof text, "Mtexel", 50, 0.25, 2);
    assert_string_equal(text, "[######..................]  25 %  25 Mtexel/s  0:06 left");
    umbu_progress_text(text, sizeof text, "Mtexel", 0, 0, 5);
    assert_string_equal(text, "[........................]   0 %");
    umbu_progress_text(text, sizeof text, "Mpoint", 100, 1, 100);
    assert_string_equal(text, "[########################] 100 %  1 Mpoint/s  0:00 left");
    umbu_progress_text(text, sizeof text, "MB", 1, 0.01, 100);
    assert_non_null(strstr(text, "165:00 left"));
}

static void text_without_a_share_counts(void **state)
{
    static const double unknown[] = {-1, 1.5, 0.0 / 0.0};
    char text[160];
    (void)state;
    for (size_t i = 0; i < sizeof unknown / sizeof unknown[0]; i++) {
        umbu_progress_text(text, sizeof text, "points", 1000, unknown[i], 4);
        assert_string_equal(text, "1000 points  250 points/s");
    }
}

static void nothing_is_drawn_where_stderr_is_no_terminal(void **state)
{
    struct umbu_progress progress;
    int ends[2];
    char byte;
    (void)state;
    assert_int_equal(pipe(ends), 0);
    const int saved = dup(STDERR_FILENO);
    assert_true(dup2(ends[1], STDERR_FILENO) >= 0);
    umbu_progress_begin(&progress, "points", false);
    progress.started_s -= 10; /* the silent second is over */
    umbu_progress_show(&progress, 5, 0.5);
    umbu_progress_end(&progress);
    assert_true(dup2(saved, STDERR_FILENO) >= 0);
    (void)close(ends[1]);
    assert_int_equal(read(ends[0], &byte, 1), 0);
    (void)close(ends[0]);
    (void)close(saved);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(text_has_share_rate_and_time_left),
        cmocka_unit_test(text_without_a_share_counts),
        cmocka_unit_test(nothing_is_drawn_where_stderr_is_no_terminal),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

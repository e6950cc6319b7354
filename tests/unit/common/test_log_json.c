/* SPDX-License-Identifier: Apache-2.0 */
/* Log lines as JSON: the same keys and values, escaped, and complete at any length. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "common/log.h"

static void expect(const char *line, const char *json)
{
    char out[1000];
    size_t length = umbs__log_json(line, out, sizeof out);
    out[length] = '\0';
    assert_string_equal(out, json);
}

static void log_line_becomes_one_object(void **state)
{
    (void)state;
    expect("", "{}");
    expect("event=ready pid=12 part=1.5 id=007 code=-3 x=1e5 y=. z=",
           "{\"event\":\"ready\",\"pid\":12,\"part\":1.5,\"id\":\"007\",\"code\":-3,\"x\":\"1e5\","
           "\"y\":\".\",\"z\":\"\"}");
    expect("reason=\"it is \\x22so\\x22 \\x0a\\\\\" next=1",
           "{\"reason\":\"it is \\\"so\\\" \\u000a\\\\\\\\\",\"next\":1}");
    expect("words without meaning a=b", "{\"a\":\"b\"}");
    expect("cut=\"in the mid", "{\"cut\":\"in the mid\"}");
}

/* For every size of the buffer the output must be an object of complete pairs, and fit. */
static void log_object_is_whole_in_any_room(void **state)
{
    (void)state;
    static const char line[] = "a=1 bb=\"two \\x01\" ccc=three";
    static const char *const wholes[] = {"{}", "{\"a\":1}", "{\"a\":1,\"bb\":\"two \\u0001\"}",
                                         "{\"a\":1,\"bb\":\"two \\u0001\",\"ccc\":\"three\"}"};
    size_t seen = 0;
    for (size_t room = 3; room < 80; room++) {
        char out[100];
        memset(out, '#', sizeof out);
        size_t length = umbs__log_json(line, out, room);
        assert_true(length <= room);
        assert_int_equal(out[room], '#');
        out[length] = '\0';
        size_t which = 0;
        while (which < 4 && strcmp(out, wholes[which]) != 0) {
            which++;
        }
        assert_true(which < 4);
        assert_true(which >= seen);
        seen = which;
    }
    assert_int_equal(seen, 3);
}

static void log_event_is_written_in_the_form_asked_for(void **state)
{
    (void)state;
    int ends[2];
    char line[500];
    struct umbs_log log;
    assert_int_equal(pipe(ends), 0);
    umbs_log_init(&log, ends[1], UMB_LOG_INFO);
    log.format = UMBS_LOG_JSON;
    umbs_log_event(&log, UMB_LOG_DEBUG, "quiet", NULL);
    umbs_log_set_level(&log, UMB_LOG_DEBUG);
    umbs_log_event(&log, UMB_LOG_DEBUG, "heard", "n=%d", 5);
    ssize_t size = read(ends[0], line, sizeof line - 1);
    assert_true(size > 0);
    line[size] = '\0';
    assert_memory_equal(line, "{\"ts\":\"", 7);
    assert_non_null(strstr(line, "\"level\":\"debug\",\"event\":\"heard\",\"n\":5}\n"));
    close(ends[0]);
    close(ends[1]);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(log_line_becomes_one_object),
        cmocka_unit_test(log_object_is_whole_in_any_room),
        cmocka_unit_test(log_event_is_written_in_the_form_asked_for),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

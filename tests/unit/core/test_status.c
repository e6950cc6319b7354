/* SPDX-License-Identifier: Apache-2.0 */
/* Status codes, their exit codes, and the sentences that go with them. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <errno.h>
#include <string.h>

#include "umbrage/status.h"
#include "tool/exit_code.h"

static void every_status_has_its_names_and_codes(void **state)
{
    static const struct {
        enum umb_status status;
        int value;
        const char *name;
    } rows[] = {
#define ROW(name, value, text) {UMB_##name, value, #name},
        UMB_STATUS_LIST(ROW)
#undef ROW
    };
    (void)state;
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        enum umb_status status = rows[i].status;
        assert_int_equal(status, rows[i].value);
        assert_string_equal(umb_status_name(status), rows[i].name);
        assert_true(umb_status_text(status)[0] != '\0');
        assert_in_range(umbu_exit_code(status), 0, 78);
        assert_int_equal(umbu_exit_code(status) == 0, status == UMB_OK);
        for (size_t k = 0; k < i; k++) {
            assert_int_not_equal(rows[k].value, rows[i].value);
        }
    }
    assert_string_equal(umb_status_name((enum umb_status)(-999)), "E_UNKNOWN");
    assert_int_equal(umbu_exit_code((enum umb_status)(-999)), 70);
}

static void messages_are_one_line_of_plain_utf8(void **state)
{
    struct umb_error error;
    (void)state;
    assert_int_equal(
        umb_fail(&error, UMB_E_ARGUMENT, "name '%s'", "a\n\x1b[2J\xff\xc3\xa9\xc2\x85"),
        UMB_E_ARGUMENT);
    assert_string_equal(error.message, "name 'a  [2J?\xc3\xa9  '");
    assert_int_equal(error.system_error, 0);
    assert_int_equal(umb_fail_errno(&error, UMB_E_IO, ENOSPC, "writing"), UMB_E_IO);
    assert_int_equal(error.system_error, ENOSPC);
    assert_memory_equal(error.message, "writing: ", 9);
    assert_int_equal(umb_fail(NULL, UMB_E_IO, "nobody listens"), UMB_E_IO);
}

static void long_messages_are_cut_and_stay_utf8(void **state)
{
    char text[1001];
    struct umb_error error;
    (void)state;
    for (size_t shift = 0; shift < 3; shift++) {
        memset(text, 'x', sizeof text);
        for (size_t i = shift; i + 3 < sizeof text; i += 3) {
            memcpy(text + i, "\xe2\x82\xac", 3);
        }
        text[sizeof text - 1] = '\0';
        (void)umb_fail_errno(&error, UMB_E_IO, EIO, "%s", text);
        size_t length = strlen(error.message);
        assert_int_equal(length, sizeof error.message - 1);
        /* Whole characters are kept, and '?' stands for the one that was cut. */
        for (size_t i = 0; i < length;) {
            int euro = strncmp(error.message + i, "\xe2\x82\xac", 3) == 0;
            assert_true(euro || error.message[i] == 'x' || (error.message[i] == '?' && i > 310));
            i += euro ? 3 : 1;
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_status_has_its_names_and_codes),
        cmocka_unit_test(messages_are_one_line_of_plain_utf8),
        cmocka_unit_test(long_messages_are_cut_and_stay_utf8),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

/* SPDX-License-Identifier: Apache-2.0 */
/* Keys with numbers: what is accepted, and what each refusal names. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <string.h>

#include "tool/keys.h"

struct found {
    bool has_at, has_size;
    double at[3], size;
};

static enum umb_status read_found(const char *text, struct found *found, struct umb_error *error)
{
    const struct umbu_key keys[] = {
        {"at", &found->has_at, found->at, 3, 100},
        {"size", &found->has_size, &found->size, 1, 10},
    };
    return umbu_read_keys("--place", text, "at=X,Y,Z size=M", keys, 2, error);
}

static void keys_are_read_in_any_order(void **state)
{
    struct found found = {0};
    (void)state;
    assert_int_equal(read_found("size=2.5,at=1,-2,3e1", &found, NULL), UMB_OK);
    assert_true(found.has_at && found.has_size && found.size == 2.5);
    assert_true(found.at[0] == 1 && found.at[1] == -2 && found.at[2] == 30);
    found = (struct found){0};
    assert_int_equal(read_found("at=0,0,100", &found, NULL), UMB_OK);
    assert_true(found.has_at && !found.has_size);
}

static void refusals_name_the_option_and_the_value(void **state)
{
    static const char *const cases[][2] = {
        {"", "is none of at=X,Y,Z size=M"},
        {"at", "'at' is none of"},
        {"at=1,2", "at needs 3 numbers, has 2"},
        {"at=1,2,", "'' is not a number"},
        {"at=1,2,nan", "'nan' is not a number"},
        {"at=1,2,0x3", "'0x3' is not a number"},
        {"at=1,2, 3", "' 3' is not a number"},
        {"at=1,2,101", "from -100 to 100"},
        {"size=11", "size: '11'"},
        {"size=1,size=1", "size is given twice"},
        {"size=1,", "'' is none of"},
        {"size=1;at=1,2,3", "where a comma was expected"},
    };
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct found found = {0};
        struct umb_error error = {0};
        assert_int_equal(read_found(cases[i][0], &found, &error), UMB_E_ARGUMENT);
        assert_memory_equal(error.message, "--place: ", 9);
        if (strstr(error.message, cases[i][1]) == NULL) {
            fail_msg("'%s': '%s' should hold '%s'", cases[i][0], error.message, cases[i][1]);
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(keys_are_read_in_any_order),
        cmocka_unit_test(refusals_name_the_option_and_the_value),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

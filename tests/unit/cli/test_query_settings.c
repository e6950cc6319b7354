/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Each setting of a query is an option of `umbrage query`, and a line of docs/reference/api.md.
 * `test_query_settings --table` prints these lines.
 */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <stdio.h>
#include <string.h>

#include "base/query_settings.h"
#include "cli/cli_query_options.h"

/* Finds the option that sets a setting: the one whose errors name it. */
static const char *option_of(const char *setting)
{
    static char name[64];
    struct umb_error error = {.status = UMB_E_ARGUMENT};
    (void)snprintf(error.message, sizeof error.message, "%s: wrong", setting);
    umbu_name_options(&umbc_query_command, &error);
    (void)snprintf(name, sizeof name, "%.*s", (int)strcspn(error.message, ":"), error.message);
    return name;
}

/* Writes the values that a setting may have. */
static void values_of(const struct umb__setting *setting, char *text, size_t size)
{
    static const char *const words[] = {
        [UMB__SETTING_COUNT] = "0 and up",        [UMB__SETTING_ODD] = "odd, 1 to %g",
        [UMB__SETTING_FLAG] = "0 or 1",           [UMB__SETTING_NUMBER] = "0 to %g",
        [UMB__SETTING_NUMBERS] = "three numbers",
    };
    if (setting->kind == UMB__SETTING_CHOICE) {
        (void)snprintf(text, size, "`%s`", setting->words);
        for (char *bar = strchr(text, '|'); bar != NULL; bar = strchr(text, '|')) {
            memmove(bar + 4, bar + 1, strlen(bar + 1) + 1);
            memcpy(bar, "`, `", 4);
        }
    } else if (setting->most > 0 || setting->kind == UMB__SETTING_NUMBERS) {
        (void)snprintf(text, size, words[setting->kind], setting->most);
    } else {
        (void)snprintf(text, size, "0 and up");
    }
}

static void line_of(const struct umb__setting *setting, char *text, size_t size)
{
    char values[200];
    values_of(setting, values, sizeof values);
    (void)snprintf(text, size, "| `%s` | %s | `%s` | %s |\n", setting->name, values,
                   option_of(setting->name), setting->help);
}

static void every_setting_is_an_option(void **state)
{
    (void)state;
    for (size_t i = 0; i < umb__setting_count; i++) {
        const char *option = option_of(umb__settings[i].name);
        if (strncmp(option, "--", 2) != 0) {
            fail_msg("%s is no option of umbrage query", umb__settings[i].name);
        }
    }
}

static void every_setting_is_a_line_of_the_page(void **state)
{
    static char page[1 << 18];
    char line[1000];
    FILE *file = fopen("docs/reference/api.md", "r");
    (void)state;
    assert_non_null(file);
    const size_t size = fread(page, 1, sizeof page - 1, file);
    (void)fclose(file);
    assert_true(size < sizeof page - 1);
    for (size_t i = 0; i < umb__setting_count; i++) {
        line_of(&umb__settings[i], line, sizeof line);
        if (strstr(page, line) == NULL) {
            fail_msg("docs/reference/api.md lacks the line\n%s", line);
        }
    }
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_setting_is_an_option),
        cmocka_unit_test(every_setting_is_a_line_of_the_page),
    };
    if (argc == 2 && strcmp(argv[1], "--table") == 0) {
        char line[1000];
        for (size_t i = 0; i < umb__setting_count; i++) {
            line_of(&umb__settings[i], line, sizeof line);
            (void)fputs(line, stdout);
        }
        return 0;
    }
    return cmocka_run_group_tests(tests, NULL, NULL);
}

/* SPDX-License-Identifier: Apache-2.0 */
/* The config file: what it accepts, which sources take precedence over it, and the line that a
 * refusal names. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "daemon/base/daemon_options.h"

static char path[64];

static void write_config(const char *text, size_t size)
{
    FILE *file = fopen(path, "w");
    assert_non_null(file);
    assert_int_equal(fwrite(text, 1, size, file), size);
    assert_int_equal(fclose(file), 0);
}

static enum umb_status parse(const char *text, const char *word, struct umbd_options *options,
                             struct umb_error *error)
{
    char name[] = "umbraged", config[] = "--config";
    char copy[200];
    write_config(text, strlen(text));
    (void)snprintf(copy, sizeof copy, "%s", word != NULL ? word : "");
    char *argv[] = {name, config, path, copy, NULL};
    return umbd_options_parse(word != NULL ? 4 : 3, argv, options, error);
}

static int setup(void **state)
{
    (void)state;
    (void)snprintf(path, sizeof path, "/tmp/umbrage-test-XXXXXX");
    int fd = mkstemp(path);
    assert_true(fd >= 0);
    close(fd);
    return 0;
}

static int teardown(void **state)
{
    (void)state;
    unlink(path);
    return 0;
}

static void config_file_sets_what_the_command_line_could(void **state)
{
    (void)state;
    struct umbd_options options;
    struct umb_error error = {0};
    assert_int_equal(parse("; a comment\n# another\n[umbraged]\nstore = /a\nstore=/b\n"
                           "listen = unix:/x\n listen = tcp:127.0.0.1:0\nidle-timeout = 250ms\n"
                           "max-message=1MiB ; why\ncopy = true\nwarm-up = false\n"
                           "log-level = debug\nlog-format = json\nworkers = 7\n",
                           NULL, &options, &error),
                     UMB_OK);
    assert_string_equal(options.stores[0], "/a");
    assert_string_equal(options.stores[1], "/b");
    assert_null(options.stores[2]);
    assert_int_equal(options.listen_count, 2);
    assert_string_equal(options.listen[0], "unix:/x");
    assert_int_equal(options.idle_timeout_ms, 250);
    assert_int_equal(options.max_message, 1 << 20);
    assert_int_equal(options.copy, 1);
    assert_int_equal(options.warm_up, 0);
    assert_int_equal(options.workers, 7);
    assert_int_equal(options.log_level, UMB_LOG_DEBUG);
    assert_int_equal(options.log_format, UMBS_LOG_JSON);
    umbd_options_finish(&options);
}

static void command_line_goes_before_the_file_wherever_it_stands(void **state)
{
    (void)state;
    struct umbd_options options;
    struct umb_error error = {0};
    static const char text[] = "store=/a\nstore=/b\nworkers=7\nqueue=9\n";
    write_config(text, sizeof text - 1);
    char name[] = "umbraged", workers[] = "--workers=3", store[] = "--store=/c",
         config[] = "--config";
    char *first[] = {name, workers, store, config, path, NULL};
    char *last[] = {name, config, path, workers, store, NULL};
    char **orders[] = {first, last};
    for (size_t i = 0; i < 2; i++) {
        assert_int_equal(umbd_options_parse(5, orders[i], &options, &error), UMB_OK);
        assert_int_equal(options.workers, 3);
        assert_int_equal(options.queue, 9);
        assert_string_equal(options.stores[0], "/c");
        assert_null(options.stores[1]);
        umbd_options_finish(&options);
    }
}

static void config_file_refuses_with_the_line(void **state)
{
    (void)state;
    static const struct {
        const char *text, *line, *word;
    } cases[] = {
        {"store = /a\ncolour = red\n", "line 2", "colour"},
        {"store = /a\n\nworkers = many\n", "line 3", "--workers"},
        {"workers = 2\nworkers = 2\n", "line 2", "twice"},
        {"[other]\nstore = /a\n", "line 2", "other"},
        {"store = /a\njust words\n", "line 2", "name = value"},
        {"store = /a\ncopy = yes\n", "line 2", "true or false"},
        {"help = true\n", "line 1", "help"},
        {"config = /etc/x\n", "line 1", "config"},
        {"listen = nowhere\n", "line 1", "--listen"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct umbd_options options;
        struct umb_error error = {0};
        assert_int_equal(parse(cases[i].text, NULL, &options, &error), UMB_E_ARGUMENT);
        if (strstr(error.message, cases[i].line) == NULL ||
            strstr(error.message, cases[i].word) == NULL) {
            fail_msg("'%s' should name %s and %s", error.message, cases[i].line, cases[i].word);
        }
        assert_int_equal(options.config_bad, 1);
        umbd_options_finish(&options);
    }
}

static void config_file_refuses_long_lines_and_missing_files(void **state)
{
    (void)state;
    struct umbd_options options;
    struct umb_error error = {0};
    char text[600] = "store = /";
    memset(text + 9, 'x', sizeof text - 11);
    text[sizeof text - 2] = '\n';
    text[sizeof text - 1] = '\0';
    assert_int_equal(parse(text, NULL, &options, &error), UMB_E_ARGUMENT);
    assert_non_null(strstr(error.message, "longer"));
    umbd_options_finish(&options);
    assert_int_equal(parse("store=/a\n", "--config=/nonexistent/x", &options, &error),
                     UMB_E_NO_INPUT);
    umbd_options_finish(&options);
    assert_int_equal(parse("store=/a\n", "--config=/tmp", &options, &error), UMB_E_NO_INPUT);
    umbd_options_finish(&options);
}

static char *printed(const struct umbd_options *options)
{
    char *text = NULL;
    size_t size = 0;
    FILE *out = open_memstream(&text, &size);
    assert_non_null(out);
    umbd_options_print(options, out);
    assert_int_equal(fclose(out), 0);
    return text;
}

static void printed_settings_read_back_are_the_same(void **state)
{
    (void)state;
    struct umbd_options options;
    struct umb_error error = {0};
    assert_int_equal(parse("store=/a\nstore=/b\nadmin=127.0.0.1:9\ncopy=true\nbody-timeout=90s\n"
                           "log-level=warn\nlog-format=json\nmax-buffer=3GiB\n",
                           NULL, &options, &error),
                     UMB_OK);
    char *first = printed(&options);
    umbd_options_finish(&options);
    assert_int_equal(parse(first, NULL, &options, &error), UMB_OK);
    char *second = printed(&options);
    umbd_options_finish(&options);
    assert_string_equal(first, second);
    assert_non_null(strstr(first, "max-buffer = 3221225472\n"));
    free(first);
    free(second);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(config_file_sets_what_the_command_line_could),
        cmocka_unit_test(command_line_goes_before_the_file_wherever_it_stands),
        cmocka_unit_test(config_file_refuses_with_the_line),
        cmocka_unit_test(config_file_refuses_long_lines_and_missing_files),
        cmocka_unit_test(printed_settings_read_back_are_the_same),
    };
    return cmocka_run_group_tests(tests, setup, teardown);
}

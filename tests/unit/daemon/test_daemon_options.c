/* SPDX-License-Identifier: Apache-2.0 */
/* The command line and addresses of umbraged. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include <string.h>

#include "daemon/base/daemon_options.h"
#include "daemon/base/net_address.h"

#define PARSE(options, error, ...) parse((char *[]){"umbraged", __VA_ARGS__, NULL}, options, error)

static enum umb_status parse(char **argv, struct umbd_options *options, struct umb_error *error)
{
    int argc = 0;
    while (argv[argc] != NULL) {
        argc++;
    }
    return umbd_options_parse(argc, argv, options, error);
}

static void options_have_the_stated_defaults(void **state)
{
    struct umbd_options options;
    struct umb_error error;
    (void)state;
    assert_int_equal(PARSE(&options, &error, "--store", "x"), UMB_OK);
    assert_string_equal(options.stores[0], "x");
    assert_int_equal(options.listen_count, 1);
    assert_string_equal(options.listen[0], "tcp:127.0.0.1:7420");
    assert_int_equal(options.max_points, 4194304);
    assert_int_equal(options.max_message, 64 << 20);
    assert_int_equal(options.idle_timeout_ms, 300000);
    assert_null(options.admin);
    assert_true(options.workers >= 1);
}

static void options_take_values_with_units_and_equals_signs(void **state)
{
    struct umbd_options options;
    struct umb_error error;
    (void)state;
    assert_int_equal(PARSE(&options, &error, "--store=x", "--workers=3", "--max-message", "2MiB",
                           "--drain-delay", "250ms", "--drain-timeout=2", "--idle-timeout", "1m",
                           "--listen", "unix:/tmp/a", "--listen=tcp:[::1]:0", "--log-level",
                           "debug", "--admin", "127.0.0.1:0"),
                     UMB_OK);
    assert_int_equal(options.workers, 3);
    assert_int_equal(options.max_message, 2 << 20);
    assert_int_equal(options.drain_delay_ms, 250);
    assert_int_equal(options.drain_timeout_ms, 2000);
    assert_int_equal(options.idle_timeout_ms, 60000);
    assert_int_equal(options.listen_count, 2);
    assert_int_equal(options.log_level, UMB_LOG_DEBUG);
}

static void socket_mode_is_octal_and_keeps_the_daemon_in(void **state)
{
    static const char *const bad[] = {"0060", "0460", "888", "01666", "00660", "", "rw", "-1"};
    struct umbd_options options;
    struct umb_error error;
    (void)state;
    assert_int_equal(PARSE(&options, &error, "--store", "x"), UMB_OK);
    assert_int_equal(options.socket_mode, 0660);
    assert_int_equal(PARSE(&options, &error, "--store", "x", "--socket-mode", "600"), UMB_OK);
    assert_int_equal(options.socket_mode, 0600);
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        assert_int_equal(
            PARSE(&options, &error, "--store", "x", "--socket-mode", (char *)(uintptr_t)bad[i]),
            UMB_E_ARGUMENT);
        assert_non_null(strstr(error.message, "--socket-mode"));
    }
}

static void options_name_each_bad_argument(void **state)
{
    static const struct {
        const char *option, *value;
    } bad[] = {
        {"--workers", "0"},
        {"--workers", "-1"},
        {"--workers", "1x"},
        {"--workers", "99999999999999999999999"},
        {"--max-points", ""},
        {"--max-message", "12"},
        {"--max-message", "1TiB"},
        {"--drain-delay", "1h"},
        {"--drain-delay", "18446744073709551615m"},
        {"--listen", "127.0.0.1:1"},
        {"--listen", "tcp:host"},
        {"--listen", "tcp::1"},
        {"--listen", "tcp:a:65536"},
        {"--listen", "tcp:::1:80"},
        {"--listen", "unix:"},
        {"--listen", "tls:a:1"},
        {"--tls-client-ca", "x"}, /* whom should it ask? nothing listens with TLS */
        {"--admin", "0.0.0.0:1"},
        {"--admin", "example:1"},
        {"--log-level", "loud"},
        {"--store", ""},
        {"--bogus", "1"},
        {"--queue", "0"},
        {"--bake-tile", "1000"},
        {"--bake-tile", "32"},
        {"--executor", "condor"},
        {"--job-sandbox", "maybe"},
    };
    (void)state;
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        struct umbd_options options;
        struct umb_error error = {0};
        enum umb_status status =
            PARSE(&options, &error, "--store", "x", (char *)bad[i].option, (char *)bad[i].value);
        if (status != UMB_E_ARGUMENT || strstr(error.message, bad[i].option) == NULL) {
            fail_msg("%s %s: status %d, message '%s'", bad[i].option, bad[i].value, (int)status,
                     error.message);
        }
    }
}

static struct sockaddr_storage resolve(const char *text, struct umbn_address *address)
{
    struct sockaddr_storage found = {0};
    assert_int_equal(umbn_address_parse("x", text, address, NULL), UMB_OK);
    if (address->transport != UMBN_UNIX) {
        assert_int_equal(umbd_address_resolve(address, &found, NULL), UMB_OK);
    }
    return found;
}

/* Returns whether a daemon with these options would serve clients at the address. */
#define SERVES_ANYONE(text, ...) serves_anyone(text, (char *[]){"umbraged", __VA_ARGS__, NULL})

static int serves_anyone(const char *text, char **argv)
{
    struct umbd_options options;
    struct umb_error error;
    struct umbn_address address;
    if (parse(argv, &options, &error) != UMB_OK) {
        fail_msg("%s", error.message);
    }
    const struct sockaddr_storage at = resolve(text, &address);
    const int serves = umbd_options_serve_anyone(&options, address.transport, &at);
    umbd_options_finish(&options);
    return serves;
}

static void other_machines_are_served_only_with_tokens_or_where_it_is_said(void **state)
{
    static const char *const here[] = {"tcp:127.0.0.1:1", "tcp:127.1.2.3:1", "tcp:[::1]:1",
                                       "tls:127.0.0.1:1", "unix:/x"};
    static const char *const anywhere[] = {"tcp:0.0.0.0:1", "tcp:[::]:1", "tls:0.0.0.0:1",
                                           "tcp:10.0.0.1:1", "tcp:[fe80::1]:1"};
    (void)state;
    for (size_t i = 0; i < sizeof here / sizeof here[0]; i++) {
        assert_false(SERVES_ANYONE(here[i], "--store=x"));
        assert_true(SERVES_ANYONE(anywhere[i], "--store=x"));
        assert_false(SERVES_ANYONE(anywhere[i], "--store=x", "--token-file=y"));
        assert_false(SERVES_ANYONE(anywhere[i], "--store=x", "--without-tokens"));
    }
#define WITH_CLIENT_CA                                                                             \
    "--store=x", "--listen=tls:127.0.0.1:1", "--tls-cert=c", "--tls-key=k", "--tls-client-ca=a"
    assert_false(SERVES_ANYONE("tls:0.0.0.0:1", WITH_CLIENT_CA));
    assert_true(SERVES_ANYONE("tcp:0.0.0.0:1", WITH_CLIENT_CA));
}

static void options_require_a_store_and_values(void **state)
{
    struct umbd_options options;
    struct umb_error error;
    (void)state;
    assert_int_equal(PARSE(&options, &error, "--workers", "2"), UMB_E_ARGUMENT);
    assert_non_null(strstr(error.message, "--store"));
    assert_int_equal(PARSE(&options, &error, "--store"), UMB_E_ARGUMENT);
    assert_int_equal(PARSE(&options, &error, "--store", "x", "--check=1"), UMB_E_ARGUMENT);
    assert_int_equal(PARSE(&options, &error, "--store", "x", "--max-message", "1GiB"),
                     UMB_E_ARGUMENT);
    assert_non_null(strstr(error.message, "--connection-buffer"));
    assert_int_equal(PARSE(&options, &error, "--help"), UMB_OK);
    assert_int_equal(PARSE(&options, &error, "--version"), UMB_OK);
}

static void address_keeps_brackets_out_of_the_host(void **state)
{
    struct umbn_address address;
    struct sockaddr_storage resolved;
    char text[UMBD_ADDRESS_TEXT_SIZE];
    (void)state;
    assert_int_equal(umbn_address_parse("x", "tcp:[::1]:080", &address, NULL), UMB_OK);
    assert_string_equal(address.host, "::1");
    assert_string_equal(address.port, "80");
    assert_int_equal(umbn_address_parse("x", "tcp:127.0.0.1:7420", &address, NULL), UMB_OK);
    assert_int_equal(umbd_address_resolve(&address, &resolved, NULL), UMB_OK);
    umbd_address_text(&resolved, text, sizeof text);
    assert_string_equal(text, "127.0.0.1:7420");
}

static void address_limits_the_unix_path(void **state)
{
    struct umbn_address address;
    char text[200] = "unix:";
    (void)state;
    memset(text + 5, 'a', 107);
    text[5 + 107] = '\0';
    assert_int_equal(umbn_address_parse("x", text, &address, NULL), UMB_OK);
    assert_int_equal(address.transport, UMBN_UNIX);
    text[5 + 107] = 'a';
    text[5 + 108] = '\0';
    assert_int_equal(umbn_address_parse("x", text, &address, NULL), UMB_E_ARGUMENT);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(options_have_the_stated_defaults),
        cmocka_unit_test(options_take_values_with_units_and_equals_signs),
        cmocka_unit_test(socket_mode_is_octal_and_keeps_the_daemon_in),
        cmocka_unit_test(options_name_each_bad_argument),
        cmocka_unit_test(other_machines_are_served_only_with_tokens_or_where_it_is_said),
        cmocka_unit_test(options_require_a_store_and_values),
        cmocka_unit_test(address_keeps_brackets_out_of_the_host),
        cmocka_unit_test(address_limits_the_unix_path),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

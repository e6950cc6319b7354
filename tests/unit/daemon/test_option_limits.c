/* SPDX-License-Identifier: Apache-2.0 */
/* Options at their limits, options that contradict each other, and the greatest number of
 * addresses. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include <arpa/inet.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "daemon/base/daemon_options.h"
#include "daemon/base/net_address.h"

static struct umbd_options options;
static struct umb_error error;

static enum umb_status parse(char **argv)
{
    int argc = 0;
    while (argv[argc] != NULL) {
        argc++;
    }
    return umbd_options_parse(argc, argv, &options, &error);
}
#define PARSE(...) parse((char *[]){"umbraged", __VA_ARGS__, NULL})

/* Makes a command line with the same option so many times, after a store. */
static enum umb_status parse_many(const char *word, size_t count)
{
    char *argv[64] = {"umbraged", "--store=x"};
    assert_true(count < 60);
    for (size_t i = 0; i < count; i++) {
        argv[2 + i] = (char *)(uintptr_t)word;
    }
    return parse(argv);
}

static void lists_end_at_their_limit(void **state)
{
    (void)state;
    assert_int_equal(parse_many("--listen=tcp:127.0.0.1:0", UMBD_LISTEN_MAX), UMB_OK);
    assert_int_equal(options.listen_count, UMBD_LISTEN_MAX);
    assert_int_equal(parse_many("--listen=tcp:127.0.0.1:0", UMBD_LISTEN_MAX + 1), UMB_E_ARGUMENT);
    assert_non_null(strstr(error.message, "--listen"));
    assert_int_equal(parse_many("--store=y", UMBS_STORE_FOLDERS_MAX - 2), UMB_OK);
    assert_null(options.stores[UMBS_STORE_FOLDERS_MAX - 1]);
    assert_int_equal(parse_many("--store=y", UMBS_STORE_FOLDERS_MAX - 1), UMB_E_ARGUMENT);
    assert_non_null(strstr(error.message, "--store"));
}

static void values_at_the_limit_are_taken_and_beyond_it_are_not(void **state)
{
    static const struct {
        const char *option, *most, *more;
    } cases[] = {
        {"--workers", "1024", "1025"},       {"--max-points", "268435456", "268435457"},
        {"--drain-delay", "3600s", "3601s"}, {"--drain-delay", "60m", "3600001ms"},
        {"--socket-mode", "0777", "1777"},   {"--socket-mode", "777", "00660"},
        {"--bake-tile", "32768", "65536"},
    };
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        assert_int_equal(PARSE("--store", "x", (char *)(uintptr_t)cases[i].option,
                               (char *)(uintptr_t)cases[i].most),
                         UMB_OK);
        assert_int_equal(PARSE("--store", "x", (char *)(uintptr_t)cases[i].option,
                               (char *)(uintptr_t)cases[i].more),
                         UMB_E_ARGUMENT);
        assert_non_null(strstr(error.message, cases[i].option));
        assert_non_null(strstr(error.message, cases[i].more));
    }
}

static void words_that_are_none_are_refused_by_name(void **state)
{
    (void)state;
    assert_int_equal(PARSE("--store=x", "--cache", ""), UMB_E_ARGUMENT);
    assert_non_null(strstr(error.message, "--cache"));
    assert_int_equal(PARSE("--store=x", "--log-format=xml"), UMB_E_ARGUMENT);
    assert_non_null(strstr(error.message, "xml"));
    assert_int_equal(PARSE("--store=x", "--log-format=json"), UMB_OK);
    assert_int_equal(options.log_format, UMBS_LOG_JSON);
    assert_int_equal(PARSE("--store=x", "--log-format=text"), UMB_OK);
    assert_int_equal(options.log_format, UMBS_LOG_TEXT);
    assert_int_equal(PARSE("--store=x", "stray"), UMB_E_ARGUMENT);
    assert_non_null(strstr(error.message, "'stray'"));
    assert_int_equal(PARSE("--store=x", "-s=1"), UMB_E_ARGUMENT);
    assert_int_equal(PARSE("-h"), UMB_OK);
    assert_true(options.help);
    static const char *const modes[] = {"required", "available", "off"};
    for (size_t i = 0; i < 3; i++) {
        assert_int_equal(PARSE("--store=x", "--job-sandbox", (char *)(uintptr_t)modes[i]), UMB_OK);
        assert_string_equal(options.bakes.tries.sandbox, modes[i]);
    }
}

static void budgets_lie_within_each_other(void **state)
{
    (void)state;
    assert_int_equal(PARSE("--store=x", "--connection-buffer=2GiB"), UMB_E_ARGUMENT);
    assert_non_null(strstr(error.message, "--max-buffer"));
    assert_int_equal(PARSE("--store=x", "--max-bundle=5GiB"), UMB_E_ARGUMENT);
    assert_non_null(strstr(error.message, "--owner-bytes"));
    assert_int_equal(PARSE("--store=x", "--owner-bytes=17GiB"), UMB_E_ARGUMENT);
    assert_non_null(strstr(error.message, "--job-bytes"));
    assert_int_equal(PARSE("--store=x", "--owner-bytes=17GiB", "--job-bytes=17GiB"), UMB_OK);
}

static void certificates_come_in_pairs_and_lists_with_authorities(void **state)
{
    (void)state;
    assert_int_equal(PARSE("--store=x", "--listen=tls:[::1]:0", "--tls-cert=c"), UMB_E_ARGUMENT);
    assert_non_null(strstr(error.message, "--tls-key"));
    assert_int_equal(PARSE("--store=x", "--listen=tls:[::1]:0", "--tls-key=k"), UMB_E_ARGUMENT);
    assert_int_equal(PARSE("--store=x", "--tls-crl=l"), UMB_E_ARGUMENT);
    assert_non_null(strstr(error.message, "--tls-client-ca"));
    assert_int_equal(PARSE("--store=x", "--listen=tls:[::1]:0", "--tls-cert=c", "--tls-key=k",
                           "--tls-client-ca=a", "--tls-crl=l"),
                     UMB_OK);
}

static void the_last_of_an_option_holds_and_an_address_gets_a_quarter(void **state)
{
    (void)state;
    assert_int_equal(PARSE("--store=x", "--workers=3", "--workers=5", "--max-connections=10"),
                     UMB_OK);
    assert_int_equal(options.workers, 5);
    assert_int_equal(options.max_address_connections, 3);
}

/* Returns the printed settings of a command line; they stay valid for the whole test. */
static const char *printed(void)
{
    static char *text;
    size_t size = 0;
    free(text);
    text = NULL;
    FILE *out = open_memstream(&text, &size);
    assert_non_null(out);
    umbd_options_print(&options, out);
    assert_int_equal(fclose(out), 0);
    return text;
}

static void settings_are_printed_as_a_file_would_have_them(void **state)
{
    (void)state;
    assert_int_equal(PARSE("--store=x", "--store=y", "--cache=; odd", "--copy", "--log-format=json",
                           "--socket-mode=600", "--idle-timeout=2s"),
                     UMB_OK);
    static const char *const lines[] = {"\nstore = x\nstore = y\n",  "\ncache=; odd\n",
                                        "\ncopy = true\n",           "\nwarm-up = false\n",
                                        "\nlog-format = json\n",     "\nsocket-mode = 0600\n",
                                        "\nidle-timeout = 2000ms\n", "\n; admin = \n"};
    for (size_t i = 0; i < sizeof lines / sizeof lines[0]; i++) {
        assert_non_null(strstr(printed(), lines[i]));
    }
    assert_null(strstr(printed(), "check")); /* asks for something else than serving */
}

static void addresses_are_hosts_with_ports(void **state)
{
    static const char *const bad[] = {"tcp:[::1]:",  "tcp:[]:80",   "tcp:h:123456",  "tcp:h:80x",
                                      "tcp:[::1:80", "tcp:a]:b:80", "tcp::::::::80", "tcp:h:99999"};
    struct umbn_address address;
    char longest[400];
    (void)state;
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        assert_int_equal(umbn_address_parse("--listen", bad[i], &address, &error), UMB_E_ARGUMENT);
        assert_non_null(strstr(error.message, "--listen"));
    }
    memset(longest, 'h', sizeof longest);
    memcpy(longest, "tcp:", 4);
    memcpy(longest + 390, ":80", 4);
    assert_int_equal(umbn_address_parse("--listen", longest, &address, &error), UMB_E_ARGUMENT);
    assert_int_equal(umbn_address_parse("--listen", "tls:h:65535", &address, &error), UMB_OK);
    assert_int_equal(address.transport, UMBN_TLS);
    static const char *const here[] = {"localhost:1", "[::1]:1", "127.1.2.3:1"};
    for (size_t i = 0; i < 3; i++) {
        assert_int_equal(umbd_address_parse_admin(here[i], &address, &error), UMB_OK);
    }
    assert_int_equal(umbd_address_parse_admin("[::2]:1", &address, &error), UMB_E_ARGUMENT);
    assert_int_equal(umbd_address_parse_admin("localhost", &address, &error), UMB_E_ARGUMENT);
}

static void loopback_is_told_by_the_address_and_printed_with_its_port(void **state)
{
    static const struct {
        int family;
        const char *host, *text;
        int is_loopback;
    } cases[] = {
        {AF_INET, "127.0.0.1", "127.0.0.1:80", 1},
        {AF_INET, "127.9.9.9", "127.9.9.9:80", 1},
        {AF_INET, "128.0.0.1", "128.0.0.1:80", 0},
        {AF_INET6, "::1", "[::1]:80", 1},
        {AF_INET6, "::", "[::]:80", 0},
        {AF_INET6, "1::1", "[1::1]:80", 0},
        {AF_INET6, "0:1::1", "[0:1::1]:80", 0},
        {AF_INET6, "::1:0:1", "[::1:0:1]:80", 0},
        {AF_INET6, "::1:0:0:1", "[::1:0:0:1]:80", 0},
    };
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct sockaddr_storage address = {0};
        char text[UMBD_ADDRESS_TEXT_SIZE];
        struct sockaddr_in v4 = {.sin_family = AF_INET, .sin_port = htons(80)};
        struct sockaddr_in6 v6 = {.sin6_family = AF_INET6, .sin6_port = htons(80)};
        if (cases[i].family == AF_INET) {
            assert_int_equal(inet_pton(AF_INET, cases[i].host, &v4.sin_addr), 1);
            memcpy(&address, &v4, sizeof v4);
        } else {
            assert_int_equal(inet_pton(AF_INET6, cases[i].host, &v6.sin6_addr), 1);
            memcpy(&address, &v6, sizeof v6);
        }
        assert_int_equal(umbd_address_is_loopback(&address), cases[i].is_loopback);
        umbd_address_text(&address, text, sizeof text);
        assert_string_equal(text, cases[i].text);
    }
    struct sockaddr_storage other = {.ss_family = AF_UNIX};
    char text[UMBD_ADDRESS_TEXT_SIZE];
    assert_false(umbd_address_is_loopback(&other));
    umbd_address_text(&other, text, sizeof text);
    assert_string_equal(text, "unknown");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(lists_end_at_their_limit),
        cmocka_unit_test(values_at_the_limit_are_taken_and_beyond_it_are_not),
        cmocka_unit_test(words_that_are_none_are_refused_by_name),
        cmocka_unit_test(budgets_lie_within_each_other),
        cmocka_unit_test(certificates_come_in_pairs_and_lists_with_authorities),
        cmocka_unit_test(the_last_of_an_option_holds_and_an_address_gets_a_quarter),
        cmocka_unit_test(settings_are_printed_as_a_file_would_have_them),
        cmocka_unit_test(addresses_are_hosts_with_ports),
        cmocka_unit_test(loopback_is_told_by_the_address_and_printed_with_its_port),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

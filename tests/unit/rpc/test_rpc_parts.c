/* SPDX-License-Identifier: Apache-2.0 */
/* Addresses, the SHA-256 wrapper, and the verdict on a reply however it was cut. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include "net/address.h"
#include "rpc/rpc_reply.h"
#include "umbrage/region.h"
#include "umbrage/client.h"

static void expect_authority(const char *text, const char *authority)
{
    struct umbn_address address;
    char written[UMBN_AUTHORITY_SIZE];
    assert_int_equal(umbn_address_parse("address", text, &address, NULL), UMB_OK);
    umbn_address_authority(&address, written);
    assert_string_equal(written, authority);
}

static void address_forms_are_told_apart(void **state)
{
    struct umbn_address address;
    (void)state;
    assert_int_equal(umbn_address_parse("address", "tcp:127.0.0.1:7420", &address, NULL), UMB_OK);
    assert_string_equal(address.host, "127.0.0.1");
    assert_string_equal(address.port, "7420");
    assert_int_equal(address.transport, UMBN_TCP);
    assert_int_equal(umbn_address_parse("address", "tls:[fe80::1]:443", &address, NULL), UMB_OK);
    assert_string_equal(address.host, "fe80::1");
    assert_int_equal(address.transport, UMBN_TLS);
    assert_int_equal(umbn_address_parse("address", "unix:/run/umbrage.sock", &address, NULL),
                     UMB_OK);
    assert_int_equal(address.transport, UMBN_UNIX);
    assert_string_equal(address.path, "/run/umbrage.sock");
    expect_authority("tcp:127.0.0.1:7420", "127.0.0.1:7420");
    expect_authority("tcp:[::1]:65535", "[::1]:65535");
    expect_authority("tcp:shadow-1.example.org:1", "shadow-1.example.org:1");
    expect_authority("tls:[fe80::1]:443", "[fe80::1]:443");
    expect_authority("unix:/run/umbrage.sock", "localhost");
}

/* Opens a client at an address; nothing is sent. */
static enum umb_status open_at(const char *address, struct umb_error *error)
{
    struct umb_client *client;
    enum umb_status status = umb_client_open(address, NULL, &client, error);
    umb_client_close(client);
    return status;
}

static void bad_addresses_are_refused(void **state)
{
    static const char *const bad[] = {
        "",           "tcp:",        "tcp:host",     "tcp:host:", "tcp::1",
        "tcp:host:0", "tcp:h:65536", "tcp:h:7420x",  "tcp:h:-1",  "tcp:::1:7420",
        "tcp:[]:1",   "tcp:a b:1",   "tcp:a\n:1",    "unix:",     "http://h:1",
        "h:7420",     "tcp:a/b:1",   "tcp:h:123456", "tls:",      "tls:host",
        "tls:h:0"};
    struct umb_error error;
    char long_path[200] = "unix:";
    (void)state;
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        print_message("'%s'\n", bad[i]);
        assert_int_equal(open_at(bad[i], &error), UMB_E_ARGUMENT);
        assert_int_equal(strncmp(error.message, "address", 7), 0);
    }
    memset(long_path + 5, 'a', 108);
    assert_int_equal(open_at(long_path, &error), UMB_E_ARGUMENT);
    long_path[5 + 107] = '\0';
    assert_int_equal(open_at(long_path, &error), UMB_OK);
}

static void bad_tokens_and_files_are_refused_before_anything_is_sent(void **state)
{
    static const char *const tokens[] = {"", "two words", "line\n", "caf\xc3\xa9", "\x7f"};
    struct umb_client_options client = {.token = NULL};
    struct umb_client *out;
    struct umb_error error;
    (void)state;
    for (size_t i = 0; i < sizeof tokens / sizeof tokens[0]; i++) {
        client.token = tokens[i];
        assert_int_equal(umb_client_open("tcp:h:1", &client, &out, &error), UMB_E_ARGUMENT);
        assert_null(out);
        assert_null(strstr(error.message, "words")); /* a secret stays out of messages */
    }
    client.token = NULL;
    client.ca_file = "/nowhere/ca.pem";
    assert_int_equal(umb_client_open("tls:h:1", &client, &out, &error), UMB_E_NO_INPUT);
    assert_non_null(strstr(error.message, "/nowhere/ca.pem"));
    /* Who names authorities believes to be on TLS. */
    assert_int_equal(umb_client_open("tcp:h:1", &client, &out, &error), UMB_E_ARGUMENT);
    client.ca_file = NULL;
    assert_int_equal(umb_client_open("tls:h:1", &client, &out, &error), UMB_OK);
    umb_client_close(out);
}

static void a_token_file_holds_one_token_and_no_more(void **state)
{
    static char many[4100];
    const struct {
        const char *text;
        enum umb_status status;
    } cases[] = {
        {"0123456789abcdef\n", UMB_OK},
        {"0123456789abcdef\r\n", UMB_OK},
        {"abc", UMB_OK},
        {"\n", UMB_E_ARGUMENT},
        {"", UMB_E_ARGUMENT},
        {"a b", UMB_E_ARGUMENT},
        {"one\ntwo\n", UMB_E_ARGUMENT},
        {many, UMB_E_ARGUMENT},
    };
    const char *folder = getenv("TMPDIR");
    char path[512];
    (void)snprintf(path, sizeof path, "%s/umbrage-token-XXXXXX", folder != NULL ? folder : "/tmp");
    const int fd = mkstemp(path);
    (void)state;
    assert_true(fd >= 0);
    memset(many, 'x', 4097);
    struct umb_client_options options = {.token_file = path};
    struct umb_client *client;
    struct umb_error error;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        assert_int_equal(ftruncate(fd, 0), 0);
        assert_int_equal(pwrite(fd, cases[i].text, strlen(cases[i].text), 0),
                         (ssize_t)strlen(cases[i].text));
        const enum umb_status status = umb_client_open("tcp:h:1", &options, &client, &error);
        if (status != cases[i].status) {
            fail_msg("case %zu: %d", i, (int)status);
        }
        umb_client_close(client);
    }
    (void)close(fd);
    options.token = "abc";
    assert_int_equal(umb_client_open("tcp:h:1", &options, &client, &error), UMB_E_ARGUMENT);
    options.token = NULL;
    (void)unlink(path);
    assert_int_equal(umb_client_open("tcp:h:1", &options, &client, &error), UMB_E_NO_INPUT);
    assert_non_null(strstr(error.message, path));
}

static void sha256_matches_the_standard_vectors(void **state)
{
    /* FIPS 180-4 examples: "abc", here in two parts, and the empty message. */
    static const char abc[] = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
    static const char nothing[] =
        "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855";
    const void *const parts[] = {"a", "bc"};
    const size_t sizes[] = {1, 2};
    uint8_t digest[UMB_ID_BYTES];
    char text[UMB_ID_TEXT_SIZE];
    (void)state;
    umb_sha256_openssl()->digest(NULL, parts, sizes, 2, digest);
    umb_id_to_text(digest, text);
    assert_string_equal(text, abc);
    umb_sha256_openssl()->digest(NULL, parts, sizes, 0, digest);
    umb_id_to_text(digest, text);
    assert_string_equal(text, nothing);
}

static void add_header(struct umb__reply *reply, const char *name, const char *value)
{
    assert_int_equal(umb__reply_header(reply, (const uint8_t *)name, strlen(name),
                                       (const uint8_t *)value, strlen(value), NULL),
                     UMB_OK);
}

static void reply_is_the_same_split_at_every_point(void **state)
{
    static const uint8_t bytes[] = {0, 0, 0, 0, 5, 'h', 'e', 'l', 'l', 'o'};
    (void)state;
    for (size_t split = 0; split <= sizeof bytes; split++) {
        struct umb__reply reply;
        umb__reply_init(&reply, 100);
        add_header(&reply, ":status", "200");
        add_header(&reply, "content-type", "application/grpc;x=y");
        if (split > 0) {
            assert_int_equal(umb__reply_data(&reply, bytes, split, NULL), UMB_OK);
        }
        if (split < sizeof bytes) {
            assert_int_equal(umb__reply_data(&reply, bytes + split, sizeof bytes - split, NULL),
                             UMB_OK);
        }
        add_header(&reply, "grpc-status", "0");
        assert_int_equal(umb__reply_verdict(&reply, NULL), UMB_OK);
        assert_int_equal(reply.message_size, 5);
        assert_memory_equal(reply.message, "hello", 5);
        umb__reply_finish(&reply);
    }
}

static void http_statuses_have_their_meaning(void **state)
{
    static const struct {
        const char *http;
        enum umb_status status;
    } cases[] = {{"401", UMB_E_UNAUTHENTICATED}, {"403", UMB_E_PERMISSION},
                 {"404", UMB_E_UNSUPPORTED},     {"429", UMB_E_UNAVAILABLE},
                 {"502", UMB_E_UNAVAILABLE},     {"503", UMB_E_UNAVAILABLE},
                 {"504", UMB_E_UNAVAILABLE},     {"400", UMB_E_PROTOCOL},
                 {"500", UMB_E_PROTOCOL},        {"abc", UMB_E_PROTOCOL}};
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct umb__reply reply;
        struct umb_error error;
        umb__reply_init(&reply, 100);
        add_header(&reply, ":status", cases[i].http);
        assert_int_equal(umb__reply_verdict(&reply, &error), cases[i].status);
        /* A status from the server itself counts more than a proxy's code. */
        add_header(&reply, "grpc-status", "5");
        assert_int_equal(umb__reply_verdict(&reply, &error), UMB_E_NOT_FOUND);
        umb__reply_finish(&reply);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(address_forms_are_told_apart),
        cmocka_unit_test(bad_addresses_are_refused),
        cmocka_unit_test(bad_tokens_and_files_are_refused_before_anything_is_sent),
        cmocka_unit_test(a_token_file_holds_one_token_and_no_more),
        cmocka_unit_test(sha256_matches_the_standard_vectors),
        cmocka_unit_test(reply_is_the_same_split_at_every_point),
        cmocka_unit_test(http_statuses_have_their_meaning),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

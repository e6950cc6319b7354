/* SPDX-License-Identifier: Apache-2.0 */
/* Heads of HTTP/1.1: what is accepted, what is refused and with which status, wherever they are
 * split. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdio.h>
#include <string.h>

#include "net/http1_request.h"

static struct umbn_http1_request parse(const char *head)
{
    struct umbn_http1_request request;
    umbn_http1_parse((const uint8_t *)head, strlen(head), &request);
    return request;
}

static void assert_text(struct umbn_http1_text text, const char *expected)
{
    if (!umbn_http1_is(text, expected)) {
        fail_msg("'%.*s' is not '%s'", (int)text.size, text.bytes != NULL ? text.bytes : "",
                 expected);
    }
}

static void a_request_is_read_with_its_fields(void **state)
{
    (void)state;
    struct umbn_http1_request request = parse(
        "GET /assets/a.umb?x=/y HTTP/1.1\r\nhOST:localhost:80 \r\nRange: \tbytes=0-1\t\r\n"
        "If-Range: \"a\"\r\nIf-None-Match: W/\"b\", \"c\"\r\nIf-Match:*\r\nOrigin: https://x\r\n"
        "Authorization: Bearer t\r\nContent-Length: 0\r\nX-Other: \xFF\r\nEmpty:\r\n\r\n");
    assert_int_equal(request.refusal, 0);
    assert_int_equal(request.method, UMBN_HTTP1_GET);
    assert_int_equal(request.keeps_open, 1);
    assert_text(request.path, "/assets/a.umb");
    assert_text(request.host, "localhost:80");
    assert_text(request.range, "bytes=0-1");
    assert_text(request.if_range, "\"a\"");
    assert_text(request.if_none_match, "W/\"b\", \"c\"");
    assert_text(request.if_match, "*");
    assert_text(request.origin, "https://x");
    assert_text(request.authorization, "Bearer t");
}

static void methods_and_targets_have_their_forms(void **state)
{
    (void)state;
    assert_int_equal(parse("HEAD / HTTP/1.1\r\nHost:\r\n\r\n").method, UMBN_HTTP1_HEAD);
    assert_int_equal(parse("OPTIONS * HTTP/1.1\r\nHost: h\r\n\r\n").method, UMBN_HTTP1_OPTIONS);
    assert_int_equal(parse("get / HTTP/1.1\r\nHost: h\r\n\r\n").method, UMBN_HTTP1_OTHER);
    assert_text(parse("GET http://h:1/a/b?c HTTP/1.1\r\nHost: h\r\n\r\n").path, "/a/b");
    assert_int_equal(parse("GET * HTTP/1.1\r\nHost: h\r\n\r\n").refusal, 400);
    assert_int_equal(parse("GET http://h HTTP/1.1\r\nHost: h\r\n\r\n").refusal, 400);
    assert_int_equal(parse("GET ftp://h/a HTTP/1.1\r\nHost: h\r\n\r\n").refusal, 400);
}

static void connections_stay_open_unless_a_side_says_otherwise(void **state)
{
    (void)state;
    assert_int_equal(parse("GET / HTTP/1.1\r\nHost: h\r\n\r\n").keeps_open, 1);
    assert_int_equal(parse("GET / HTTP/1.0\r\n\r\n").keeps_open, 0);
    assert_int_equal(parse("GET / HTTP/1.0\r\nConnection: keep-alive\r\n\r\n").keeps_open, 0);
    assert_int_equal(
        parse("GET / HTTP/1.1\r\nHost: h\r\nConnection: x ,\tCLOSE\r\n\r\n").keeps_open, 0);
    assert_int_equal(parse("GET / HTTP/1.1\r\nHost: h\r\nConnection: closed\r\n\r\n").keeps_open,
                     1);
    assert_int_equal(
        parse("GET / HTTP/1.1\r\nHost: h\r\nConnection: close\r\nConnection: x\r\n\r\n").keeps_open,
        0);
}

static void what_is_refused_has_its_status(void **state)
{
    static const struct {
        int status;
        const char *fields; /* after `GET / HTTP/1.1 CRLF Host: h CRLF` */
    } cases[] = {
        {413, "Content-Length: 1\r\n"},
        {413, "Content-Length: 00\r\n"},
        {400, "Content-Length: -0\r\n"},
        {400, "Content-Length: 0, 0\r\n"},
        {400, "Content-Length: 0\r\nContent-Length: 0\r\n"},
        {501, "Transfer-Encoding: identity\r\n"},
        {501, "transfer-encoding:\r\n"},
        {417, "Expect: 100-continue\r\n"},
        {400, "Host: h\r\n"},
        {400, "If-Range: \"a\"\r\nIf-Range: \"a\"\r\n"},
        {400, "Range : bytes=0-1\r\n"},
        {400, " Range: bytes=0-1\r\n"},
        {400, "X: a\x7F\r\n"},
        {400, "X: a\x01\r\n"},
        {400, "X\x80: a\r\n"},
        {400, "X: a\nY: b\r\n"},
    };
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        char head[256];
        (void)snprintf(head, sizeof head, "GET / HTTP/1.1\r\nHost: h\r\n%s\r\n", cases[i].fields);
        const struct umbn_http1_request request = parse(head);
        assert_int_equal(request.refusal, cases[i].status);
        assert_int_equal(request.keeps_open, 0);
        assert_non_null(request.reason);
    }
}

static void heads_have_limits(void **state)
{
    static char head[2 * UMBN_HTTP1_HEAD_BYTES];
    struct umbn_http1_request request;
    (void)state;
    for (int count = UMBN_HTTP1_FIELDS_MAX - 1; count <= UMBN_HTTP1_FIELDS_MAX; count++) {
        int size = snprintf(head, sizeof head, "GET / HTTP/1.1\r\nHost: h\r\n");
        for (int i = 0; i < count; i++) {
            size += snprintf(head + size, sizeof head - (size_t)size, "X: y\r\n");
        }
        (void)snprintf(head + size, sizeof head - (size_t)size, "\r\n");
        assert_int_equal(parse(head).refusal, count < UMBN_HTTP1_FIELDS_MAX ? 0 : 431);
    }
    static const char begin[] = "GET / HTTP/1.1\r\nHost: h\r\nX: ";
    memset(head, 'a', sizeof head);
    memcpy(head, begin, sizeof begin - 1);
    memcpy(head + UMBN_HTTP1_HEAD_BYTES - 4, "\r\n\r\n", 4);
    umbn_http1_parse((const uint8_t *)head, UMBN_HTTP1_HEAD_BYTES, &request);
    assert_int_equal(request.refusal, 0);
    memset(head + UMBN_HTTP1_HEAD_BYTES - 4, 'a', 4);
    memcpy(head + UMBN_HTTP1_HEAD_BYTES - 3, "\r\n\r\n", 4);
    umbn_http1_parse((const uint8_t *)head, UMBN_HTTP1_HEAD_BYTES + 1, &request);
    assert_int_equal(request.refusal, 431);
    assert_int_equal(umbn_http1_refuses_early((const uint8_t *)head, UMBN_HTTP1_HEAD_BYTES), 431);
    assert_int_equal(umbn_http1_refuses_early((const uint8_t *)head, UMBN_HTTP1_HEAD_BYTES - 1), 0);
    memset(head, 'a', sizeof head);
    assert_int_equal(umbn_http1_refuses_early((const uint8_t *)head, UMBN_HTTP1_HEAD_BYTES), 414);
    head[0] = '\x16';
    assert_int_equal(umbn_http1_refuses_early((const uint8_t *)head, 1), 400);
}

static void the_end_is_found_wherever_the_bytes_are_split(void **state)
{
    static const char head[] = "GET / HTTP/1.1\r\nHost: h\r\r\n\r\n\r\nGET /";
    const uint8_t *bytes = (const uint8_t *)head;
    const size_t expected = (size_t)(strstr(head, "\r\n\r\n") - head) + 4;
    (void)state;
    for (size_t size = 0; size <= strlen(head); size++) {
        for (size_t seen = 0; seen <= size && seen < expected; seen++) {
            assert_int_equal(umbn_http1_head_size(bytes, size, seen),
                             size < expected ? 0 : expected);
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_request_is_read_with_its_fields),
        cmocka_unit_test(methods_and_targets_have_their_forms),
        cmocka_unit_test(connections_stay_open_unless_a_side_says_otherwise),
        cmocka_unit_test(what_is_refused_has_its_status),
        cmocka_unit_test(heads_have_limits),
        cmocka_unit_test(the_end_is_found_wherever_the_bytes_are_split),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

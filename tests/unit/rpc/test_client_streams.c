/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Queries over a stream: they end in order, each with its own status, with a server that answers,
 * refuses, falls silent or goes away.
 */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include "fake_server.h"
#include "umbrage/client.h"

enum {
    COUNT = 50,
    MANY = 200
};

/* The result of one of several queries. */
struct answer {
    struct answers *all;
    enum umb_status status;
    uint64_t call; /* its number */
    float first;   /* the first point's answer: its x */
    unsigned place;
};

struct answers {
    pthread_mutex_t lock;
    pthread_cond_t changed;
    unsigned done;
    struct answer of[MANY];
};

static float positions[MANY][3 * COUNT];
static struct answers answers;

static int fill(void **state)
{
    (void)state;
    (void)pthread_mutex_init(&answers.lock, NULL);
    (void)pthread_cond_init(&answers.changed, NULL);
    for (int k = 0; k < MANY; k++) {
        for (int i = 0; i < 3 * COUNT; i++) {
            positions[k][i] = (float)(1000 * k + i);
        }
    }
    return 0;
}

static void on_answer(void *user, enum umb_status status,
                      const struct umb_client_query_reply *reply, const struct umb_error *error)
{
    struct answer *answer = user;
    (void)error;
    pthread_mutex_lock(&answers.lock);
    answer->status = status;
    if (status == UMB_OK) {
        memcpy(&answer->first, reply->values, sizeof answer->first);
    }
    answer->place = answers.done++;
    pthread_cond_signal(&answers.changed);
    pthread_mutex_unlock(&answers.lock);
}

static struct umb_client_query_request request_of(struct umb_client_stream *stream, unsigned k,
                                                  const char *asset)
{
    struct umb_client_query_request request = {
        .asset = asset,
        .settings = {.taps = 1, .format = UMB_ANSWER_F32},
        .points = {.positions = positions[k], .format = UMB_POINT_F32, .count = COUNT},
        .stream = stream,
    };
    return request;
}

static void start(struct umb_client *client, struct umb_client_stream *stream, unsigned k,
                  const char *asset, uint32_t timeout_ms)
{
    struct umb_error error = {.status = UMB_OK};
    struct umb_client_query_request request = request_of(stream, k, asset);
    request.timeout_ms = timeout_ms;
    if (umb_client_query_start(client, &request, on_answer, &answers.of[k], &answers.of[k].call,
                               &error) != UMB_OK) {
        fail_msg("%s", error.message);
    }
}

static void wait_for(unsigned count)
{
    pthread_mutex_lock(&answers.lock);
    while (answers.done < count) {
        pthread_cond_wait(&answers.changed, &answers.lock);
    }
    pthread_mutex_unlock(&answers.lock);
}

struct peer {
    struct fake_server server;
    struct umb_client *client;
    struct umb_client_stream *stream;
};

static void meet(struct peer *peer)
{
    char address[128];
    struct umb_error error = {.status = UMB_OK};
    memset(peer, 0, sizeof *peer);
    memset(answers.of, 0, sizeof answers.of);
    answers.done = 0;
    fake_start(&peer->server, 0, address);
    assert_int_equal(umb_client_open(address, NULL, &peer->client, &error), UMB_OK);
    assert_int_equal(umb_client_stream_open(peer->client, &peer->stream, &error), UMB_OK);
}

static void part(struct peer *peer)
{
    umb_client_stream_close(peer->stream);
    umb_client_close(peer->client);
    fake_stop(&peer->server);
}

static void replies_come_in_the_order_of_the_requests(void **state)
{
    struct peer peer;
    (void)state;
    meet(&peer);
    for (unsigned k = 0; k < MANY; k++) {
        start(peer.client, peer.stream, k, "ok", 0);
    }
    wait_for(MANY);
    for (unsigned k = 0; k < MANY; k++) {
        assert_int_equal(answers.of[k].status, UMB_OK);
        assert_true(answers.of[k].first == (float)(1000 * k));
        assert_int_equal(answers.of[k].place, k);
    }
    assert_int_equal(atomic_load(&peer.server.requests), 1); /* streams of HTTP/2 */
    float values[COUNT];
    struct umb_client_query_request request = request_of(peer.stream, 3, "ok");
    assert_int_equal(umb_client_query(peer.client, &request, values, NULL, NULL), UMB_OK);
    assert_true(values[COUNT - 1] == 3000 + 3 * (COUNT - 1));
    assert_int_equal(atomic_load(&peer.server.requests), 1);
    part(&peer);
}

static void a_refused_request_fails_alone(void **state)
{
    struct peer peer;
    (void)state;
    meet(&peer);
    for (unsigned k = 0; k < 10; k++) {
        start(peer.client, peer.stream, k, k == 4 || k == 5 ? "not-found" : "ok", 0);
    }
    wait_for(10);
    for (unsigned k = 0; k < 10; k++) {
        assert_int_equal(answers.of[k].status, k == 4 || k == 5 ? UMB_E_NOT_FOUND : UMB_OK);
        assert_int_equal(answers.of[k].place, k);
    }
    assert_int_equal(atomic_load(&peer.server.requests), 3);
    part(&peer);
}

static void silence_ends_the_request_and_the_next_ones_go_on(void **state)
{
    struct peer peer;
    (void)state;
    meet(&peer);
    start(peer.client, peer.stream, 0, "ok", 0);
    start(peer.client, peer.stream, 1, "silent", 100);
    start(peer.client, peer.stream, 2, "ok", 0);
    wait_for(3);
    assert_int_equal(answers.of[0].status, UMB_OK);
    assert_int_equal(answers.of[1].status, UMB_E_DEADLINE);
    assert_int_equal(answers.of[2].status, UMB_OK);
    assert_true(answers.of[2].first == 2000);
    part(&peer);
}

static void what_a_lost_stream_owed_is_asked_again_a_few_times(void **state)
{
    struct peer peer;
    (void)state;
    meet(&peer);
    start(peer.client, peer.stream, 0, "drop", 0); /* whatever is tried */
    wait_for(1);
    assert_int_equal(answers.of[0].status, UMB_E_UNAVAILABLE);
    assert_int_equal(atomic_load(&peer.server.streamed), 3);
    start(peer.client, peer.stream, 1, "ok", 0);
    start(peer.client, peer.stream, 2, "away", 0);
    start(peer.client, peer.stream, 3, "ok", 0);
    wait_for(4);
    assert_int_equal(answers.of[1].status, UMB_OK);
    assert_int_equal(answers.of[2].status, UMB_E_UNAVAILABLE);
    start(peer.client, peer.stream, 4, "ok", 0);
    wait_for(5);
    assert_int_equal(answers.of[4].status, UMB_OK);
    part(&peer);
}

static void closing_a_stream_cancels_its_requests_and_no_others(void **state)
{
    struct peer peer;
    struct umb_client_stream *other;
    (void)state;
    meet(&peer);
    assert_int_equal(umb_client_stream_open(peer.client, &other, NULL), UMB_OK);
    for (unsigned k = 0; k < 5; k++) {
        start(peer.client, peer.stream, k, "silent", 0);
    }
    umb_client_stream_close(peer.stream);
    peer.stream = other;
    start(peer.client, other, 5, "ok", 0);
    start(peer.client, NULL, 6, "ok", 0);
    wait_for(7);
    for (unsigned k = 0; k < 7; k++) {
        assert_int_equal(answers.of[k].status, k < 5 ? UMB_E_CANCELLED : UMB_OK);
    }
    /* Closing a client must end the queries under way on its streams. */
    start(peer.client, other, 7, "silent", 0);
    part(&peer);
    assert_int_equal(answers.of[7].status, UMB_E_CANCELLED);
}

static void a_cancelled_request_ends_alone_on_a_stream_and_on_its_own(void **state)
{
    struct peer peer;
    struct umb_client_stream *own[] = {NULL, NULL};
    (void)state;
    for (int over_stream = 0; over_stream < 2; over_stream++) {
        meet(&peer);
        own[1] = peer.stream;
        start(peer.client, own[over_stream], 0, "ok", 0);
        wait_for(1);
        start(peer.client, own[over_stream], 1, "silent", 0);
        start(peer.client, own[over_stream], 2, "ok", 0);
        assert_int_equal(umb_client_cancel(peer.client, 0, NULL), UMB_OK);
        assert_int_equal(umb_client_cancel(peer.client, UINT64_MAX, NULL), UMB_OK);
        assert_int_equal(umb_client_cancel(peer.client, answers.of[0].call, NULL), UMB_OK);
        assert_int_equal(umb_client_cancel(peer.client, answers.of[1].call, NULL), UMB_OK);
        wait_for(3);
        assert_int_equal(answers.of[0].status, UMB_OK);
        assert_int_equal(answers.of[1].status, UMB_E_CANCELLED);
        assert_int_equal(answers.of[2].status, UMB_OK);
        assert_true(answers.of[2].first == 2000);
        /* A later query has a number of its own. */
        assert_int_equal(umb_client_cancel(peer.client, answers.of[1].call, NULL), UMB_OK);
        start(peer.client, own[over_stream], 1, "ok", 0);
        wait_for(4);
        assert_int_equal(answers.of[1].status, UMB_OK);
        part(&peer);
    }
}

static void a_stream_of_another_client_is_refused(void **state)
{
    struct peer peer;
    struct umb_client *second;
    struct umb_error error;
    float values[COUNT];
    (void)state;
    meet(&peer);
    assert_int_equal(umb_client_open("tcp:127.0.0.1:1", NULL, &second, &error), UMB_OK);
    struct umb_client_query_request request = request_of(peer.stream, 0, "ok");
    assert_int_equal(umb_client_query(second, &request, values, NULL, &error), UMB_E_ARGUMENT);
    umb_client_close(second);
    part(&peer);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(replies_come_in_the_order_of_the_requests),
        cmocka_unit_test(a_refused_request_fails_alone),
        cmocka_unit_test(silence_ends_the_request_and_the_next_ones_go_on),
        cmocka_unit_test(what_a_lost_stream_owed_is_asked_again_a_few_times),
        cmocka_unit_test(closing_a_stream_cancels_its_requests_and_no_others),
        cmocka_unit_test(a_cancelled_request_ends_alone_on_a_stream_and_on_its_own),
        cmocka_unit_test(a_stream_of_another_client_is_refused),
    };
    return cmocka_run_group_tests(tests, fill, NULL);
}

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The client with a server that answers well, badly, late or not at all. SIGPIPE keeps its default
 * action here: a client that raised it would end the test.
 */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <pthread.h>
#include <time.h>
#include "fake_server.h"
#include "umbrage/client.h"
#include "umbrage/region.h"

#define COUNT 100

static float positions[3 * COUNT];

static int fill_positions(void **state)
{
    (void)state;
    for (int i = 0; i < 3 * COUNT; i++) {
        positions[i] = (float)i;
    }
    return 0;
}

static struct umb_client_query_request make_request(const char *asset)
{
    struct umb_client_query_request request = {
        .asset = asset,
        .settings = {.taps = 1, .format = UMB_ANSWER_F32},
        .points = {.positions = positions, .format = UMB_POINT_F32, .count = COUNT},
        .want_stats = 1,
    };
    return request;
}

static struct umb_client *open_client(const char *address, const struct umb_client_options *options)
{
    struct umb_client *client;
    struct umb_error error = {.status = UMB_OK};
    if (umb_client_open(address, options, &client, &error) != UMB_OK) {
        fail_msg("%s", error.message);
    }
    return client;
}

/* Queries and returns the status; the message goes to *error. */
static enum umb_status ask(struct umb_client *client, const char *asset, uint32_t timeout_ms,
                           struct umb_error *error)
{
    float values[COUNT];
    struct umb_client_query_request request = make_request(asset);
    request.timeout_ms = timeout_ms;
    memset(error, 0, sizeof *error);
    enum umb_status status = umb_client_query(client, &request, values, NULL, error);
    print_message("%-14s %s: %s\n", asset, umb_status_name(status), error->message);
    return status;
}

static double now_s(void)
{
    struct timespec now;
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + (double)now.tv_nsec * 1e-9;
}

static void query_gets_its_answers_stats_and_id(void **state)
{
    struct fake_server server = {.http1 = false};
    char address[128];
    float values[COUNT];
    struct umb_client_query_reply reply;
    struct umb_error error;
    (void)state;
    fake_start(&server, 0, address);
    struct umb_client *client = open_client(address, NULL);
    struct umb_client_query_request request = make_request("ok");
    for (int round = 0; round < 3; round++) {
        memset(values, 0, sizeof values);
        assert_int_equal(umb_client_query(client, &request, values, &reply, &error), UMB_OK);
        for (int i = 0; i < COUNT; i++) {
            assert_true(values[i] == positions[3 * i]);
        }
        assert_ptr_equal(reply.values, values);
        assert_int_equal(reply.value_bytes, sizeof values);
        assert_int_equal(reply.asset_id[31], 0xab);
        assert_int_equal(reply.stats.points, COUNT);
        assert_int_equal(reply.nanoseconds, 42);
    }
    umb_client_close(client);
    fake_stop(&server);
    assert_int_equal(atomic_load(&server.connections), 1);
    assert_int_equal(atomic_load(&server.requests), 3);
    assert_int_equal(atomic_load(&server.resets), 0);
}

static void large_requests_and_replies_pass_the_windows(void **state)
{
    enum {
        MANY = 400000
    };
    struct fake_server server = {.http1 = false};
    char address[128];
    struct umb_error error;
    float *many = calloc(3 * (size_t)MANY, sizeof *many);
    float *values = calloc(MANY, sizeof *values);
    (void)state;
    assert_non_null(many);
    assert_non_null(values);
    for (int i = 0; i < MANY; i++) {
        many[3 * i] = (float)i;
    }
    fake_start(&server, 0, address);
    struct umb_client *client = open_client(address, NULL);
    struct umb_client_query_request request = make_request("ok");
    request.points.positions = many;
    request.points.count = MANY;
    assert_int_equal(umb_client_query(client, &request, values, NULL, &error), UMB_OK);
    for (int i = 0; i < MANY; i++) {
        assert_true(values[i] == (float)i);
    }
    umb_client_close(client);
    fake_stop(&server);
    free(many);
    free(values);
}

static void unix_sockets_and_names_work(void **state)
{
    char path[64];
    char address[128];
    struct umb_error error;
    (void)state;
    (void)snprintf(path, sizeof path, "test_client_calls.%ld.sock", (long)getpid());
    struct fake_server local = {.unix_path = path};
    fake_start(&local, 0, address);
    struct umb_client *client = open_client(address, NULL);
    assert_int_equal(ask(client, "ok", 0, &error), UMB_OK);
    umb_client_close(client);
    fake_stop(&local);

    struct fake_server server = {.http1 = false};
    fake_start(&server, 0, address);
    (void)snprintf(address, sizeof address, "tcp:localhost:%d", server.port);
    client = open_client(address, NULL);
    assert_int_equal(ask(client, "ok", 0, &error), UMB_OK);
    umb_client_close(client);
    fake_stop(&server);
}

static void every_bad_answer_has_its_status_and_a_sentence(void **state)
{
    static const struct {
        const char *asset;
        enum umb_status status;
        const char *word;
    } cases[] = {
        {"not-found", UMB_E_NOT_FOUND, "no \"not-found\"  caf\xc3\xa9 50%"},
        {"status-999", UMB_E_PROTOCOL, "without a message"},
        {"shed", UMB_E_BUSY, "queue: full"},
        {"never-again", UMB_E_TOO_LARGE, "queue: full"},
        {"too-many", UMB_E_TOO_LARGE, "over the limit of 1"},
        {"reset", UMB_E_PROTOCOL, "reset the call (INTERNAL_ERROR)"},
        {"garbage", UMB_E_PROTOCOL, "reply: message: "},
        {"over-long", UMB_E_TOO_LARGE, "over the limit of 1048576 bytes"},
        {"http-503", UMB_E_UNAVAILABLE, "HTTP status 503 (content-type 'text/html')"},
        {"html", UMB_E_PROTOCOL, "content-type 'text/html'"},
        {"no-status", UMB_E_PROTOCOL, "without grpc-status"},
        {"two-messages", UMB_E_PROTOCOL, "more than one message"},
        {"no-message", UMB_E_PROTOCOL, "status OK without a message"},
        {"drop-inside", UMB_E_PROTOCOL, "inside a message"},
        {"short", UMB_E_PROTOCOL, "visibility: length is 396 bytes, must be 400"},
        {"compressed", UMB_E_PROTOCOL, "compressed"},
        {"bomb", UMB_E_PROTOCOL, "headers are over the limit of 65536 bytes"},
    };
    struct fake_server server = {.http1 = false};
    const struct umb_client_options options = {.max_reply_bytes = 1 << 20};
    char address[128];
    (void)state;
    fake_start(&server, 0, address);
    struct umb_client *client = open_client(address, &options);
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct umb_error error;
        assert_int_equal(ask(client, cases[i].asset, 2000, &error), cases[i].status);
        assert_non_null(strstr(error.message, cases[i].word));
        /* The connection is still good for the next call. */
        assert_int_equal(ask(client, "ok", 2000, &error), UMB_OK);
    }
    umb_client_close(client);
    fake_stop(&server);
    assert_int_equal(atomic_load(&server.connections), 1);
}

static void refused_calls_are_tried_again_at_most_twice(void **state)
{
    char address[128];
    struct umb_error error;
    (void)state;
    struct fake_server once = {.http1 = false};
    fake_start(&once, 0, address);
    struct umb_client *client = open_client(address, NULL);
    assert_int_equal(ask(client, "refuse-once", 2000, &error), UMB_OK);
    umb_client_close(client);
    fake_stop(&once);
    assert_int_equal(atomic_load(&once.requests), 2);

    struct fake_server always = {.http1 = false};
    fake_start(&always, 0, address);
    client = open_client(address, NULL);
    assert_int_equal(ask(client, "refuse", 2000, &error), UMB_E_UNAVAILABLE);
    umb_client_close(client);
    fake_stop(&always);
    assert_int_equal(atomic_load(&always.requests), 3);
}

static void goaway_moves_an_unprocessed_call_to_a_new_connection(void **state)
{
    struct fake_server server = {.http1 = false};
    char address[128];
    struct umb_error error;
    (void)state;
    fake_start(&server, 0, address);
    struct umb_client *client = open_client(address, NULL);
    assert_int_equal(ask(client, "goaway-once", 2000, &error), UMB_OK);
    assert_int_equal(ask(client, "ok", 2000, &error), UMB_OK);
    umb_client_close(client);
    fake_stop(&server);
    assert_int_equal(atomic_load(&server.connections), 2);
    assert_int_equal(atomic_load(&server.requests), 3);
}

static void a_server_that_greets_and_hangs_up_is_not_asked_without_end(void **state)
{
    struct fake_server server = {.goodbye = true};
    char address[128];
    struct umb_error error;
    (void)state;
    fake_start(&server, 0, address); /* gives up by itself beyond 16 connections */
    struct umb_client *client = open_client(address, NULL);
    double start = now_s();
    assert_int_equal(ask(client, "ok", 5000, &error), UMB_E_UNAVAILABLE);
    assert_non_null(strstr(error.message, "tcp:127.0.0.1")); /* closed or reset: a race */
    assert_true(now_s() - start < 4);                        /* not the deadline ended it */
    umb_client_close(client);
    fake_stop(&server);
    assert_in_range(atomic_load(&server.connections), 2, 3); /* one and at most two more tries */
}

static void silence_ends_at_the_deadline_and_resets_the_stream(void **state)
{
    struct fake_server server = {.http1 = false};
    char address[128];
    struct umb_error error;
    (void)state;
    fake_start(&server, 0, address);
    struct umb_client *client = open_client(address, NULL);
    double start = now_s();
    assert_int_equal(ask(client, "silent", 150, &error), UMB_E_DEADLINE);
    double waited = now_s() - start;
    assert_true(waited >= 0.15 && waited < 2); /* a loaded machine may be late, never early */
    assert_non_null(strstr(error.message, "150 ms"));
    assert_int_equal(ask(client, "ok", 2000, &error), UMB_OK);
    umb_client_close(client);
    fake_stop(&server);
    assert_int_equal(atomic_load(&server.resets), 1);
    assert_int_equal(atomic_load(&server.connections), 1);
}

static void a_peer_that_vanished_costs_one_deadline_not_all(void **state)
{
    struct fake_server server = {.http1 = false};
    const struct umb_client_options options = {.connect_timeout_ms = 1000,
                                               .max_retries = UMB_CLIENT_NEVER};
    char address[128];
    struct umb_error error;
    (void)state;
    fake_start(&server, 0, address);
    struct umb_client *client = open_client(address, &options);
    assert_int_equal(ask(client, "ok", 2000, &error), UMB_OK);
    atomic_store(&server.frozen, true);
    assert_int_equal(ask(client, "ok", 100, &error), UMB_E_DEADLINE);
    /* Calls under way when the connection is given up must end then, not at their own deadline. */
    double start = now_s();
    assert_int_equal(ask(client, "ok", 5000, &error), UMB_E_UNAVAILABLE);
    assert_non_null(strstr(error.message, "sign of life"));
    assert_true(now_s() - start < 3);
    assert_int_equal(ask(client, "ok", 2000, &error), UMB_OK);
    umb_client_close(client);
    fake_stop(&server);
    assert_int_equal(atomic_load(&server.connections), 2);
}

static void a_slow_peer_that_answers_pings_keeps_its_connection(void **state)
{
    struct fake_server server = {.http1 = false};
    const struct umb_client_options options = {.connect_timeout_ms = 700};
    char address[128];
    struct umb_error error;
    (void)state;
    fake_start(&server, 0, address);
    struct umb_client *client = open_client(address, &options);
    for (int i = 0; i < 2; i++) {
        assert_int_equal(ask(client, "silent", 50, &error), UMB_E_DEADLINE);
        fake_pause(900); /* longer than a peer has that answers no ping */
    }
    assert_int_equal(ask(client, "ok", 2000, &error), UMB_OK);
    umb_client_close(client);
    fake_stop(&server);
    assert_int_equal(atomic_load(&server.connections), 1);
}

static void an_expired_call_frees_its_stream(void **state)
{
    struct fake_server server = {.max_streams = 1};
    char address[128];
    struct umb_error error;
    (void)state;
    fake_start(&server, 0, address);
    struct umb_client *client = open_client(address, NULL);
    /* The only HTTP/2 stream is given up at the deadline, so that the next call can have it. */
    assert_int_equal(ask(client, "silent", 50, &error), UMB_E_DEADLINE);
    assert_int_equal(ask(client, "ok", 2000, &error), UMB_OK);
    umb_client_close(client);
    fake_stop(&server);
}

struct tally {
    pthread_mutex_t lock;
    unsigned calls;
    unsigned by_status[100]; /* at -status */
};

static void count_call(void *user, enum umb_status status,
                       const struct umb_client_query_reply *reply, const struct umb_error *error)
{
    struct tally *tally = user;
    assert_true((status == UMB_OK) == (reply != NULL));
    assert_true((status == UMB_OK) == (error == NULL));
    pthread_mutex_lock(&tally->lock);
    tally->calls++;
    tally->by_status[-(int)status]++;
    pthread_mutex_unlock(&tally->lock);
}

static unsigned calls_so_far(struct tally *tally)
{
    pthread_mutex_lock(&tally->lock);
    unsigned calls = tally->calls;
    pthread_mutex_unlock(&tally->lock);
    return calls;
}

static void queued_calls_expire_behind_a_full_server(void **state)
{
    struct fake_server server = {.max_streams = 1};
    struct tally tally = {.lock = PTHREAD_MUTEX_INITIALIZER};
    char address[128];
    struct umb_error error;
    (void)state;
    fake_start(&server, 0, address);
    struct umb_client *client = open_client(address, NULL);
    assert_int_equal(ask(client, "ok", 2000, &error), UMB_OK);
    struct umb_client_query_request request = make_request("silent");
    request.timeout_ms = 5000;
    assert_int_equal(umb_client_query_start(client, &request, count_call, &tally, NULL, &error),
                     UMB_OK);
    while (atomic_load(&server.requests) < 2) { /* it has the only stream */
        fake_pause(1);
    }
    for (int i = 0; i < 5; i++) {
        assert_int_equal(ask(client, "ok", 30, &error), UMB_E_DEADLINE);
    }
    assert_int_equal(atomic_load(&server.requests), 2);
    umb_client_close(client);
    assert_int_equal(tally.by_status[-(int)UMB_E_CANCELLED], 1);
    fake_stop(&server);
}

static enum umb_status never_got(void *user, size_t number, const void *bytes, size_t size)
{
    (void)user, (void)number, (void)bytes, (void)size;
    fail_msg("nothing was read");
    return UMB_E_INTERNAL;
}

/* A read that cannot begin must say why, as one that the server fails does. */
static void assert_region_is_busy(struct umb_client *client)
{
    const struct umb_range range = {0, 100};
    struct umb_region_source source;
    struct umb_error error = {0};
    assert_int_equal(umb_region_daemon_open(client, "city", &source, &error), UMB_OK);
    assert_int_equal(source.read(source.user, &range, 1, never_got, NULL, &error), UMB_E_BUSY);
    assert_int_equal(error.status, UMB_E_BUSY);
    assert_non_null(strstr(error.message, "the limit is 8"));
    assert_int_equal(source.read(source.user, &range, 1, never_got, NULL, NULL), UMB_E_BUSY);
    umb_region_daemon_close(&source);
}

static void full_client_is_busy_and_close_cancels_every_call_once(void **state)
{
    struct fake_server server = {.http1 = false};
    struct tally tally = {.lock = PTHREAD_MUTEX_INITIALIZER};
    const struct umb_client_options options = {.max_calls = 8};
    char address[128];
    struct umb_error error;
    (void)state;
    fake_start(&server, 0, address);
    struct umb_client *client = open_client(address, &options);
    struct umb_client_query_request request = make_request("silent");
    for (int i = 0; i < 8; i++) {
        assert_int_equal(umb_client_query_start(client, &request, count_call, &tally, NULL, &error),
                         UMB_OK);
    }
    assert_int_equal(umb_client_query_start(client, &request, count_call, &tally, NULL, &error),
                     UMB_E_BUSY);
    assert_non_null(strstr(error.message, "the limit is 8"));
    assert_region_is_busy(client);
    assert_int_equal(calls_so_far(&tally), 0);
    umb_client_close(client);
    assert_int_equal(tally.calls, 8);
    assert_int_equal(tally.by_status[-(int)UMB_E_CANCELLED], 8);
    fake_stop(&server);
}

static void connection_lost_in_a_reply_fails_the_call_and_the_next_one_reconnects(void **state)
{
    struct fake_server server = {.http1 = false};
    const struct umb_client_options options = {.max_retries = UMB_CLIENT_NEVER};
    char address[128];
    struct umb_error error;
    (void)state;
    fake_start(&server, 0, address);
    struct umb_client *client = open_client(address, &options);
    for (int round = 0; round < 3; round++) {
        assert_int_equal(ask(client, "drop", 2000, &error), UMB_E_UNAVAILABLE);
        assert_int_equal(ask(client, "ok", 2000, &error), UMB_OK);
    }
    umb_client_close(client);
    fake_stop(&server);
    assert_int_equal(atomic_load(&server.connections), 4);
}

static void early_error_ends_a_large_upload(void **state)
{
    enum {
        MANY = 2000000
    }; /* 24 MB, far beyond the server's window */
    struct fake_server server = {.early_error = true};
    char address[128];
    struct umb_error error;
    float *many = calloc(3 * (size_t)MANY, sizeof *many);
    float *values = calloc(MANY, sizeof *values);
    (void)state;
    assert_non_null(many);
    assert_non_null(values);
    fake_start(&server, 0, address);
    struct umb_client *client = open_client(address, NULL);
    struct umb_client_query_request request = make_request("ok");
    request.points.positions = many;
    request.points.count = MANY;
    request.timeout_ms = 5000;
    assert_int_equal(umb_client_query(client, &request, values, NULL, &error), UMB_E_TOO_LARGE);
    assert_string_equal(error.message, "points: too many");
    umb_client_close(client);
    fake_stop(&server);
    free(many);
    free(values);
}

static void missing_server_is_unavailable_until_it_comes(void **state)
{
    struct fake_server first = {.http1 = false};
    char address[128];
    struct umb_error error;
    (void)state;
    fake_start(&first, 0, address);
    int port = first.port;
    fake_stop(&first);
    struct umb_client *client = open_client(address, NULL);
    for (int i = 0; i < 3; i++) {
        assert_int_equal(ask(client, "ok", 3000, &error), UMB_E_UNAVAILABLE);
        assert_non_null(strstr(error.message, "connection refused"));
    }
    struct fake_server second = {.http1 = false};
    fake_start(&second, port, address);
    assert_int_equal(ask(client, "ok", 3000, &error), UMB_OK);
    umb_client_close(client);
    fake_stop(&second);
}

static void peers_that_are_no_http2_servers_are_named(void **state)
{
    const struct umb_client_options options = {.connect_timeout_ms = 150};
    char address[128];
    struct umb_error error;
    (void)state;
    struct fake_server web = {.http1 = true};
    fake_start(&web, 0, address);
    struct umb_client *client = open_client(address, NULL);
    assert_int_equal(ask(client, "ok", 3000, &error), UMB_E_PROTOCOL);
    assert_non_null(strstr(error.message, "HTTP/1"));
    umb_client_close(client);
    fake_stop(&web);

    struct fake_server mute = {.mute = true};
    fake_start(&mute, 0, address);
    client = open_client(address, &options);
    assert_int_equal(ask(client, "ok", 3000, &error), UMB_E_UNAVAILABLE);
    assert_non_null(strstr(error.message, "150 ms"));
    umb_client_close(client);
    fake_stop(&mute);
}

static void *ask_often(void *user)
{
    struct umb_client *client = user;
    float values[COUNT];
    struct umb_client_query_request request = make_request("ok");
    for (int i = 0; i < 40; i++) {
        struct umb_error error;
        memset(values, 0xff, sizeof values);
        if (umb_client_query(client, &request, values, NULL, &error) != UMB_OK ||
            values[COUNT - 1] != positions[3 * (COUNT - 1)]) {
            return client;
        }
    }
    return NULL;
}

static void many_threads_share_one_connection(void **state)
{
    struct fake_server server = {.max_streams = 2};
    char address[128];
    pthread_t threads[8];
    (void)state;
    fake_start(&server, 0, address);
    struct umb_client *client = open_client(address, NULL);
    for (int i = 0; i < 8; i++) {
        assert_int_equal(pthread_create(&threads[i], NULL, ask_often, client), 0);
    }
    for (int i = 0; i < 8; i++) {
        void *failed;
        assert_int_equal(pthread_join(threads[i], &failed), 0);
        assert_null(failed);
    }
    umb_client_close(client);
    fake_stop(&server);
    assert_int_equal(atomic_load(&server.connections), 1);
}

struct chain {
    struct umb_client *client;
    struct tally tally;
    int left;
    enum umb_status blocking;
};

/* A call-back may start calls, but not wait for one. */
static void start_another(void *user, enum umb_status status,
                          const struct umb_client_query_reply *reply, const struct umb_error *error)
{
    struct chain *chain = user;
    struct umb_error ignored;
    float values[COUNT];
    struct umb_client_query_request request = make_request("ok");
    if (chain->left-- > 0) {
        chain->blocking = umb_client_query(chain->client, &request, values, NULL, &ignored);
        assert_int_equal(
            umb_client_query_start(chain->client, &request, start_another, chain, NULL, &ignored),
            UMB_OK);
    }
    count_call(&chain->tally, status, reply, error);
}

static void callbacks_may_start_calls_but_not_block(void **state)
{
    struct fake_server server = {.http1 = false};
    struct chain chain = {.tally = {.lock = PTHREAD_MUTEX_INITIALIZER}, .left = 4};
    char address[128];
    struct umb_error error;
    (void)state;
    fake_start(&server, 0, address);
    const struct umb_client_options options = {.max_calls = 1}; /* a call ends before done runs */
    chain.client = open_client(address, &options);
    struct umb_client_query_request request = make_request("ok");
    assert_int_equal(
        umb_client_query_start(chain.client, &request, start_another, &chain, NULL, &error),
        UMB_OK);
    for (int i = 0; i < 500 && calls_so_far(&chain.tally) < 5; i++) {
        fake_pause(10);
    }
    assert_int_equal(calls_so_far(&chain.tally), 5);
    umb_client_close(chain.client);
    fake_stop(&server);
    assert_int_equal(chain.tally.by_status[0], 5);
    assert_int_equal(chain.blocking, UMB_E_STATE);
}

static void bad_requests_never_reach_the_server(void **state)
{
    struct umb_error error;
    float values[COUNT];
    (void)state;
    struct umb_client *client = open_client("tcp:127.0.0.1:9", NULL);
    struct umb_client_query_request request = make_request("ok");
    request.settings.taps = 2;
    assert_int_equal(umb_client_query(client, &request, values, NULL, &error), UMB_E_ARGUMENT);
    assert_non_null(strstr(error.message, "taps: 2"));
    request = make_request("");
    assert_int_equal(umb_client_query(client, &request, values, NULL, &error), UMB_E_ARGUMENT);
    request = make_request(NULL);
    assert_int_equal(umb_client_query(client, &request, values, NULL, &error), UMB_E_ARGUMENT);
    request = make_request("ok");
    request.points.positions = NULL;
    assert_int_equal(umb_client_query(client, &request, values, NULL, &error), UMB_E_ARGUMENT);
    umb_client_close(client);
    umb_client_close(NULL);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(query_gets_its_answers_stats_and_id),
        cmocka_unit_test(large_requests_and_replies_pass_the_windows),
        cmocka_unit_test(unix_sockets_and_names_work),
        cmocka_unit_test(every_bad_answer_has_its_status_and_a_sentence),
        cmocka_unit_test(refused_calls_are_tried_again_at_most_twice),
        cmocka_unit_test(goaway_moves_an_unprocessed_call_to_a_new_connection),
        cmocka_unit_test(a_server_that_greets_and_hangs_up_is_not_asked_without_end),
        cmocka_unit_test(silence_ends_at_the_deadline_and_resets_the_stream),
        cmocka_unit_test(a_peer_that_vanished_costs_one_deadline_not_all),
        cmocka_unit_test(a_slow_peer_that_answers_pings_keeps_its_connection),
        cmocka_unit_test(an_expired_call_frees_its_stream),
        cmocka_unit_test(queued_calls_expire_behind_a_full_server),
        cmocka_unit_test(full_client_is_busy_and_close_cancels_every_call_once),
        cmocka_unit_test(connection_lost_in_a_reply_fails_the_call_and_the_next_one_reconnects),
        cmocka_unit_test(early_error_ends_a_large_upload),
        cmocka_unit_test(missing_server_is_unavailable_until_it_comes),
        cmocka_unit_test(peers_that_are_no_http2_servers_are_named),
        cmocka_unit_test(many_threads_share_one_connection),
        cmocka_unit_test(callbacks_may_start_calls_but_not_block),
        cmocka_unit_test(bad_requests_never_reach_the_server),
    };
    return cmocka_run_group_tests(tests, fill_positions, NULL);
}

/* SPDX-License-Identifier: Apache-2.0 */
/* The choice of a replica, which calls are retried, how often, and when the client gives up. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include "fake_server.h"
#include "umbrage/client.h"

enum {
    COUNT = 10,
    ASSETS = 60,
    REPLICAS = 3
};

static const float positions[3 * COUNT];

static struct umb_client *open_client(const char *address, const struct umb_client_options *options)
{
    struct umb_client *client;
    struct umb_error error = {.status = UMB_OK};
    if (umb_client_open(address, options, &client, &error) != UMB_OK) {
        fail_msg("%s", error.message);
    }
    return client;
}

static enum umb_status ask(struct umb_client *client, const char *asset, struct umb_error *error)
{
    float values[COUNT];
    struct umb_client_query_request request = {
        .asset = asset,
        .settings = {.taps = 1, .format = UMB_ANSWER_F32},
        .points = {.positions = positions, .format = UMB_POINT_F32, .count = COUNT},
        .timeout_ms = 5000,
    };
    memset(error, 0, sizeof *error);
    return umb_client_query(client, &request, values, NULL, error);
}

static double now_s(void)
{
    struct timespec now;
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + (double)now.tv_nsec * 1e-9;
}

static void queries_are_asked_again_and_only_so_often(void **state)
{
    static const struct {
        const char *asset;
        uint32_t max_retries;
        enum umb_status status;
        unsigned requests;
    } cases[] = {
        {"drop-once", 0, UMB_OK, 2},
        {"away-twice", 0, UMB_OK, 3},
        {"away-twice", 1, UMB_E_UNAVAILABLE, 2},
        {"away", 0, UMB_E_UNAVAILABLE, 3},
        {"drop", 0, UMB_E_UNAVAILABLE, 3},
        {"shed-once", 0, UMB_OK, 2},
        {"shed", 0, UMB_E_BUSY, 3},
        /* what another try cannot help */
        {"not-found", 0, UMB_E_NOT_FOUND, 1},
        {"reset", 0, UMB_E_PROTOCOL, 1},
        {"never-again", 0, UMB_E_TOO_LARGE, 1},
        {"away-for-good", 0, UMB_E_UNAVAILABLE, 1},
        {"short", 0, UMB_E_PROTOCOL, 1},
        /* whom another try may hurt */
        {"drop-once", UMB_CLIENT_NEVER, UMB_E_UNAVAILABLE, 1},
        {"away", UMB_CLIENT_NEVER, UMB_E_UNAVAILABLE, 1},
        {"shed", UMB_CLIENT_NEVER, UMB_E_BUSY, 1},
    };
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct fake_server server = {.http1 = false};
        const struct umb_client_options options = {.max_retries = cases[i].max_retries};
        char address[128];
        struct umb_error error;
        fake_start(&server, 0, address);
        struct umb_client *client = open_client(address, &options);
        enum umb_status status = ask(client, cases[i].asset, &error);
        print_message("%-11s %s\n", cases[i].asset, umb_status_name(status));
        assert_int_equal(status, cases[i].status);
        umb_client_close(client);
        fake_stop(&server);
        assert_int_equal(atomic_load(&server.requests), cases[i].requests);
    }
}

static void a_server_says_when_to_come_again_and_is_obeyed(void **state)
{
    struct fake_server server = {.http1 = false};
    char address[128];
    struct umb_error error;
    (void)state;
    fake_start(&server, 0, address);
    struct umb_client *client = open_client(address, NULL);
    double start = now_s();
    assert_int_equal(ask(client, "shed-once", &error), UMB_OK);
    assert_true(now_s() - start >= 0.05);
    umb_client_close(client);
    fake_stop(&server);
    struct fake_server other = {.http1 = false};
    fake_start(&other, 0, address);
    client = open_client(address, NULL);
    start = now_s();
    assert_int_equal(ask(client, "away-a-while", &error), UMB_OK);
    assert_true(now_s() - start >= 0.4);
    umb_client_close(client);
    fake_stop(&other);
}

static void a_server_that_fails_everything_is_not_asked_thrice_as_much(void **state)
{
    struct fake_server server = {.http1 = false};
    char address[128];
    struct umb_error error;
    (void)state;
    fake_start(&server, 0, address);
    struct umb_client *client = open_client(address, NULL);
    for (int i = 0; i < 40; i++) {
        assert_int_equal(ask(client, "away", &error), UMB_E_UNAVAILABLE);
    }
    assert_in_range(atomic_load(&server.requests), 40, 48);
    for (int i = 0; i < 80; i++) { /* answers earn tries again */
        assert_int_equal(ask(client, "ok", &error), UMB_OK);
    }
    unsigned before = atomic_load(&server.requests);
    assert_int_equal(ask(client, "away", &error), UMB_E_UNAVAILABLE);
    assert_true(atomic_load(&server.requests) - before > 1);
    umb_client_close(client);
    fake_stop(&server);
}

/* Returns the server to which an asset's query went, by the requests that servers counted; all must
 * be answered. */
static void find_places(struct umb_client *client, struct fake_server *servers, int place[ASSETS])
{
    for (int asset = 0; asset < ASSETS; asset++) {
        unsigned before[REPLICAS];
        char name[32];
        struct umb_error error;
        (void)snprintf(name, sizeof name, "asset-%d", asset);
        for (int i = 0; i < REPLICAS; i++) {
            before[i] = atomic_load(&servers[i].requests);
        }
        assert_int_equal(ask(client, name, &error), UMB_OK);
        place[asset] = -1;
        for (int i = 0; i < REPLICAS; i++) {
            if (atomic_load(&servers[i].requests) > before[i]) {
                place[asset] = i;
            }
        }
    }
}

static void each_asset_has_its_replica_and_moves_only_if_that_one_goes(void **state)
{
    struct fake_server servers[REPLICAS] = {{.http1 = false}};
    char addresses[REPLICAS][128];
    char list[400];
    char backwards[400];
    int first[ASSETS], again[ASSETS], after[ASSETS];
    int share[REPLICAS] = {0};
    struct umb_error error;
    (void)state;
    for (int i = 0; i < REPLICAS; i++) {
        fake_start(&servers[i], 0, addresses[i]);
    }
    (void)snprintf(list, sizeof list, "%s,%s,%s", addresses[0], addresses[1], addresses[2]);
    (void)snprintf(backwards, sizeof backwards, "%s,%s,%s", addresses[2], addresses[1],
                   addresses[0]);
    struct umb_client *client = open_client(list, NULL);
    struct umb_client *other = open_client(backwards, NULL);
    find_places(client, servers, first);
    find_places(other, servers, again);
    for (int asset = 0; asset < ASSETS; asset++) {
        assert_int_equal(first[asset], again[asset]); /* clients agree, whatever the order */
        share[first[asset]]++;
    }
    for (int i = 0; i < REPLICAS; i++) {
        assert_in_range(share[i], ASSETS / REPLICAS / 3, ASSETS / REPLICAS * 2);
    }
    fake_stop(&servers[1]);
    find_places(client, servers, after);
    for (int asset = 0; asset < ASSETS; asset++) {
        assert_true(first[asset] == 1 ? after[asset] != 1 : after[asset] == first[asset]);
    }
    fake_stop(&servers[0]);
    fake_stop(&servers[2]);
    umb_client_close(client);
    struct umb_client *late = open_client(list, NULL);
    assert_int_equal(ask(late, "asset-1", &error), UMB_E_UNAVAILABLE); /* none ever was there */
    umb_client_close(late);
    umb_client_close(other);
}

static void *start_later(void *user)
{
    struct fake_server *server = user;
    char address[128];
    fake_pause(300);
    fake_start(server, server->port, address);
    return NULL;
}

static void a_server_that_is_restarted_is_waited_for(void **state)
{
    struct fake_server server = {.http1 = false};
    struct fake_server next = {.http1 = false};
    char address[128];
    pthread_t thread;
    struct umb_error error;
    (void)state;
    fake_start(&server, 0, address);
    struct umb_client *client = open_client(address, NULL);
    assert_int_equal(ask(client, "ok", &error), UMB_OK);
    next.port = server.port;
    fake_stop(&server);
    assert_int_equal(pthread_create(&thread, NULL, start_later, &next), 0);
    for (int i = 0; i < 5; i++) {
        assert_int_equal(ask(client, "ok", &error), UMB_OK);
    }
    (void)pthread_join(thread, NULL);
    umb_client_close(client);
    fake_stop(&next);
    assert_int_equal(atomic_load(&next.requests), 5);
}

static void a_silent_server_that_owes_an_answer_is_found_out_before_the_deadline(void **state)
{
    struct fake_server server = {.http1 = false};
    const struct umb_client_options options = {
        .keepalive_ms = 50, .connect_timeout_ms = 1000, .max_retries = UMB_CLIENT_NEVER};
    char address[128];
    struct umb_error error;
    (void)state;
    fake_start(&server, 0, address);
    struct umb_client *client = open_client(address, &options);
    assert_int_equal(ask(client, "ok", &error), UMB_OK);
    fake_pause(200); /* nothing is owed: the silence is all right */
    assert_int_equal(ask(client, "ok", &error), UMB_OK);
    assert_int_equal(atomic_load(&server.connections), 1);
    atomic_store(&server.frozen, true);
    assert_int_equal(ask(client, "ok", &error), UMB_E_UNAVAILABLE);
    assert_non_null(strstr(error.message, "sign of life"));
    umb_client_close(client);
    fake_stop(&server);
}

static void ignore(void *user, enum umb_status status, const struct umb_client_query_reply *reply,
                   const struct umb_error *error)
{
    (void)user;
    (void)status;
    (void)reply;
    (void)error;
}

static void requests_are_held_up_to_a_number_of_bytes(void **state)
{
    struct fake_server server = {.http1 = false};
    const struct umb_client_options options = {.max_request_bytes = 300};
    const struct umb_client_query_request request = {
        .asset = "silent",
        .settings = {.taps = 1},
        .points = {.positions = positions, .format = UMB_POINT_F32, .count = COUNT},
    };
    char address[128];
    struct umb_error error;
    (void)state;
    fake_start(&server, 0, address);
    struct umb_client *client = open_client(address, &options);
    assert_int_equal(umb_client_query_start(client, &request, ignore, NULL, NULL, &error), UMB_OK);
    assert_int_equal(umb_client_query_start(client, &request, ignore, NULL, NULL, &error), UMB_OK);
    assert_int_equal(umb_client_query_start(client, &request, ignore, NULL, NULL, &error),
                     UMB_E_BUSY);
    assert_non_null(strstr(error.message, "300"));
    umb_client_close(client);
    fake_stop(&server);
}

static void lists_of_replicas_are_checked_one_by_one(void **state)
{
    static const char *const bad[] = {",", "tcp:a:1,", "tcp:a:1,,tcp:b:1", "tcp:a:1,b:2"};
    struct umb_client *client;
    struct umb_error error;
    char many[65 * 8 + 1] = "";
    (void)state;
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        assert_int_equal(umb_client_open(bad[i], NULL, &client, &error), UMB_E_ARGUMENT);
    }
    for (int i = 0; i < 65; i++) {
        memcpy(many + 8 * i, "tcp:a:1,", 8);
    }
    many[65 * 8 - 1] = '\0';
    assert_int_equal(umb_client_open(many, NULL, &client, &error), UMB_E_ARGUMENT);
    assert_non_null(strstr(error.message, "64"));
    many[64 * 8 - 1] = '\0';
    assert_int_equal(umb_client_open(many, NULL, &client, &error), UMB_OK);
    umb_client_close(client);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(queries_are_asked_again_and_only_so_often),
        cmocka_unit_test(a_server_says_when_to_come_again_and_is_obeyed),
        cmocka_unit_test(a_server_that_fails_everything_is_not_asked_thrice_as_much),
        cmocka_unit_test(each_asset_has_its_replica_and_moves_only_if_that_one_goes),
        cmocka_unit_test(a_server_that_is_restarted_is_waited_for),
        cmocka_unit_test(a_silent_server_that_owes_an_answer_is_found_out_before_the_deadline),
        cmocka_unit_test(requests_are_held_up_to_a_number_of_bytes),
        cmocka_unit_test(lists_of_replicas_are_checked_one_by_one),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

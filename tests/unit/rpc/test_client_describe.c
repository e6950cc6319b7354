/* SPDX-License-Identifier: Apache-2.0 */
/* Descriptions of a server and its assets: list, description, limits, health. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include "call_end.h"
#include "fake_server.h"
#include "umbrage/client.h"

struct peer {
    struct fake_server server;
    struct umb_client *client;
};

static int meet_as(void **state, bool early_error)
{
    static struct peer peer;
    char address[128];
    struct umb_error error;
    memset(&peer, 0, sizeof peer);
    peer.server.early_error = early_error;
    fake_start(&peer.server, 0, address);
    *state = &peer;
    return umb_client_open(address, NULL, &peer.client, &error) == UMB_OK ? 0 : -1;
}

static int meet(void **state)
{
    return meet_as(state, false);
}

static int meet_refusing(void **state)
{
    return meet_as(state, true);
}

static int part(void **state)
{
    struct peer *peer = *state;
    umb_client_close(peer->client);
    fake_stop(&peer->server);
    return 0;
}

static void assets_are_listed(void **state)
{
    struct peer *peer = *state;
    struct umb_error error;
    struct umb_client_asset *assets;
    size_t count;
    assert_int_equal(umb_client_list_assets(peer->client, &assets, &count, &error), UMB_OK);
    assert_int_equal(count, 2);
    assert_string_equal(assets[1].name, "b");
    umb_free(assets);
}

static void an_asset_is_described(void **state)
{
    struct peer *peer = *state;
    struct umb_error error;
    struct umb_client_description *about;
    assert_int_equal(umb_client_describe(peer->client, "a", &about, NULL, &error), UMB_OK);
    assert_string_equal(about->asset.name, "a");
    assert_int_equal(about->light_count, 1);
    assert_string_equal(about->lights[0].info.name, "sun");
    assert_int_equal(about->lights[0].resolution, 1024);
    assert_string_equal(about->plan, "effect=closed state=on\n");
    umb_free(about);
}

/* Begins a call in a callback, where waiting is refused. */
struct chain {
    struct umb_client *client;
    struct umb_client_description *second;
    enum umb_status waited, begun;
    struct umb_client_async async;
};

static void on_first(void *user, enum umb_status status, const struct umb_error *error)
{
    struct chain *chain = user;
    struct umb_client_description *none;
    (void)status;
    (void)error;
    chain->waited = umb_client_describe(chain->client, "a", &none, NULL, NULL);
    chain->begun = umb_client_describe(chain->client, "a", &chain->second, &chain->async, NULL);
}

static void a_description_comes_to_a_callback(void **state)
{
    struct peer *peer = *state;
    struct end end;
    struct umb_client_description *first = NULL;
    struct umb_error error;
    end_init(&end);
    struct chain chain = {.client = peer->client, .async = {.done = on_end, .user = &end}};
    struct umb_client_async async = {.done = on_first, .user = &chain};
    assert_int_equal(umb_client_describe(peer->client, "a", &first, &async, &error), UMB_OK);
    end_wait(&end);
    assert_int_equal(chain.waited, UMB_E_STATE);
    assert_int_equal(chain.begun, UMB_OK);
    assert_int_equal(end.status, UMB_OK);
    assert_true(async.call != 0 && chain.async.call != 0 && async.call != chain.async.call);
    assert_string_equal(first->asset.name, "a");
    assert_string_equal(chain.second->plan, "effect=closed state=on\n");
    assert_string_equal(chain.second->settings, "");
    umb_free(first);
    umb_free(chain.second);
    /* A failure that is returned at once must not also be reported to the callback. */
    end.calls = 0;
    assert_int_equal(umb_client_describe(peer->client, "", &first, &chain.async, &error),
                     UMB_E_ARGUMENT);
    assert_null(first);
    assert_int_equal(end.calls, 0);
}

static void limits_are_those_that_the_server_tells(void **state)
{
    struct peer *peer = *state;
    struct umb_error error;
    struct umb_client_limits limits;
    memset(&limits, 0xff, sizeof limits);
    assert_int_equal(umb_client_get_limits(peer->client, &limits, &error), UMB_OK);
    assert_int_equal(limits.max_points, 1001);
    assert_int_equal(limits.max_message_bytes, (uint64_t)1002 << 32);
    assert_int_equal(limits.max_targets, 1003);
    assert_int_equal(limits.max_taps, 1004);
    assert_int_equal(limits.max_segments, 1010);
    assert_int_equal(limits.max_columns, 1011);
    assert_int_equal(limits.max_boxes, 1012);
    assert_int_equal(limits.max_box_steps, (uint64_t)1013 << 32);
    assert_string_equal(limits.version, "1.2.3-fake");
}

static void limits_that_are_refused_are_zero(void **state)
{
    static const struct umb_client_limits none;
    struct peer *peer = *state;
    struct umb_error error;
    struct umb_client_limits limits;
    memset(&limits, 0xff, sizeof limits);
    assert_int_equal(umb_client_get_limits(peer->client, &limits, &error), UMB_E_TOO_LARGE);
    assert_string_equal(error.message, "points: too many");
    assert_memory_equal(&limits, &none, sizeof limits);
}

static void health_is_told(void **state)
{
    struct peer *peer = *state;
    struct umb_error error;
    int serving = 0;
    assert_int_equal(umb_client_health(peer->client, NULL, &serving, &error), UMB_OK);
    assert_int_equal(serving, 1);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(assets_are_listed, meet, part),
        cmocka_unit_test_setup_teardown(an_asset_is_described, meet, part),
        cmocka_unit_test_setup_teardown(a_description_comes_to_a_callback, meet, part),
        cmocka_unit_test_setup_teardown(limits_are_those_that_the_server_tells, meet, part),
        cmocka_unit_test_setup_teardown(limits_that_are_refused_are_zero, meet_refusing, part),
        cmocka_unit_test_setup_teardown(health_is_told, meet, part),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

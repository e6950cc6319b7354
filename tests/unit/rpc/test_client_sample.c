/* SPDX-License-Identifier: Apache-2.0 */
/* Samples requested from servers that answer well and badly. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <math.h>

#include "call_end.h"
#include "fake_peer.h"
#include "umbrage/sample.h"

enum {
    COUNT = 5
};

static void points_come_with_their_origin_and_asset(void **state)
{
    static const char *const assets[] = {"ok", "few"};
    static const char *const notes[] = {"", "one is missing"};
    const struct umb_sample_settings settings = {.count = COUNT, .seed = 40};
    struct peer *peer = *state;
    for (size_t i = 0; i < 2; i++) {
        double positions[3 * COUNT];
        struct umb_sample sample;
        struct umb_error error;
        assert_int_equal(
            umb_client_sample(peer->client, assets[i], &settings, positions, &sample, NULL, &error),
            UMB_OK);
        assert_int_equal(sample.count, COUNT - i);
        assert_string_equal(sample.note, notes[i]);
        assert_int_equal(sample.asset_id[0], 0xab);
        assert_true(sample.origin[0] == 1 && sample.origin[1] == 2 && sample.origin[2] == 3);
        for (size_t k = 0; k < 3 * sample.count; k++) {
            assert_true(positions[k] == (double)(40 + k));
        }
    }
}

static void more_points_than_wanted_are_refused(void **state)
{
    const struct umb_sample_settings settings = {.count = COUNT};
    struct peer *peer = *state;
    double positions[3 * COUNT + 3] = {[3 * COUNT] = 5};
    struct umb_sample sample;
    struct umb_error error;
    assert_int_equal(
        umb_client_sample(peer->client, "lies", &settings, positions, &sample, NULL, &error),
        UMB_E_PROTOCOL);
    assert_non_null(strstr(error.message, "points_f64: 6 points, 5 were asked for"));
    assert_true(positions[3 * COUNT] == 5);
}

static void points_that_are_not_finite_are_refused(void **state)
{
    const struct umb_sample_settings settings = {.count = COUNT};
    struct peer *peer = *state;
    double positions[3 * COUNT];
    struct umb_sample sample;
    struct umb_error error;
    assert_int_equal(
        umb_client_sample(peer->client, "far", &settings, positions, &sample, NULL, &error),
        UMB_E_PROTOCOL);
    assert_non_null(strstr(error.message, "points_f64: not all numbers are finite"));
    assert_int_equal(sample.count, 0);
}

static void bad_settings_are_refused_before_they_are_sent(void **state)
{
    static const struct {
        const char *asset, *words;
        struct umb_sample_settings settings;
    } rows[] = {
        {"", "asset", {.count = 1}},
        {"ok", "count: 0, must be 1 to 65536", {.count = 0}},
        {"ok", "count: 65537", {.count = UMB_SAMPLE_MAX + 1}},
        {"ok", "scattered: 1.5", {.count = 1, .scattered = 1.5}},
        {"ok", "scattered", {.count = 1, .scattered = NAN}},
        {"ok", "settings.reserved[3]", {.count = 1, .reserved = {0, 0, 0, 1}}},
    };
    struct peer *peer = *state;
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        double positions[3];
        struct umb_sample sample;
        struct umb_error error;
        assert_int_equal(umb_client_sample(peer->client, rows[i].asset, &rows[i].settings,
                                           positions, &sample, NULL, &error),
                         UMB_E_ARGUMENT);
        assert_non_null(strstr(error.message, rows[i].words));
    }
    assert_int_equal(atomic_load(&peer->server.requests), 0);
}

static void a_sample_ends_in_a_callback_or_is_cancelled(void **state)
{
    static const char *const assets[] = {"ok", "lies", "silent"};
    static const enum umb_status statuses[] = {UMB_OK, UMB_E_PROTOCOL, UMB_E_CANCELLED};
    const struct umb_sample_settings settings = {.count = COUNT};
    struct peer *peer = *state;
    for (size_t i = 0; i < 3; i++) {
        double positions[3 * COUNT];
        struct umb_sample sample;
        struct end end;
        end_init(&end);
        struct umb_client_async async = {.done = on_end, .user = &end};
        assert_int_equal(umb_client_sample(peer->client, assets[i], &settings, positions, &sample,
                                           &async, &end.error),
                         UMB_OK);
        if (statuses[i] == UMB_E_CANCELLED) {
            assert_int_equal(umb_client_cancel(peer->client, async.call, NULL), UMB_OK);
        }
        end_wait(&end);
        assert_int_equal(end.status, statuses[i]);
        assert_int_equal(sample.count, statuses[i] == UMB_OK ? COUNT : 0);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(points_come_with_their_origin_and_asset, meet, part),
        cmocka_unit_test_setup_teardown(more_points_than_wanted_are_refused, meet, part),
        cmocka_unit_test_setup_teardown(points_that_are_not_finite_are_refused, meet, part),
        cmocka_unit_test_setup_teardown(bad_settings_are_refused_before_they_are_sent, meet, part),
        cmocka_unit_test_setup_teardown(a_sample_ends_in_a_callback_or_is_cancelled, meet, part),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

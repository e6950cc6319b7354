/* SPDX-License-Identifier: Apache-2.0 */
/* Segments, columns and boxes requested from servers that answer well and badly. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <math.h>

#include "call_end.h"
#include "fake_peer.h"
#include "umbrage/volume_queries.h"

enum {
    COUNT = 5,
    KEPT = 3
};

static const float ends[COUNT][6];

static enum umb_status ask(struct peer *peer, const char *asset, size_t kept,
                           struct umb_segment_answer segments[COUNT],
                           struct umb_interval intervals[COUNT * KEPT],
                           struct umb_volume_query_reply *reply, struct umb_error *error)
{
    const struct umb_volume_query volume_query = {.asset = asset, .timeout_ms = 20000};
    const struct umb_segments asked = {.ends = ends, .count = COUNT};
    struct umb_segment_answers answers = {
        .segments = segments, .intervals = intervals, .interval_max = kept};
    return umb_client_segments(peer->client, &volume_query, &asked, &answers, reply, NULL, error);
}

static void intervals_come_to_the_places_of_their_segments(void **state)
{
    struct umb_segment_answer segments[COUNT];
    struct umb_interval intervals[COUNT * KEPT];
    struct umb_volume_query_reply reply;
    struct umb_error error;
    for (size_t kept = 0; kept <= KEPT; kept += KEPT) {
        assert_int_equal(ask(*state, "ok", kept, segments, intervals, &reply, &error), UMB_OK);
        assert_int_equal(reply.asset_id[0], 0xab);
        assert_int_equal(reply.stats.nodes, 7);
        for (size_t i = 0; i < COUNT; i++) {
            assert_true(segments[i].lit == (double)i && segments[i].lit_m == (double)i);
            assert_int_equal(segments[i].interval_count, i);
            for (size_t k = 0; k < i && k < kept; k++) {
                assert_true(intervals[i * KEPT + k].begin == (double)k);
                assert_true(intervals[i * KEPT + k].end == (double)k + 0.5);
            }
        }
    }
}

static void replies_that_do_not_fit_are_refused(void **state)
{
    static const char *const assets[] = {"lies", "few"};
    static const char *const said[] = {"stretches: 8, stretch_counts make 9", "lit: length is 32"};
    for (size_t i = 0; i < 2; i++) {
        struct umb_segment_answer segments[COUNT];
        struct umb_interval intervals[COUNT * KEPT];
        struct umb_volume_query_reply reply;
        struct umb_error error;
        assert_int_equal(ask(*state, assets[i], KEPT, segments, intervals, &reply, &error),
                         UMB_E_PROTOCOL);
        assert_non_null(strstr(error.message, said[i]));
        assert_int_equal(reply.stats.nodes, 0);
    }
}

static void bad_volume_queries_are_refused_before_they_are_sent(void **state)
{
    struct peer *peer = *state;
    struct umb_segment_answer segments[COUNT];
    struct umb_column_answer columns[1];
    struct umb_column_answers answers = {.columns = columns};
    struct umb_error error;
    const struct umb_volume_query volume_query = {.asset = "ok"};
    const struct umb_points points = {.positions = ends, .origin = {0, NAN, 0}, .count = 1};
    assert_int_equal(ask(peer, "", 0, segments, NULL, NULL, &error), UMB_E_ARGUMENT);
    assert_non_null(strstr(error.message, "asset"));
    assert_int_equal(
        umb_client_columns(peer->client, &volume_query, &points, &answers, NULL, NULL, &error),
        UMB_E_ARGUMENT);
    assert_non_null(strstr(error.message, "origin"));
    assert_int_equal(atomic_load(&peer->server.requests), 0);
}

static void a_volume_query_ends_in_a_callback_or_is_cancelled(void **state)
{
    static const char *const assets[] = {"ok", "lies", "silent"};
    static const enum umb_status statuses[] = {UMB_OK, UMB_E_PROTOCOL, UMB_E_CANCELLED};
    struct peer *peer = *state;
    for (size_t i = 0; i < 3; i++) {
        struct umb_segment_answer segments[COUNT];
        struct umb_interval intervals[COUNT * KEPT];
        struct umb_segment_answers answers = {
            .segments = segments, .intervals = intervals, .interval_max = KEPT};
        struct umb_volume_query_reply reply;
        struct end end;
        end_init(&end);
        struct umb_client_async async = {.done = on_end, .user = &end};
        const struct umb_volume_query volume_query = {.asset = assets[i], .timeout_ms = 20000};
        const struct umb_segments asked = {.ends = ends, .count = COUNT};
        assert_int_equal(umb_client_segments(peer->client, &volume_query, &asked, &answers, &reply,
                                             &async, &end.error),
                         UMB_OK);
        assert_int_equal(umb_client_cancel(peer->client, 0, NULL), UMB_OK);
        assert_int_equal(umb_client_cancel(peer->client, async.call + 1, NULL), UMB_OK);
        if (statuses[i] == UMB_E_CANCELLED) {
            assert_int_equal(umb_client_cancel(peer->client, async.call, NULL), UMB_OK);
        }
        end_wait(&end);
        assert_int_equal(end.status, statuses[i]);
        if (statuses[i] == UMB_OK) {
            assert_int_equal(answers.stats.nodes, 7);
            assert_true(segments[4].lit == 4.0);
        } else {
            assert_int_equal(end.error.status, statuses[i]);
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(intervals_come_to_the_places_of_their_segments, meet, part),
        cmocka_unit_test_setup_teardown(replies_that_do_not_fit_are_refused, meet, part),
        cmocka_unit_test_setup_teardown(a_volume_query_ends_in_a_callback_or_is_cancelled, meet,
                                        part),
        cmocka_unit_test_setup_teardown(bad_volume_queries_are_refused_before_they_are_sent, meet,
                                        part),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

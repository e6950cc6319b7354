/* SPDX-License-Identifier: Apache-2.0 */
/* Calls about jobs, both blocking and with a callback: the same statuses and the same results. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <stdlib.h>
#include <unistd.h>

#include "call_end.h"
#include "fake_server.h"
#include "umbrage/jobs.h"

struct peer {
    struct fake_server server;
    struct umb_client *client;
    struct end end;
};

static int meet(void **state)
{
    static struct peer peer;
    char address[128];
    struct umb_error error;
    memset(&peer, 0, sizeof peer);
    end_init(&peer.end);
    fake_start(&peer.server, 0, address);
    *state = &peer;
    return umb_client_open(address, NULL, &peer.client, &error) == UMB_OK ? 0 : -1;
}

static int part(void **state)
{
    struct peer *peer = *state;
    umb_client_close(peer->client);
    fake_stop(&peer->server);
    return 0;
}

/* Status of the call: as returned, or as its callback got it. */
static enum umb_status ended(struct peer *peer, bool async, enum umb_status status)
{
    if (async && status == UMB_OK) {
        end_wait(&peer->end);
        peer->end.calls = 0;
        return peer->end.status;
    }
    return status;
}

static int on_status(void *user, const struct umb_job_status *status)
{
    unsigned *seen = user;
    assert_string_equal(status->job, *seen == 0 ? "first" : "second");
    ++*seen;
    return 1;
}

static enum umb_status on_bytes(void *user, uint64_t offset, const void *bytes, size_t count,
                                uint64_t size)
{
    char *out = user;
    assert_int_equal(size, 10);
    memcpy(out + offset, bytes, count);
    return UMB_OK;
}

static void calls_about_jobs_end_alike_waited_for_and_not(void **state)
{
    struct peer *peer = *state;
    const uint8_t asset[UMB_ID_BYTES] = {1};
    for (int async = 0; async < 2; async++) {
        struct umb_client_async later = {.done = on_end, .user = &peer->end};
        struct umb_client_async *how = async ? &later : NULL;
        struct umb_job_status status, *jobs;
        struct umb_error error;
        size_t count;
        unsigned seen = 0;
        char bytes[11] = "";
        assert_int_equal(
            ended(peer, async,
                  umb_client_watch(peer->client, "first", on_status, &seen, how, &error)),
            UMB_OK);
        assert_int_equal(seen, 2);
        assert_int_equal(
            ended(peer, async, umb_client_cancel_job(peer->client, "second", &status, how, &error)),
            UMB_OK);
        assert_string_equal(status.job, "second");
        assert_int_equal(
            ended(peer, async, umb_client_list_jobs(peer->client, 0, &jobs, &count, how, &error)),
            UMB_OK);
        assert_int_equal(count, 2);
        assert_string_equal(jobs[1].job, "second");
        umb_free(jobs);
        assert_int_equal(
            ended(peer, async,
                  umb_client_fetch(peer->client, asset, 0, on_bytes, bytes, how, &error)),
            UMB_OK);
        assert_string_equal(bytes, "0123456789");
        assert_int_equal(
            ended(peer, async,
                  umb_client_fetch(peer->client, asset, 7, on_bytes, bytes, how, &error)),
            UMB_E_PROTOCOL); /* the pieces begin elsewhere */
        assert_int_equal(
            ended(peer, async, umb_client_delete_asset(peer->client, asset, how, &error)), UMB_OK);
    }
}

static void a_submission_is_sent_waited_for_and_not(void **state)
{
    struct peer *peer = *state;
    char path[] = "/tmp/umbrage-jobs-XXXXXX";
    const int fd = mkstemp(path);
    assert_true(fd >= 0);
    assert_int_equal(write(fd, "solid", 5), 5);
    assert_int_equal(close(fd), 0);
    const struct umb_job_file file = {"scene.stl", path};
    const struct umb_job_file missing = {"scene.stl", "/nowhere/at/all"};
    for (int async = 0; async < 2; async++) {
        struct umb_client_async later = {.done = on_end, .user = &peer->end};
        struct umb_client_async *how = async ? &later : NULL;
        struct umb_job_submission submission = {
            .scene = "scene.stl", .files = &file, .file_count = 1};
        struct umb_job_submitted submitted;
        struct umb_error error;
        assert_int_equal(
            ended(peer, async,
                  umb_client_submit(peer->client, &submission, &submitted, how, &error)),
            UMB_OK);
        assert_string_equal(submitted.job, "first");
        assert_int_equal(submitted.existing, 1);
        submission.files = &missing; /* fails at once: no callback */
        assert_int_equal(umb_client_submit(peer->client, &submission, &submitted, how, &error),
                         UMB_E_NO_INPUT);
        assert_int_equal(peer->end.calls, 0);
    }
    (void)unlink(path);
}

static void a_watch_is_cancelled_by_its_number(void **state)
{
    struct peer *peer = *state;
    struct umb_client_async async = {.done = on_end, .user = &peer->end};
    unsigned seen = 0;
    assert_int_equal(umb_client_watch(peer->client, "silent", on_status, &seen, &async, NULL),
                     UMB_OK);
    assert_int_equal(umb_client_cancel(peer->client, async.call, NULL), UMB_OK);
    assert_int_equal(ended(peer, true, UMB_OK), UMB_E_CANCELLED);
    assert_int_equal(seen, 0);
    /* Closing the client must end by itself every call under way, once. */
    assert_int_equal(umb_client_watch(peer->client, "silent", on_status, &seen, &async, NULL),
                     UMB_OK);
    umb_client_close(peer->client);
    peer->client = NULL;
    assert_int_equal(peer->end.calls, 1);
    assert_int_equal(peer->end.status, UMB_E_CANCELLED);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(calls_about_jobs_end_alike_waited_for_and_not, meet, part),
        cmocka_unit_test_setup_teardown(a_submission_is_sent_waited_for_and_not, meet, part),
        cmocka_unit_test_setup_teardown(a_watch_is_cancelled_by_its_number, meet, part),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

/* SPDX-License-Identifier: Apache-2.0 */
/* umb_client_watch_asset, both blocking and with a callback. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <stdlib.h>

#include "call_end.h"
#include "fake_server.h"
#include "umbrage/region.h"

struct seen {
    unsigned count, most; /* Versions seen; number after which the callback stops, 0: never */
};

static int on_version(void *user, const uint8_t id[UMB_ID_BYTES], uint64_t file_bytes)
{
    struct seen *seen = user;
    seen->count++;
    assert_int_equal(id[0], seen->count);
    assert_int_equal(file_bytes, 100 * seen->count);
    return seen->count != seen->most;
}

static void versions_are_told_until_the_end_or_a_stop(void **state)
{
    static const struct {
        const char *asset;
        uint32_t timeout_ms;
        unsigned most, count; /* Version at which the callback stops; versions seen */
        enum umb_status status;
    } cases[] = {
        {"city", 0, 0, 2, UMB_OK},
        {"city", 60000, 1, 1, UMB_E_CANCELLED},
        {"city", 0, 2, 2, UMB_E_CANCELLED},
        {"lies", 0, 0, 1, UMB_E_PROTOCOL},
        {"silent", 50, 0, 0, UMB_E_DEADLINE},
    };
    static struct fake_server server;
    struct umb_client *client;
    struct umb_error error;
    char address[128];
    (void)state;
    fake_start(&server, 0, address);
    assert_int_equal(umb_client_open(address, NULL, &client, &error), UMB_OK);
    for (size_t i = 0; i < 2 * sizeof cases / sizeof cases[0]; i++) {
        struct seen seen = {.most = cases[i / 2].most};
        struct end end;
        end_init(&end);
        struct umb_client_async later = {.done = on_end, .user = &end};
        enum umb_status status =
            umb_client_watch_asset(client, cases[i / 2].asset, cases[i / 2].timeout_ms, on_version,
                                   &seen, i % 2 ? &later : NULL, &error);
        if (i % 2 && status == UMB_OK) {
            end_wait(&end);
            status = end.status;
        }
        assert_int_equal(status, cases[i / 2].status);
        assert_int_equal(seen.count, cases[i / 2].count);
    }
    assert_int_equal(umb_client_watch_asset(client, "", 0, on_version, NULL, NULL, &error),
                     UMB_E_ARGUMENT);
    assert_int_equal(umb_client_watch_asset(client, NULL, 0, on_version, NULL, NULL, &error),
                     UMB_E_ARGUMENT);
    umb_client_close(client);
    fake_stop(&server);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(versions_are_told_until_the_end_or_a_stop),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

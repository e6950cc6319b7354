/* SPDX-License-Identifier: Apache-2.0 */
/* See cli_origin.h. */
#include "cli_origin.h"

#include <string.h>
#include <time.h>

#include "cli_http.h"
#include "tool/clock.h"
#include "tool/tool_try.h"

#define CALL_TIMEOUT_S 60 /* time limit of the client library for a call; a round has many */

static enum umb_status connect_once(struct umbc_origin *origin, struct umb_error *error)
{
    struct umbu_session session = origin->session;
    if (origin->client) {
        return UMB_OK;
    }
    if (origin->timeout_s > 0 && origin->timeout_s < CALL_TIMEOUT_S) {
        session.options.call_timeout_ms = origin->timeout_s * 1000;
    }
    return umbu_connect(&session, &origin->client, error);
}

enum umb_status umbc_origin_open(struct umbc_origin *origin, struct umb_region_source *source,
                                 struct umb_error *error)
{
    *source = (struct umb_region_source){0};
    if (origin->timeout_s > 0 && !(origin->stop_s > 0)) {
        origin->stop_s = umbu_clock_s() + origin->timeout_s;
    }
    if (origin->url) {
        return umbc_http_open(origin->url, origin->stop_s, &origin->session.options, source, error);
    }
    if (origin->file) {
        return umb_region_file_open(origin->file, source, error);
    }
    UMB__TRY(connect_once(origin, error));
    return umb_region_daemon_open(origin->client, origin->asset, source, error);
}

void umbc_origin_close(const struct umbc_origin *origin, struct umb_region_source *source)
{
    if (origin->url) {
        umbc_http_close(source);
    } else if (origin->file) {
        umb_region_file_close(source);
    } else {
        umb_region_daemon_close(source);
    }
}

/* Version that a watch looks for. */
struct search {
    const uint8_t *known;
    bool found;
};

static int on_version(void *user, const uint8_t id[UMB_ID_BYTES], uint64_t file_bytes)
{
    struct search *search = user;
    (void)file_bytes;
    search->found = memcmp(id, search->known, UMB_ID_BYTES) != 0;
    return !search->found;
}

/* Looks once: at a daemon until it has another version, else at what is there now. */
static enum umb_status look(struct umbc_origin *origin, uint64_t left_ms, struct search *search,
                            struct umb_error *error)
{
    if (origin->asset) {
        return umb_client_watch_asset(origin->client, origin->asset,
                                      left_ms < UINT32_MAX ? (uint32_t)left_ms : 0, on_version,
                                      search, NULL, error);
    }
    struct umb_region_source source;
    uint8_t id[UMB_ID_BYTES];
    UMB__TRY(umbc_origin_open(origin, &source, error));
    const enum umb_status status = umb_region_source_id(&source, id, error);
    umbc_origin_close(origin, &source);
    search->found = status == UMB_OK && memcmp(id, search->known, UMB_ID_BYTES) != 0;
    return status;
}

/* Returns true if a failed look may succeed later. */
static bool may_come(enum umb_status status)
{
    switch (status) {
    case UMB_E_NOT_FOUND:
    case UMB_E_NO_INPUT:
    case UMB_E_CORRUPT:
    case UMB_E_FORMAT:
    case UMB_E_TRUNCATED:
    case UMB_E_IO:
    case UMB_E_BUSY:
    case UMB_E_UNAVAILABLE:
        return true;
    default:
        return false;
    }
}

static void sleep_s(double seconds)
{
    struct timespec time = {.tv_sec = (time_t)seconds};
    time.tv_nsec = (long)((seconds - (double)time.tv_sec) * 1e9);
    (void)nanosleep(&time, NULL);
}

enum umb_status umbc_origin_wait(struct umbc_origin *origin, const uint8_t id[UMB_ID_BYTES],
                                 struct umb_error *error)
{
    struct search search = {.known = id};
    for (;;) { /* Ends with a version, a refusal or the time limit */
        const double left_s = origin->stop_s > 0 ? origin->stop_s - umbu_clock_s() : 1e9;
        if (left_s <= 0) {
            return umb_fail(error, UMB_E_DEADLINE, "--timeout: %u seconds are over",
                            origin->timeout_s);
        }
        const enum umb_status status = look(origin, (uint64_t)(left_s * 1000) + 1, &search, error);
        if (search.found) {
            return UMB_OK;
        }
        if (status != UMB_OK && status != UMB_E_DEADLINE && !may_come(status)) {
            return status;
        }
        sleep_s(left_s < origin->interval_s ? left_s : origin->interval_s);
    }
}

void umbc_origin_finish(struct umbc_origin *origin)
{
    umb_client_close(origin->client);
    origin->client = NULL;
}

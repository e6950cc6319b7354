/* SPDX-License-Identifier: Apache-2.0 */
/* Replicas and retries, see rpc_endpoint.h. */
#include "rpc_endpoint.h"

#include <stdlib.h>
#include <string.h>
#include "rpc_connection.h"

#define BACKOFF_FIRST_MS 50
#define BACKOFF_MAX_MS   1000
#define TOKENS_FULL      100 /* tenths */
#define TOKENS_FAILURE   10
#define TOKENS_ANSWER    1
#define REST_MAX_MS      60000 /* Longest retry pushback that the client follows */

/* Parses the address that endpoint->text holds. */
static enum umb_status parse_endpoint(struct umb__endpoint *endpoint, struct umb_error *error)
{
    enum umb_status status =
        umbn_address_parse("address", endpoint->text, &endpoint->address, error);
    if (status == UMB_OK && strcmp(endpoint->address.port, "0") == 0) {
        return umb_fail(error, UMB_E_ARGUMENT, "address: '%.200s': the port must be 1 to 65535",
                        endpoint->text);
    }
    umbn_address_authority(&endpoint->address, endpoint->authority);
    endpoint->key = umb__asset_key(endpoint->text);
    return status;
}

enum umb_status umb__endpoints_parse(struct umb_client *client, const char *text,
                                     struct umb_error *error)
{
    size_t count = 1;
    for (const char *at = text; *at != '\0'; at++) {
        count += *at == ',';
    }
    if (count > UMB__ENDPOINTS_MAX) {
        return umb_fail(error, UMB_E_ARGUMENT, "address: %zu replicas are over the limit of %d",
                        count, UMB__ENDPOINTS_MAX);
    }
    client->endpoints = calloc(count, sizeof *client->endpoints);
    if (client->endpoints == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a client");
    }
    enum umb_status status = UMB_OK;
    for (const char *at = text; status == UMB_OK; at++) {
        struct umb__endpoint *endpoint = &client->endpoints[client->endpoint_count++];
        size_t length = strcspn(at, ",");
        if (length >= sizeof endpoint->text) {
            return umb_fail(error, UMB_E_ARGUMENT, "address: %zu bytes are over the limit of %zu",
                            length, sizeof endpoint->text - 1);
        }
        memcpy(endpoint->text, at, length);
        endpoint->text[length] = '\0';
        endpoint->client = client;
        status = parse_endpoint(endpoint, error);
        client->any_tls |= endpoint->address.transport == UMBN_TLS;
        at += length;
        if (*at == '\0') {
            break;
        }
    }
    return status;
}

static uint64_t bit_of(const struct umb__endpoint *endpoint)
{
    return (uint64_t)1 << (endpoint - endpoint->client->endpoints);
}

/* Returns the best replica that the call has not tried, if possible one that is not known to be
 * down; NULL: there is none. */
static struct umb__endpoint *choose(struct umb_client *client, const struct umb__call *call)
{
    struct umb__endpoint *best = NULL;
    uint64_t best_score = 0;
    bool best_away = true;
    uint64_t now = client->endpoint_count > 1 ? uv_hrtime() : 0;
    for (size_t i = 0; i < client->endpoint_count; i++) {
        struct umb__endpoint *endpoint = &client->endpoints[i];
        uint64_t score = umb__mix(endpoint->key ^ call->key);
        bool away = now < endpoint->backoff_until_ns;
        if ((call->tried & bit_of(endpoint)) == 0 &&
            (best == NULL || (best_away && !away) || (best_away == away && score > best_score))) {
            best = endpoint;
            best_score = score;
            best_away = away;
        }
    }
    return best;
}

void umb__call_route(struct umb_client *client, struct umb__call *call)
{
    struct umb__endpoint *endpoint = choose(client, call);
    if (endpoint == NULL) {
        call->tried = 0;
        endpoint = choose(client, call);
    }
    call->endpoint = endpoint;
    umb__call_move(call, &endpoint->waiting);
}

static void on_ready(struct umb__endpoint *endpoint)
{
    endpoint->backoff_ms = 0;
    endpoint->backoff_until_ns = 0;
    endpoint->known = true;
}

/* Doubles the pause before the next connection. */
static void back_off(struct umb__endpoint *endpoint)
{
    endpoint->backoff_ms = endpoint->backoff_ms == 0 ? BACKOFF_FIRST_MS : endpoint->backoff_ms * 2;
    if (endpoint->backoff_ms > BACKOFF_MAX_MS) {
        endpoint->backoff_ms = BACKOFF_MAX_MS;
    }
    endpoint->backoff_until_ns = uv_hrtime() + endpoint->backoff_ms * 1000000U;
}

/* Sets the timer to fire at this time at the latest. */
static void wake_by(struct umb_client *client, uint64_t at_ns);

static void on_rest_over(uv_timer_t *timer)
{
    struct umb_client *client = timer->data;
    uint64_t now = uv_hrtime();
    uint64_t next_ns = UINT64_MAX;
    struct umb__call *next;
    client->rest_armed_ns = 0;
    for (struct umb__call *call = client->resting.first; call != NULL; call = next) {
        next = call->next;
        if (call->ready_ns <= now) {
            umb__call_route(client, call);
        } else if (call->ready_ns < next_ns) {
            next_ns = call->ready_ns;
        }
    }
    if (next_ns != UINT64_MAX) {
        wake_by(client, next_ns);
    }
    umb__client_dispatch(client);
}

static void wake_by(struct umb_client *client, uint64_t at_ns)
{
    uint64_t now = uv_hrtime();
    if (client->rest_armed_ns != 0 && client->rest_armed_ns <= at_ns) {
        return;
    }
    client->rest_armed_ns = at_ns;
    uv_update_time(&client->loop);
    (void)uv_timer_start(&client->rest_timer, on_rest_over,
                         at_ns > now ? (at_ns - now) / 1000000U + 1 : 0, 0);
}

static const struct umb__connection_events EVENTS;

/* Submits every waiting call. Returns false if the connection is full and another one is needed. */
static bool submit_waiting(struct umb__endpoint *endpoint, struct umb__connection *connection)
{
    while (endpoint->waiting.first != NULL) {
        if (!umb__session_submit(connection, endpoint->waiting.first)) {
            endpoint->current = NULL;
            return false;
        }
    }
    umb__connection_flush(connection);
    return true;
}

static void dispatch(struct umb__endpoint *endpoint)
{
    struct umb_client *client = endpoint->client;
    /* Replaces a full connection, but only once: a new connection takes at least one call. */
    while (endpoint->waiting.first != NULL && !client->stopped) {
        struct umb__connection *connection = endpoint->current;
        if (connection != NULL) {
            if (!connection->ready || submit_waiting(endpoint, connection)) {
                return;
            }
            continue;
        }
        if (uv_hrtime() < endpoint->backoff_until_ns) {
            wake_by(client, endpoint->backoff_until_ns);
            return;
        }
        umb__connection_open(endpoint, &EVENTS);
        return;
    }
}

void umb__client_dispatch(struct umb_client *client)
{
    for (size_t i = 0; i < client->endpoint_count; i++) {
        dispatch(&client->endpoints[i]);
    }
}

/* Resets a call to its state before it was sent. */
static void start_over(struct umb_client *client, struct umb__call *call)
{
    if (call->connection != NULL && call->connection->session != NULL) {
        (void)nghttp2_session_set_stream_user_data(call->connection->session, call->stream_id,
                                                   NULL);
    }
    call->connection = NULL;
    call->stream_id = 0;
    call->headers_sent = false;
    call->body_sent = 0;
    umb__reply_restart(&call->reply);
    if (call->source != NULL) {
        call->source->rewind(call->user);
    }
    /* Wakes the loop, because some callers do not dispatch the calls themselves. */
    (void)uv_async_send(&client->wake);
}

/* Returns a pause that doubles with each try, plus or minus a fifth. */
static uint64_t pause_ns(struct umb_client *client, unsigned tries)
{
    client->noise = umb__mix(client->noise);
    uint64_t pause = (uint64_t)BACKOFF_FIRST_MS * 1000000U << (tries > 4 ? 4 : tries);
    return pause * 4 / 5 + client->noise % (pause * 2 / 5);
}

static void on_broken(struct umb_client *client)
{
    client->tokens -= client->tokens < TOKENS_FAILURE ? client->tokens : TOKENS_FAILURE;
}

void umb__client_earn(struct umb_client *client)
{
    client->tokens += client->tokens < TOKENS_FULL ? TOKENS_ANSWER : 0;
}

static bool has_budget(const struct umb_client *client)
{
    return client->tokens > TOKENS_FULL / 2;
}

/* Pauses a call before its retry; false if its deadline comes before. */
static bool rest(struct umb_client *client, struct umb__call *call, uint64_t for_ns)
{
    uint64_t ready_ns = uv_hrtime() + for_ns;
    if (ready_ns >= call->deadline_ns) {
        return false;
    }
    start_over(client, call);
    call->ready_ns = ready_ns;
    umb__call_move(call, &client->resting);
    wake_by(client, ready_ns);
    return true;
}

/* Retries a call that the server may have acted on. */
static bool repeat(struct umb_client *client, struct umb__call *call, enum umb_status status)
{
    bool wished = call->reply.come_again;
    if (status != UMB_E_UNAVAILABLE && !(status == UMB_E_BUSY && wished)) {
        return false;
    }
    if (call->reply.has_grpc_status) {
        on_broken(client); /* The lost connection has paid from the retry budget already */
    }
    /* A call cannot be repeated if it has sent further requests by `feed`, or has passed replies to
     * `take`. */
    if (!has_budget(client) || !call->safe || call->reply.stay_away || call->was_fed ||
        call->reply.take != NULL || call->retries >= client->options.max_retries) {
        return false;
    }
    uint64_t for_ns =
        wished ? (uint64_t)call->reply.come_again_ms * 1000000U : pause_ns(client, call->retries);
    if (for_ns > (uint64_t)REST_MAX_MS * 1000000U) {
        return false;
    }
    call->tried |= call->endpoint != NULL ? bit_of(call->endpoint) : 0;
    call->retries++;
    return rest(client, call, for_ns);
}

bool umb__call_may_repeat(struct umb_client *client, struct umb__call *call)
{
    if (client->stopped || !has_budget(client) || call->retries >= client->options.max_retries) {
        return false;
    }
    call->retries++;
    return true;
}

/* Ends a call, successful or not, unless it is to be retried. */
static void conclude(struct umb_client *client, struct umb__call *call, enum umb_status status,
                     const struct umb_error *error, bool begun)
{
    if (status == UMB_OK) {
        umb__client_earn(client);
    } else if (!client->stopped && !begun && !call->was_fed && call->retries < UMB__RETRIES_MAX) {
        call->retries++;
        start_over(client, call);
        umb__call_route(client, call);
        return;
    } else if (!client->stopped && begun && repeat(client, call, status)) {
        return;
    }
    umb__call_complete(client, call, status, error);
}

/* Returns whether a call may wait for a replica to come back, when no replica can be reached. */
static bool may_wait(const struct umb_client *client, const struct umb__call *call)
{
    uint64_t until_ns = call->started_ns + (uint64_t)client->options.connect_timeout_ms * 1000000U;
    if (client->options.max_retries == 0 || uv_hrtime() >= until_ns) {
        return false;
    }
    for (size_t i = 0; i < client->endpoint_count; i++) {
        if (client->endpoints[i].known) {
            return true;
        }
    }
    return false;
}

/* Handles the calls that wait for a replica whose connection is lost. If the replica was not
 * reached, each call goes to another replica, waits, or ends. If the connection ended before it
 * took a call, that counts as a try of each call. */
static void on_lost(struct umb__endpoint *endpoint, const struct umb_error *reason, bool reached)
{
    struct umb_client *client = endpoint->client;
    struct umb__call_list calls = {NULL, NULL};
    back_off(endpoint);
    while (endpoint->waiting.first != NULL) {
        umb__call_move(endpoint->waiting.first, &calls);
    }
    while (calls.first != NULL) {
        struct umb__call *call = calls.first;
        call->tried |= bit_of(endpoint);
        if (reached) {
            conclude(client, call, reason->status, reason, false);
        } else if (choose(client, call) != NULL || may_wait(client, call)) {
            umb__call_route(client, call);
        } else {
            umb__call_complete(client, call, reason->status, reason);
        }
    }
}

static const struct umb__connection_events EVENTS = {
    .ready = on_ready,
    .ended = conclude,
    .broken = on_broken,
    .lost = on_lost,
    .read = umb__client_dispatch,
};

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Rights of calls. A connection remembers the last token that it looked up, and the token set that
 * it searched. So the usual call compares one hash and takes no lock. After a reload the token is
 * looked up in the new set. The remembered token may be that of another call, so each use first
 * compares its hash with the call's.
 */
#include "daemon/call/call.h"

#include <openssl/crypto.h>
#include <string.h>
#include <strings.h>

#include "base/compat.h"
#include "common/sha256.h"
#include "jobs/service.h"
#include "tool/clock.h"

void umbd_call_authorization(struct umbd_call *call, const uint8_t *value, size_t size)
{
    static const char scheme[] = "Bearer ";
    size_t length = sizeof scheme - 1;
    if (call->backend->tokens == NULL) {
        return;
    }
    call->has_token = size > length && strncasecmp((const char *)value, scheme, length) == 0;
    if (call->has_token) {
        umbs_sha256_bytes(value + length, size - length, call->token_hash);
    }
}

void umbd_conn_forget_rights(struct umbd_conn *conn)
{
    umbd_token_set_release(conn->tokens);
    conn->tokens = NULL;
    conn->token = NULL;
}

/* The call's token, or NULL. */
static struct umbd_token *find_token(struct umbd_call *call)
{
    struct umbd_conn *conn = call->conn;
    struct umbd_tokens *tokens = call->backend->tokens;
    unsigned generation = umbd_tokens_generation(tokens);
    if (conn->tokens == NULL || conn->token_generation != generation) {
        umbd_conn_doubt(conn);
        umbd_conn_forget_rights(conn);
        conn->tokens = umbd_tokens_acquire(tokens);
        conn->token_generation = generation;
    }
    if (conn->token == NULL ||
        CRYPTO_memcmp(conn->token->hash, call->token_hash, UMBD_HASH_BYTES) != 0) {
        conn->token = umbd_token_find(conn->tokens, call->token_hash);
    }
    return conn->token;
}

const struct umbd_token *umbd_call_token(struct umbd_call *call)
{
    return call->backend->tokens != NULL && call->has_token ? find_token(call) : NULL;
}

int umbd_call_sees(struct umbd_call *call, const uint8_t asset[UMB_ID_BYTES])
{
    const struct umbd_backend *backend = call->backend;
    if (backend->jobs == NULL || backend->tokens == NULL) {
        return 1; /* without tokens there is one owner */
    }
    const struct umbd_token *token = umbd_call_token(call);
    return (token != NULL && (token->scopes & UMBD_SCOPE_ADMIN) != 0) ||
           umbs_reader_has(call->home->reader, asset, backend->store_count) ||
           umbj_snapshot_owns(umbj_service_snapshot(backend->jobs), asset,
                              token != NULL ? token->name : "");
}

enum umb_status umbd_call_acquire(struct umbd_call *call, const char *name_or_id,
                                  struct umbs_entry **out, struct umb_error *error)
{
    uint8_t id[UMB_ID_BYTES];
    *out = NULL;
    if (umb_id_from_text(name_or_id, id) == UMB_OK && !umbd_call_sees(call, id)) {
        return umbs_store_not_found(name_or_id, error); /* the caller does not learn either whether
                                                           it is damaged */
    }
    enum umb_status status = umbs_reader_acquire(call->home->reader, name_or_id, out, error);
    if (status == UMB_OK && !umbd_call_sees(call, umbs_entry_item(*out)->id)) {
        umbs_entry_release(*out);
        *out = NULL;
        status = umbs_store_not_found(name_or_id, error);
    }
    return status;
}

/* Returns 1 for a plain TCP connection. It has no confidentiality: an eavesdropper could replay the
 * token, and anyone can connect. */
static int is_plain_tcp(const struct umbd_conn *conn)
{
    return conn->tls == NULL && conn->socket.handle.type == UV_TCP;
}

int umbd_call_is_allowed(struct umbd_call *call)
{
    struct umbd_server *server = call->server;
    enum umbd_scope scope = call->method->scope;
    struct umb_error error UMB__UNSET;
    if (scope == UMBD_SCOPE_SUBMIT && call->backend->tokens == NULL && is_plain_tcp(call->conn)) {
        umbd_count(&server->metrics.unauthorized, 1);
        umbd_call_fail(call, UMBW_GRPC_UNAUTHENTICATED,
                       "authorization: jobs are refused on plain TCP without a token (use unix:, "
                       "tls:, or --token-file)");
        return 0;
    }
    if (scope == UMBD_SCOPE_NONE) {
        return 1;
    }
    if (call->backend->tokens == NULL) {
        umbd_conn_prove(call->conn);
        return 1;
    }
    enum umb_status status = UMB_OK;
    const struct umbd_token *token = call->has_token ? find_token(call) : NULL;
    if (token == NULL) {
        status = umb_fail(&error, UMB_E_UNAUTHENTICATED, "authorization: %s",
                          call->has_token ? "the token is not known"
                                          : "this call needs 'Bearer TOKEN' (umbrage takes it from "
                                            "UMBRAGE_TOKEN or --token-file)");
    } else if ((token->scopes & (unsigned)scope) == 0) {
        status = umb_fail(&error, UMB_E_PERMISSION,
                          "authorization: token '%s' does not have the scope %s", token->name,
                          scope == UMBD_SCOPE_SUBMIT ? "submit" : "query");
    }
    if (status != UMB_OK) {
        umbd_count(&server->metrics.unauthorized, 1);
        umbd_call_fail_status(call, status, &error);
        return 0;
    }
    umbd_conn_prove(call->conn);
    return 1;
}

int umbd_call_may_name_assets(struct umbd_call *call)
{
    const struct umbd_token *token = umbd_call_token(call);
    return call->backend->tokens == NULL ||
           (token != NULL && (token->scopes & UMBD_SCOPE_QUERY) != 0);
}

static int refuse_rate(struct umbd_call *call, const char *whose, const char *what,
                       uint64_t per_second, uint64_t wait_ns)
{
    struct umb_error error;
    uint64_t wait_ms = wait_ns / 1000000 + 1;
    enum umb_status status = umb_fail(
        &error, UMB_E_BUSY, "rate: %s is at its limit of %llu %s a second; try again in %llu ms",
        whose, (unsigned long long)per_second, what, (unsigned long long)wait_ms);
    umbd_count(&call->server->metrics.rate_limited, 1);
    call->pushback_ms = (unsigned)wait_ms; /* an hour at most */
    umbd_call_fail_status(call, status, &error);
    return 0;
}

/*
 * Returns 1 if a call without rights is within the rate of its connection, or within that of its
 * address. The connection's own rate serves probes: behind a balancer all clients have the
 * balancer's address, and one greedy client would otherwise make the balancer's probes fail.
 */
static int open_rate_holds(struct umbd_call *call, uint64_t *wait_ns)
{
    struct umbd_conn *conn = call->conn;
    const uint64_t now_ns = umbu_clock_ns();
    if (umbd_conn_is_local(conn) ||
        umbd_rate_take(&conn->open_until_ns, UMBD_OPEN_CALLS_OF_ONE, 1, now_ns, wait_ns) ||
        umbd_rate_take(&conn->account->open_until_ns, UMBD_OPEN_CALLS_PER_SECOND, 1, now_ns,
                       wait_ns)) {
        return 1;
    }
    if (!conn->proven) {
        umbd_conn_hold(conn);
    }
    return 0;
}

void umbd_call_refused(struct umbd_call *call)
{
    uint64_t wait_ns;
    (void)open_rate_holds(call, &wait_ns);
}

int umbd_call_take_open(struct umbd_call *call)
{
    uint64_t wait_ns = 0;
    return open_rate_holds(call, &wait_ns) ||
           refuse_rate(call, "the address", "calls without rights", UMBD_OPEN_CALLS_PER_SECOND,
                       wait_ns);
}

int umbd_call_take_points(struct umbd_call *call, uint64_t points)
{
    struct umbd_conn *conn = call->conn;
    const struct umbd_options *options = &call->server->options;
    uint64_t wait_ns = 0;
    if (call->method->scope == UMBD_SCOPE_NONE) {
        return 1;
    }
    if (!umbd_call_is_allowed(call)) {
        return 0;
    }
    if (options->address_rate == 0 && conn->token == NULL) {
        return 1;
    }
    uint64_t now_ns = umbu_clock_ns();
    if (!umbd_rate_take(&conn->account->paid_until_ns, options->address_rate, points, now_ns,
                        &wait_ns)) {
        return refuse_rate(call, "the address", "points", options->address_rate, wait_ns);
    }
    if (conn->token != NULL &&
        !umbd_rate_take(&conn->token->paid_until_ns, conn->token->points_per_second, points, now_ns,
                        &wait_ns)) {
        umbd_rate_return(&conn->account->paid_until_ns, options->address_rate, points);
        return refuse_rate(call, "the token", "points", conn->token->points_per_second, wait_ns);
    }
    return 1;
}

void umbd_call_owe_points(struct umbd_call *call, uint64_t points)
{
    struct umbd_token *token = NULL;
    const uint64_t now_ns = umbu_clock_ns();
    struct umbd_conn *conn = call->conn;
    if (call->backend->tokens != NULL && call->has_token) {
        token = find_token(call);
    }
    umbd_rate_owe(&conn->account->paid_until_ns, call->server->options.address_rate, points,
                  now_ns);
    if (token != NULL) {
        umbd_rate_owe(&token->paid_until_ns, token->points_per_second, points, now_ns);
    }
}

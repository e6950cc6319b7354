/* SPDX-License-Identifier: Apache-2.0 */
/* Sockets under the HTTP/2 session: resolve, connect, read, write, loss. See rpc_connection.h. */
#include "rpc_connection.h"

#include <errno.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Returns libuv's text of an error, without its allocation for unknown codes. */
static const char *uv_text(int code, char text[96])
{
    return uv_strerror_r(code, text, 96);
}

static void keep_alive(struct umb__connection *connection);

/* Logs a line about a connection. */
UMB_PRINTF(2, 3)
static void tell(const struct umb_client *client, const char *format, ...)
{
    char message[400];
    va_list arguments;
    if (client->options.log != NULL) {
        va_start(arguments, format);
        (void)vsnprintf(message, sizeof message, format, arguments);
        va_end(arguments);
        client->options.log(client->options.log_user, UMB_LOG_INFO, message);
    }
}

static void free_if_done(struct umb__connection *connection)
{
    if (connection->lost && connection->handles == 0 && !connection->resolving) {
        uv_freeaddrinfo(connection->addresses);
        umbw_buffer_finish(&connection->out);
        umbw_buffer_finish(&connection->sealed);
        umbw_buffer_finish(&connection->records);
        umbn_tls_destroy(connection->tls);
        free(connection);
    }
}

static void on_handle_closed(uv_handle_t *handle)
{
    struct umb__connection *connection = handle->data;
    connection->handles--;
    free_if_done(connection);
}

static void unlink_connection(struct umb__connection *connection)
{
    struct umb_client *client = connection->client;
    if (connection->endpoint->current == connection) {
        connection->endpoint->current = NULL;
    }
    if (connection->previous != NULL) {
        connection->previous->next = connection->next;
    } else {
        client->connections = connection->next;
    }
    if (connection->next != NULL) {
        connection->next->previous = connection->previous;
    }
}

/* Queues unsent calls again, and fails the others. */
static void release_calls(struct umb__connection *connection, const struct umb_error *reason)
{
    struct umb__call *next;
    for (struct umb__call *call = connection->active.first; call != NULL; call = next) {
        next = call->next;
        connection->events->ended(connection->client, call, reason->status, reason,
                                  call->headers_sent);
    }
}

void umb__connection_lose(struct umb__connection *connection, const struct umb_error *reason)
{
    if (connection->lost) {
        return;
    }
    struct umb_client *client = connection->client;
    connection->lost = true;
    unlink_connection(connection);
    tell(client, "connection ended: %s", reason->message);
    if (connection->active.first != NULL) {
        connection->events->broken(client);
    }
    release_calls(connection, reason);
    nghttp2_session_del(connection->session);
    connection->session = NULL;
    (void)uv_timer_stop(&connection->timer);
    uv_close((uv_handle_t *)&connection->timer, on_handle_closed);
    if (connection->socket_open) {
        connection->socket_open = false;
        uv_close(&connection->socket.handle, on_handle_closed);
    }
    if (connection->resolving) {
        (void)uv_cancel((uv_req_t *)&connection->resolve); /* The cancellation may be too late: the
                                                              call then completes as usual */
    }
    if (!client->stopped && (!connection->ready || !connection->used)) {
        connection->events->lost(connection->endpoint, reason, connection->ready);
    }
    if (!client->stopped) {
        (void)uv_async_send(&client->wake); /* Waiting calls need another connection */
    }
}

static void lose_uv(struct umb__connection *connection, int code, const char *what)
{
    char text[96];
    struct umb_error error;
    (void)umb_fail(&error, UMB_E_UNAVAILABLE, "%.180s: %s: %s", connection->endpoint->text, what,
                   uv_text(code, text));
    umb__connection_lose(connection, &error);
}

/* Returns the reason why a session ended, as exactly as it is known. */
static void lose_session(struct umb__connection *connection, const char *what)
{
    struct umb_error error;
    const char *address = connection->endpoint->text;
    if (connection->http1) {
        (void)umb_fail(&error, UMB_E_PROTOCOL,
                       "%.180s: the server speaks HTTP/1, not HTTP/2; is this the address of "
                       "umbraged's --listen?",
                       address);
    } else if (connection->detail[0] != '\0') {
        (void)umb_fail(&error, UMB_E_PROTOCOL, "%.120s: %s (%s)", address, what,
                       connection->detail);
    } else {
        (void)umb_fail(&error, UMB_E_UNAVAILABLE, "%.180s: %s", address, what);
    }
    umb__connection_lose(connection, &error);
}

static bool append(struct umbw_buffer *buffer, const uint8_t *bytes, size_t count)
{
    if (umbw_buffer_reserve(buffer, count, NULL) != UMB_OK) {
        return false;
    }
    memcpy(buffer->bytes + buffer->size, bytes, count);
    buffer->size += count;
    return true;
}

/* Gathers up to SEND_BYTES bytes of HTTP/2 frames. Returns false if the session is broken. */
static bool collect_frames(struct umb__connection *connection)
{
    while (connection->out.size < UMB__SEND_BYTES) {
        const uint8_t *bytes;
        ssize_t count = nghttp2_session_mem_send(connection->session, &bytes);
        if (count <= 0) {
            return count == 0;
        }
        if (!append(&connection->out, bytes, (size_t)count)) {
            return false;
        }
    }
    return true;
}

/* Returns the buffer to write next: HTTP/2 frames or, with TLS, the records that contain them. */
static struct umbw_buffer *output_of(struct umb__connection *connection)
{
    return connection->tls != NULL ? &connection->sealed : &connection->out;
}

/* Stores records of the TLS session until they can be written. */
static bool keep_records(void *user, const uint8_t *bytes, size_t count)
{
    return append(&((struct umb__connection *)user)->records, bytes, count);
}

/* Makes the stored records the next write. */
static void take_records(struct umb__connection *connection)
{
    struct umbw_buffer written = connection->sealed;
    connection->sealed = connection->records;
    connection->records = written;
    connection->records.size = 0;
}

/* Fills the output; false if the session is broken or memory is out. */
static bool fill_output(struct umb__connection *connection)
{
    connection->out.size = 0;
    if ((connection->tls == NULL || umbn_tls_ready(connection->tls)) &&
        !collect_frames(connection)) {
        return false;
    }
    if (connection->tls == NULL) {
        return true;
    }
    bool sealed = umbn_tls_seal(connection->tls, connection->out.bytes, connection->out.size);
    take_records(connection);
    return sealed;
}

static void on_written(uv_write_t *request, int code)
{
    struct umb__connection *connection = request->data;
    connection->writing = false;
    if (connection->lost) {
        return;
    }
    if (code < 0) {
        lose_uv(connection, code, "connection lost");
        return;
    }
    umb__connection_flush(connection);
}

/* Writes as much as the socket takes at once, and leaves the rest to libuv. */
static int write_output(struct umb__connection *connection)
{
    struct umbw_buffer *out = output_of(connection);
    uv_buf_t piece = {.base = (char *)out->bytes, .len = out->size};
    int written = uv_try_write(&connection->socket.stream, &piece, 1);
    if (written == UV_EAGAIN) {
        written = 0;
    }
    if (written < 0) {
        return written;
    }
    if ((size_t)written == out->size) {
        return 0;
    }
    piece.base += written;
    piece.len -= (size_t)written;
    connection->write.data = connection;
    int code = uv_write(&connection->write, &connection->socket.stream, &piece, 1, on_written);
    connection->writing = code == 0;
    return code;
}

/* Returns true if no more bytes will be read or written: the session is broken, or the connection
 * is draining and its last call has ended. */
static bool is_over(const struct umb__connection *connection)
{
    if (connection->session == NULL || nghttp2_session_want_write(connection->session)) {
        return false; /* Also during a TLS handshake: the settings wait to be sent */
    }
    return !nghttp2_session_want_read(connection->session) ||
           (connection->draining && connection->active.first == NULL);
}

void umb__connection_flush(struct umb__connection *connection)
{
    while (!connection->lost && !connection->writing && connection->session != NULL) {
        if (!fill_output(connection)) {
            lose_session(connection, "cannot send: out of memory");
            return;
        }
        if (output_of(connection)->size == 0) {
            break;
        }
        int code = write_output(connection);
        if (code < 0) {
            lose_uv(connection, code, "connection lost");
            return;
        }
    }
    if (!connection->lost && !connection->writing && is_over(connection)) {
        lose_session(connection, "the server closed the connection");
    }
}

static void on_alloc(uv_handle_t *handle, size_t suggested, uv_buf_t *buffer)
{
    (void)suggested;
    struct umb__connection *connection = handle->data;
    /* One buffer serves all connections: libuv reads and calls back before the next alloc. */
    buffer->base = (char *)connection->client->receive_buffer;
    buffer->len = UMB__RECEIVE_BYTES;
}

/* Starts to drain: new and unsent calls go to another connection. */
static void start_draining(struct umb__connection *connection)
{
    struct umb_client *client = connection->client;
    if (connection->endpoint->current == connection) {
        connection->endpoint->current = NULL;
        tell(client, "%s: the server is going away", connection->endpoint->text);
    }
    umb__session_give_back(connection);
}

/* Gives HTTP/2 bytes from the peer to the session. Returns false if that lost the connection. */
static int take_plain(void *user, const uint8_t *bytes, size_t count)
{
    struct umb__connection *connection = user;
    if (!connection->saw_bytes) {
        connection->saw_bytes = true;
        connection->http1 = count >= 5 && memcmp(bytes, "HTTP/", 5) == 0;
    }
    ssize_t taken = nghttp2_session_mem_recv(connection->session, bytes, count);
    if (connection->ready && !connection->reported) {
        connection->reported = true;
        keep_alive(connection);
        connection->events->ready(connection->endpoint);
    }
    if (taken < 0) {
        lose_session(connection, nghttp2_strerror((int)taken));
        return -1;
    }
    return 0;
}

/* Ends TLS after a failure. Sends the reason to the peer, if the socket takes the bytes at once. */
static void lose_tls(struct umb__connection *connection, const struct umb_error *detail)
{
    struct umb_error error;
    if (connection->lost) {
        return;
    }
    if (!connection->writing) {
        take_records(connection);
        if (connection->sealed.size > 0) {
            (void)write_output(connection);
        }
    }
    (void)umb_fail(&error, detail->status, "%.120s: %.280s", connection->endpoint->text,
                   detail->message);
    umb__connection_lose(connection, &error);
}

static void on_read(uv_stream_t *stream, ssize_t count, const uv_buf_t *buffer)
{
    struct umb__connection *connection = stream->data;
    struct umb_client *client = connection->client;
    if (connection->lost || count == 0) {
        return;
    }
    if (count < 0) {
        if (count == UV_EOF) {
            lose_session(connection, "connection closed by the server before the reply came");
        } else {
            lose_uv(connection, (int)count, "connection lost");
        }
        return;
    }
    connection->heard = true;
    if (connection->probing) {
        connection->probing = false;
        keep_alive(connection);
    }
    if (connection->tls != NULL) {
        struct umb_error error;
        if (umb__tls_open(connection->tls, (const uint8_t *)buffer->base, (size_t)count, take_plain,
                          connection, &error) != UMB_OK) {
            lose_tls(connection, &error);
            return;
        }
    } else {
        (void)take_plain(connection, (const uint8_t *)buffer->base, (size_t)count);
    }
    if (connection->lost) {
        return;
    }
    if (connection->draining) {
        start_draining(connection);
    }
    umb__connection_flush(connection);
    connection->events->read(client);
}

static void on_timeout(uv_timer_t *timer)
{
    struct umb__connection *connection = timer->data;
    const char *last = connection->probing ? "" : connection->last_error.message;
    struct umb_error error;
    if (!connection->ready || connection->probing) {
        (void)umb_fail(&error, UMB_E_UNAVAILABLE, "%.180s: %s within %lu ms%s%.80s",
                       connection->endpoint->text,
                       connection->probing ? "no sign of life" : "no HTTP/2 connection",
                       (unsigned long)connection->client->options.connect_timeout_ms,
                       last[0] != '\0' ? ", last: " : "", last);
        umb__connection_lose(connection, &error);
    } else if (connection->active.first != NULL && !connection->heard) {
        umb__connection_probe(connection);
        umb__connection_flush(connection);
    } else {
        keep_alive(connection);
    }
}

static void set_timer(struct umb__connection *connection, uint32_t wait_ms)
{
    uv_update_time(&connection->client->loop);
    (void)uv_timer_start(&connection->timer, on_timeout, wait_ms, 0);
}

/* Sets the timer of a ready connection. When the timer ends, a PING is sent to a peer that owes
 * answers and was silent. */
static void keep_alive(struct umb__connection *connection)
{
    connection->heard = false;
    set_timer(connection, connection->client->options.keepalive_ms);
}

void umb__connection_probe(struct umb__connection *connection)
{
    if (!connection->lost && connection->ready && !connection->probing &&
        nghttp2_submit_ping(connection->session, NGHTTP2_FLAG_NONE, NULL) == 0) {
        connection->probing = true;
        set_timer(connection, connection->client->options.connect_timeout_ms);
    }
}

/* Makes the TLS session of a tls: address. The next flush sends the hello message. */
static enum umb_status start_tls(struct umb__connection *connection, struct umb_error *error)
{
    const struct umb_client *client = connection->client;
    const struct umbn_address *address = &connection->endpoint->address;
    if (address->transport != UMBN_TLS) {
        return UMB_OK;
    }
    const char *name = client->server_name != NULL ? client->server_name : address->host;
    enum umb_status status = umb__tls_create(client->tls_context, name, keep_records, connection,
                                             &connection->tls, error);
    return status == UMB_OK ? umb__tls_open(connection->tls, NULL, 0, take_plain, connection, error)
                            : status;
}

static void start_session(struct umb__connection *connection)
{
    struct umb_error error;
    if (connection->endpoint->address.transport != UMBN_UNIX) {
        (void)uv_tcp_nodelay(&connection->socket.tcp, 1);
    }
    if (umb__session_create(connection, &error) != UMB_OK ||
        start_tls(connection, &error) != UMB_OK) {
        umb__connection_lose(connection, &error);
        return;
    }
    int code = uv_read_start(&connection->socket.stream, on_alloc, on_read);
    if (code < 0) {
        lose_uv(connection, code, "cannot read");
        return;
    }
    umb__connection_flush(connection);
}

static void try_next_address(struct umb__connection *connection);

static void on_socket_retired(uv_handle_t *handle)
{
    struct umb__connection *connection = handle->data;
    connection->handles--;
    if (connection->lost) {
        free_if_done(connection);
    } else {
        try_next_address(connection);
    }
}

/* Handles an address that did not answer: tries the host's next address, or fails. */
static void connect_failed(struct umb__connection *connection, int code)
{
    char text[96];
    (void)umb_fail(&connection->last_error, UMB_E_UNAVAILABLE,
                   "%.180s: cannot connect: %s; is umbraged listening there?",
                   connection->endpoint->text, uv_text(code, text));
    if (connection->next_address == NULL) {
        struct umb_error error = connection->last_error;
        umb__connection_lose(connection, &error);
        return;
    }
    connection->socket_open = false;
    uv_close(&connection->socket.handle, on_socket_retired);
}

static void on_connected(uv_connect_t *request, int code)
{
    struct umb__connection *connection = request->data;
    if (connection->lost || !connection->socket_open) {
        return;
    }
    if (code < 0) {
        connect_failed(connection, code);
        return;
    }
    start_session(connection);
}

/* Connects a new socket. address: NULL for the path of a unix: endpoint. */
static void connect_socket(struct umb__connection *connection, const struct sockaddr *address)
{
    uv_loop_t *loop = &connection->client->loop;
    int code = address != NULL ? uv_tcp_init(loop, &connection->socket.tcp)
                               : uv_pipe_init(loop, &connection->socket.pipe, 0);
    if (code < 0) {
        lose_uv(connection, code, "cannot connect");
        return;
    }
    connection->socket.handle.data = connection;
    connection->socket_open = true;
    connection->handles++;
    connection->connect.data = connection;
    if (address == NULL) {
        uv_pipe_connect(&connection->connect, &connection->socket.pipe,
                        connection->endpoint->address.path, on_connected);
        return;
    }
    code = uv_tcp_connect(&connection->connect, &connection->socket.tcp, address, on_connected);
    if (code < 0) {
        connect_failed(connection, code);
    }
}

/* Called again from on_socket_retired until all addresses are tried. */
static void try_next_address(struct umb__connection *connection)
{
    struct addrinfo *entry = connection->next_address;
    connection->next_address = entry->ai_next;
    connect_socket(connection, entry->ai_addr);
}

static void on_resolved(uv_getaddrinfo_t *request, int code, struct addrinfo *addresses)
{
    struct umb__connection *connection = request->data;
    connection->resolving = false;
    connection->addresses = addresses;
    if (connection->lost) {
        free_if_done(connection);
        return;
    }
    if (code < 0 || addresses == NULL) {
        lose_uv(connection, code < 0 ? code : UV_EAI_NODATA, "cannot resolve the host");
        return;
    }
    connection->next_address = addresses;
    try_next_address(connection);
}

/* Numeric addresses connect at once; only names need a resolver thread. */
static void connect_host(struct umb__connection *connection)
{
    const struct umbn_address *address = &connection->endpoint->address;
    int port = (int)strtol(address->port, NULL, 10);
    union {
        struct sockaddr any;
        struct sockaddr_in v4;
        struct sockaddr_in6 v6;
    } socket_address;
    if (uv_ip4_addr(address->host, port, &socket_address.v4) == 0 ||
        uv_ip6_addr(address->host, port, &socket_address.v6) == 0) {
        connect_socket(connection, &socket_address.any);
        return;
    }
    const struct addrinfo hints = {.ai_family = AF_UNSPEC, .ai_socktype = SOCK_STREAM};
    connection->resolve.data = connection;
    int code = uv_getaddrinfo(&connection->client->loop, &connection->resolve, on_resolved,
                              address->host, address->port, &hints);
    connection->resolving = code == 0;
    if (code < 0) {
        lose_uv(connection, code, "cannot resolve the host");
    }
}

void umb__connection_open(struct umb__endpoint *endpoint,
                          const struct umb__connection_events *events)
{
    struct umb_client *client = endpoint->client;
    struct umb__connection *connection = calloc(1, sizeof *connection);
    if (connection == NULL) {
        struct umb_error error;
        (void)umb_fail(&error, UMB_E_NO_MEMORY, "out of memory for a connection");
        umb__calls_fail(client, &endpoint->waiting, &error);
        return;
    }
    connection->client = client;
    connection->endpoint = endpoint;
    connection->events = events;
    (void)uv_timer_init(&client->loop, &connection->timer); /* cannot fail */
    connection->timer.data = connection;
    connection->handles = 1;
    connection->next = client->connections;
    if (client->connections != NULL) {
        client->connections->previous = connection;
    }
    client->connections = connection;
    endpoint->current = connection;
    set_timer(connection, client->options.connect_timeout_ms);
    if (endpoint->address.transport == UMBN_UNIX) {
        connect_socket(connection, NULL);
    } else {
        connect_host(connection);
    }
}

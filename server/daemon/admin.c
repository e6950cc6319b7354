/* SPDX-License-Identifier: Apache-2.0 */
/* The admin port. It is small on purpose: it reads one request line and its Host header, and
 * answers. */
#define _GNU_SOURCE /* strcasestr */
#include "daemon/daemon.h"

#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/try.h"
#include "daemon/base/net_address.h"
#include "daemon/transport/acceptor.h"
#include "daemon/transport/loop.h"
#include "daemon/work/pool.h"
#include "jobs/service.h"
#include "net/http1_fields.h"

#define REQUEST_BYTES 4096
#define CLIENTS_MAX   32
#define CLIENT_MS     5000

struct admin_client {
    uv_tcp_t tcp;
    uv_write_t write;
    struct umbd_admin *admin;
    struct admin_client *next;
    uint64_t opened_ms;
    size_t size;
    char *reply;
    int answered, closing;
    char request[REQUEST_BYTES];
};

struct umbd_admin {
    struct umbd_acceptor acceptor;
    struct umbd_daemon *daemon;
    uv_loop_t *loop;
    struct admin_client *clients;
    size_t client_count;
    char text[UMBD_ADDRESS_TEXT_SIZE];
};

static void on_client_closed(uv_handle_t *handle)
{
    struct admin_client *client = handle->data;
    free(client->reply);
    free(client);
}

static void client_close(struct admin_client *client)
{
    struct umbd_admin *admin = client->admin;
    if (client->closing) {
        return;
    }
    client->closing = 1;
    struct admin_client **at = &admin->clients;
    while (*at != client) {
        at = &(*at)->next;
    }
    *at = client->next;
    admin->client_count--;
    uv_close((uv_handle_t *)&client->tcp, on_client_closed);
}

static void on_written(uv_write_t *request, int status)
{
    (void)status;
    client_close(request->data);
}

static void answer(struct admin_client *client, const char *status, const char *type,
                   const char *body, size_t size, int head_only)
{
    size_t capacity = size + 256;
    client->answered = 1;
    client->reply = malloc(capacity);
    if (client->reply == NULL) {
        client_close(client);
        return;
    }
    int length = snprintf(client->reply, capacity,
                          "HTTP/1.1 %s\r\nContent-Type: %s\r\nContent-Length: %zu\r\n"
                          "Cache-Control: no-store\r\nConnection: close\r\n\r\n",
                          status, type, size);
    size_t total = (size_t)length;
    if (!head_only) {
        memcpy(client->reply + total, body, size);
        total += size;
    }
    uv_buf_t buffer = uv_buf_init(client->reply, (unsigned)total);
    client->write.data = client;
    if (uv_write(&client->write, (uv_stream_t *)&client->tcp, &buffer, 1, on_written) != 0) {
        client_close(client);
    }
}

static void answer_text(struct admin_client *client, const char *status, const char *body,
                        int head_only)
{
    answer(client, status, "text/plain; charset=utf-8", body, strlen(body), head_only);
}

/* Reads the values of a scrape that are not counters. */
static struct umbd_gauges read_gauges(struct umbd_daemon *daemon)
{
    struct umbj_service *jobs = daemon->backend.jobs;
    struct umbd_gauges gauges = {
        .queue_depth = umbd_pool_depth(daemon->backend.pool),
        .buffered_bytes = atomic_load(&daemon->server.buffered),
        .ready = !atomic_load(&daemon->server.draining),
    };
    umbs_store_count(daemon->backend.store, &gauges.assets);
    if (jobs != NULL) {
        gauges.jobs = umbj_service_counters(jobs);
        gauges.tiles = umbj_snapshot_tiles(umbj_service_snapshot(jobs));
    }
    return gauges;
}

static void answer_metrics(struct admin_client *client, int head_only)
{
    struct umbd_daemon *daemon = client->admin->daemon;
    const struct umbd_gauges gauges = read_gauges(daemon);
    char *text = NULL;
    size_t size = 0;
    if (umbd_metrics_text(&daemon->server.metrics, &gauges, &text, &size) != UMB_OK) {
        answer_text(client, "503 Service Unavailable", "out of memory\n", head_only);
        return;
    }
    answer(client, "200 OK", "text/plain; version=0.0.4; charset=utf-8", text, size, head_only);
    free(text);
}

/* Returns 1 if the request's Host header names this machine. A request without a Host header comes
 * from an old client, never from a browser. */
static int is_meant_for_us(const char *request)
{
    const char *host = strcasestr(request, "\r\nhost:");
    if (host == NULL) {
        return 1;
    }
    host += strlen("\r\nhost:");
    host += strspn(host, " \t");
    return umbn_host_is_local((struct umbn_http1_text){host, strcspn(host, " \t\r")});
}

static void route(struct admin_client *client)
{
    char method[8];
    char path[64];
    if (sscanf(client->request, "%7s %63s HTTP/1.", method, path) != 2 ||
        strstr(client->request, " HTTP/1.") == NULL) {
        answer_text(client, "400 Bad Request", "bad request\n", 0);
        return;
    }
    int head_only = strcmp(method, "HEAD") == 0;
    path[strcspn(path, "?")] = '\0';
    if (!is_meant_for_us(client->request)) {
        answer_text(client, "421 Misdirected Request", "Host is not this machine\n", head_only);
    } else if (!head_only && strcmp(method, "GET") != 0) {
        answer_text(client, "405 Method Not Allowed", "GET or HEAD only\n", 0);
    } else if (strcmp(path, "/metrics") == 0) {
        answer_metrics(client, head_only);
    } else if (strcmp(path, "/livez") == 0) {
        answer_text(client, "200 OK", "ok\n", head_only);
    } else if (strcmp(path, "/readyz") == 0) {
        int draining = atomic_load(&client->admin->daemon->server.draining);
        answer_text(client, draining ? "503 Service Unavailable" : "200 OK",
                    draining ? "draining\n" : "ok\n", head_only);
    } else {
        answer_text(client, "404 Not Found", "try /metrics, /livez, /readyz\n", head_only);
    }
}

static void on_alloc(uv_handle_t *handle, size_t suggested, uv_buf_t *buffer)
{
    struct admin_client *client = handle->data;
    (void)suggested;
    /* The last byte stays free for the NUL. */
    *buffer =
        uv_buf_init(client->request + client->size, (unsigned)(REQUEST_BYTES - 1 - client->size));
}

static void on_read(uv_stream_t *stream, ssize_t count, const uv_buf_t *buffer)
{
    struct admin_client *client = stream->data;
    (void)buffer;
    if (count < 0) {
        client_close(client); /* also UV_ENOBUFS: a request longer than the buffer */
        return;
    }
    client->size += (size_t)count;
    client->request[client->size] = '\0';
    if (!client->answered && strstr(client->request, "\r\n\r\n") != NULL) {
        uv_read_stop(stream);
        route(client);
    }
}

/* Closes the oldest client in favour of a new one. Otherwise silent clients would keep probes out
 * until their time-out. */
static void close_oldest(struct umbd_admin *admin)
{
    struct admin_client *oldest = admin->clients;
    while (oldest->next != NULL) {
        oldest = oldest->next;
    }
    client_close(oldest);
}

static void on_taken(struct umbd_acceptor *acceptor, int fd)
{
    struct umbd_admin *admin = acceptor->user;
    struct admin_client *client = calloc(1, sizeof *client);
    if (client == NULL) {
        (void)close(fd);
        return;
    }
    client->admin = admin;
    client->opened_ms = uv_now(admin->loop);
    uv_tcp_init(admin->loop, &client->tcp);
    client->tcp.data = client;
    client->next = admin->clients;
    admin->clients = client;
    admin->client_count++;
    int code = uv_tcp_open(&client->tcp, fd);
    if (code != 0) {
        (void)close(fd);
    }
    if (admin->client_count > CLIENTS_MAX) {
        close_oldest(admin);
    }
    if (code != 0 || uv_read_start((uv_stream_t *)&client->tcp, on_alloc, on_read) != 0) {
        client_close(client);
    }
}

/* Ignores a refused connection: the acceptor tries again with the next tick, and the gRPC listeners
 * log which resource is short. */
static void on_refused(struct umbd_acceptor *acceptor, int code)
{
    (void)acceptor;
    (void)code;
}

static void on_admin_closed(uv_handle_t *handle)
{
    struct umbd_acceptor *acceptor = handle->data;
    free(acceptor->user);
}

enum umb_status umbd_admin_open(struct umbd_daemon *daemon, struct umb_error *error)
{
    const char *option = daemon->server.options.admin;
    struct umbn_address address;
    struct sockaddr_storage resolved;
    socklen_t size = sizeof resolved;
    if (option == NULL) {
        return UMB_OK;
    }
    UMB__TRY(umbd_address_parse_admin(option, &address, error));
    UMB__TRY(umbd_address_resolve(&address, &resolved, error));
    if (!umbd_address_is_loopback(&resolved)) {
        return umb_fail(error, UMB_E_ARGUMENT, "--admin: '%.100s' is not a loopback host", option);
    }
    struct umbd_admin *admin = calloc(1, sizeof *admin);
    if (admin == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for the admin port");
    }
    admin->daemon = daemon;
    admin->loop = &daemon->server.loops[0].uv;
    admin->acceptor =
        (struct umbd_acceptor){.fd = -1, .user = admin, .taken = on_taken, .refused = on_refused};
    daemon->admin = admin;
    int fd;
    int code = umbd_socket_bind((const struct sockaddr *)&resolved, &fd);
    if (code == 0) {
        code = umbd_acceptor_start(&admin->acceptor, admin->loop, fd, CLIENTS_MAX);
    }
    if (code != 0) {
        return umb_fail(error, UMB_E_UNAVAILABLE, "--admin: cannot listen on '%.100s': %s", option,
                        uv_strerror(code));
    }
    memcpy(admin->text, "http:", 6);
    (void)getsockname(admin->acceptor.fd, (struct sockaddr *)&resolved, &size);
    umbd_address_text(&resolved, admin->text + 5, sizeof admin->text - 5);
    umbs_log_event(&daemon->server.log, UMB_LOG_INFO, "admin", "address=\"%s\"", admin->text);
    return UMB_OK;
}

const char *umbd_admin_text(const struct umbd_daemon *daemon)
{
    return daemon->admin != NULL ? daemon->admin->text : NULL;
}

void umbd_admin_tick(struct umbd_daemon *daemon, uint64_t now_ms)
{
    if (daemon->admin == NULL) {
        return;
    }
    umbd_acceptor_tick(&daemon->admin->acceptor);
    struct admin_client *client = daemon->admin->clients;
    while (client != NULL) {
        struct admin_client *next = client->next;
        if (now_ms - client->opened_ms > CLIENT_MS) {
            client_close(client);
        }
        client = next;
    }
}

void umbd_admin_close(struct umbd_daemon *daemon)
{
    struct umbd_admin *admin = daemon->admin;
    if (admin == NULL) {
        return;
    }
    while (admin->clients != NULL) {
        client_close(admin->clients);
    }
    daemon->admin = NULL;
    umbd_acceptor_close(&admin->acceptor, on_admin_closed);
}

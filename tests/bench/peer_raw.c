/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A peer without a protocol: it sends frames of a length, an id and a message over TCP. It is made
 * to be fast: one thread, epoll, messages read in place, and one write for all replies of a
 * wake-up.
 *
 *     peer_raw ASSET        prints its port
 */
#include <errno.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/socket.h>
#include <unistd.h>

#include "peer_work.h"
#include "wire/messages.h"

#define HEAD       8
#define READ_ROOM  (1 << 20)
#define EVENTS     64
#define POINTS_MAX 1000000

struct peer {
    int socket;
    uint8_t *in, *out;
    size_t in_size, in_capacity, out_at, out_size, out_capacity;
};

static void *grow(void *block, size_t size)
{
    void *bytes = realloc(block, size);
    if (bytes == NULL) {
        fprintf(stderr, "peer: no memory\n");
        exit(1);
    }
    return bytes;
}

static void answer(struct peer *peer, const struct umb_asset *asset, const uint8_t *frame,
                   size_t size)
{
    struct umbw_query_request request;
    if (umbw_decode_query_request(frame + HEAD, size, POINTS_MAX, &request, NULL) != UMB_OK) {
        exit(1);
    }
    size_t count = request.points.count;
    struct umbw_query_reply reply = {.visibility_bytes = count};
    size_t room = umbw_query_reply_room(&reply);
    size_t needed = peer->out_size + HEAD + room + count;
    if (needed > peer->out_capacity) {
        peer->out_capacity = 2 * needed;
        peer->out = grow(peer->out, peer->out_capacity);
    }
    /* The message's gRPC prefix in the buffer is overwritten by the frame's head, whose last three
     * bytes come first. */
    uint8_t *at = peer->out + peer->out_size + HEAD - UMBW_PREFIX_BYTES;
    size_t head = umbw_write_query_reply_head(&reply, at);
    size_t message = head - UMBW_PREFIX_BYTES + count;
    uint8_t *start = peer->out + peer->out_size;
    for (unsigned i = 0; i < 4; i++) {
        start[i] = (uint8_t)(message >> (24 - 8 * i));
    }
    memcpy(start + 4, frame + 4, 4);
    if (!peer_answer(asset, request.points.positions, count, at + head)) {
        exit(1);
    }
    peer->out_size += HEAD + message;
}

static void serve(struct peer *peer, const struct umb_asset *asset)
{
    size_t used = 0;
    while (peer->in_size - used >= HEAD) {
        const uint8_t *frame = peer->in + used;
        size_t size = (size_t)frame[0] << 24 | (size_t)frame[1] << 16 | (size_t)frame[2] << 8 |
                      (size_t)frame[3];
        if (peer->in_size - used < HEAD + size) {
            break;
        }
        answer(peer, asset, frame, size);
        used += HEAD + size;
    }
    if (used > 0) {
        memmove(peer->in, peer->in + used, peer->in_size - used);
        peer->in_size -= used;
    }
}

/* Returns 0 if the peer is gone. */
static int flush(struct peer *peer)
{
    while (peer->out_at < peer->out_size) {
        ssize_t sent = write(peer->socket, peer->out + peer->out_at, peer->out_size - peer->out_at);
        if (sent < 0) {
            return errno == EAGAIN;
        }
        peer->out_at += (size_t)sent;
    }
    peer->out_at = peer->out_size = 0;
    return 1;
}

/* Returns 0 if the peer is gone. */
static int receive(struct peer *peer, const struct umb_asset *asset)
{
    if (peer->in_capacity - peer->in_size < READ_ROOM) {
        peer->in_capacity = peer->in_size + 2 * READ_ROOM;
        peer->in = grow(peer->in, peer->in_capacity);
    }
    ssize_t size = read(peer->socket, peer->in + peer->in_size, READ_ROOM);
    if (size <= 0) {
        return size < 0 && errno == EAGAIN;
    }
    peer->in_size += (size_t)size;
    serve(peer, asset);
    return flush(peer);
}

static void take(int listener, int poll)
{
    const int one = 1;
    struct peer *peer = calloc(1, sizeof *peer);
    if (peer == NULL) {
        exit(1);
    }
    peer->socket = accept(listener, NULL, NULL);
    (void)fcntl(peer->socket, F_SETFL, O_NONBLOCK);
    (void)setsockopt(peer->socket, IPPROTO_TCP, TCP_NODELAY, &one, sizeof one);
    struct epoll_event event = {.events = EPOLLIN, .data.ptr = peer};
    (void)epoll_ctl(poll, EPOLL_CTL_ADD, peer->socket, &event);
}

static void drop(struct peer *peer)
{
    (void)close(peer->socket);
    free(peer->in);
    free(peer->out);
    free(peer);
}

/* Waits until the peer, which did not take all bytes, takes more. */
static void rearm(int poll, struct peer *peer)
{
    struct epoll_event event = {.events = EPOLLIN, .data.ptr = peer};
    if (peer->out_at < peer->out_size) {
        event.events |= EPOLLOUT;
    }
    (void)epoll_ctl(poll, EPOLL_CTL_MOD, peer->socket, &event);
}

int main(int argc, char **argv)
{
    if (argc != 2) {
        return 2;
    }
    struct umb_asset *asset = peer_asset(argv[1]);
    struct epoll_event events[EVENTS];
    int listener = peer_listen();
    int poll = epoll_create1(0);
    struct epoll_event event = {.events = EPOLLIN};
    if (poll < 0 || epoll_ctl(poll, EPOLL_CTL_ADD, listener, &event) != 0) {
        return 1;
    }
    for (;;) {
        int count = epoll_wait(poll, events, EVENTS, -1);
        for (int i = 0; i < count; i++) {
            struct peer *peer = events[i].data.ptr;
            if (peer == NULL) {
                take(listener, poll);
                continue;
            }
            int waited = peer->out_at < peer->out_size;
            int alive = (events[i].events & EPOLLOUT) == 0 || flush(peer);
            if (alive && (events[i].events & (EPOLLIN | EPOLLHUP | EPOLLERR)) != 0) {
                alive = receive(peer, asset);
            }
            if (!alive) {
                drop(peer);
            } else if (waited != (peer->out_at < peer->out_size)) {
                rearm(poll, peer);
            }
        }
    }
}

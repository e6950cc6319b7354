/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_FAKE_PEER_H
#define UMBRAGE_TESTS_FAKE_PEER_H
/* The set-up of a test: a fake server and a client of it. */
#include <string.h>
#include "fake_server.h"
#include "umbrage/client.h"

struct peer {
    struct fake_server server;
    struct umb_client *client;
};

static int meet(void **state)
{
    static struct peer peer;
    char address[128];
    struct umb_error error;
    memset(&peer, 0, sizeof peer);
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

#endif

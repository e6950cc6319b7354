/* SPDX-License-Identifier: Apache-2.0 */
/* The work of a race's servers. */
#include "peer_work.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/socket.h>

struct umb_asset *peer_asset(const char *path)
{
    struct umb_asset *asset;
    struct umb_error error;
    if (umb_asset_open_file(path, NULL, &asset, &error) != UMB_OK) {
        fprintf(stderr, "peer: %s\n", error.message);
        exit(1);
    }
    return asset;
}

int peer_answer(const struct umb_asset *asset, const void *points, size_t count, uint8_t *values)
{
    const struct umb_query_settings settings = {
        .taps = 1, .bias_mode = UMB_BIAS_NONE, .format = UMB_ANSWER_U8};
    const struct umb_points batch = {.positions = points, .format = UMB_POINT_F32, .count = count};
    struct umb_answers answers = {.values = values};
    struct umb_query query;
    if (umb_query_prepare(asset, &settings, &query, NULL) != UMB_OK ||
        umb_points_check(&batch, NULL) != UMB_OK) {
        return 0;
    }
    umb_query_run(&query, &batch, 0, count, &answers);
    return 1;
}

void peer_say_port(int port)
{
    printf("%d\n", port);
    (void)fflush(stdout);
}

int peer_listen(void)
{
    struct sockaddr_in address = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    socklen_t size = sizeof address;
    int listener = socket(AF_INET, SOCK_STREAM, 0);
    if (listener < 0 || bind(listener, (struct sockaddr *)&address, size) != 0 ||
        listen(listener, 64) != 0 ||
        getsockname(listener, (struct sockaddr *)&address, &size) != 0) {
        fprintf(stderr, "peer: cannot listen\n");
        exit(1);
    }
    peer_say_port(ntohs(address.sin_port));
    return listener;
}

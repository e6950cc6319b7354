/* SPDX-License-Identifier: Apache-2.0 */
/* Cancels calls by their numbers. */
#include "rpc_client.h"

#include <stdlib.h>

#include "rpc_connection.h"
#include "rpc_stream.h"

static bool mark_list(const struct umb__call_list *list, uint64_t number)
{
    bool any = false;
    for (struct umb__call *call = list->first; call != NULL; call = call->next) {
        if (call->number == number) {
            call->cancelled = true;
            call->deadline_ns = 0;
            any = true;
        }
    }
    return any;
}

/* Finds a routed call in any of its possible lists. */
static bool mark(const struct umb_client *client, uint64_t number)
{
    bool any = mark_list(&client->resting, number);
    for (size_t i = 0; i < client->endpoint_count; i++) {
        any |= mark_list(&client->endpoints[i].waiting, number);
    }
    for (const struct umb__connection *at = client->connections; at != NULL; at = at->next) {
        any |= mark_list(&at->active, number);
    }
    for (const struct umb_client_stream *at = client->streams; at != NULL; at = at->next) {
        any |= mark_list(&at->queue, number);
        any |= mark_list(&at->sent, number);
    }
    return any;
}

bool umb__cancels_apply(struct umb_client *client, struct umb__cancel *cancels)
{
    bool any = false;
    while (cancels != NULL) {
        struct umb__cancel *first = cancels;
        cancels = first->next;
        any |= first->number != 0 && mark(client, first->number);
        free(first);
    }
    return any;
}

enum umb_status umb_client_cancel(struct umb_client *client, uint64_t call, struct umb_error *error)
{
    struct umb__cancel *cancel = malloc(sizeof *cancel);
    if (cancel == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a cancellation");
    }
    cancel->number = call;
    pthread_mutex_lock(&client->lock);
    bool closing = client->closing; /* A closing client cancels all calls anyway */
    if (!closing) {
        cancel->next = client->cancels;
        client->cancels = cancel;
        (void)uv_async_send(&client->wake);
    }
    pthread_mutex_unlock(&client->lock);
    if (closing) {
        free(cancel);
    }
    return UMB_OK;
}

/* SPDX-License-Identifier: Apache-2.0 */
/* Cancelling queries, see rpc_cancel.h. */
#include "rpc_cancel.h"

#include <stdlib.h>

#include "rpc_connection.h"
#include "rpc_stream.h"

static bool mark_list(const struct umb__call_list *list, const void *tag)
{
    bool any = false;
    for (struct umb__call *call = list->first; call != NULL; call = call->next) {
        if (call->tag == tag) {
            call->cancelled = true;
            call->deadline_ns = 0;
            any = true;
        }
    }
    return any;
}

/* Wherever a call may be once it was routed. */
static bool mark(const struct umb_client *client, const void *tag)
{
    bool any = mark_list(&client->resting, tag);
    for (size_t i = 0; i < client->endpoint_count; i++) {
        any |= mark_list(&client->endpoints[i].waiting, tag);
    }
    for (const struct umb__connection *at = client->connections; at != NULL; at = at->next) {
        any |= mark_list(&at->active, tag);
    }
    for (const struct umb_client_stream *at = client->streams; at != NULL; at = at->next) {
        any |= mark_list(&at->queue, tag);
        any |= mark_list(&at->sent, tag);
    }
    return any;
}

bool umb__cancels_apply(struct umb_client *client, struct umb__cancel *cancels)
{
    bool any = false;
    while (cancels != NULL) {
        struct umb__cancel *first = cancels;
        cancels = first->next;
        any |= first->tag != NULL && mark(client, first->tag);
        free(first);
    }
    return any;
}

enum umb_status umb_client_query_cancel(struct umb_client *client, const void *user,
                                        struct umb_error *error)
{
    struct umb__cancel *cancel = malloc(sizeof *cancel);
    if (cancel == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a cancellation");
    }
    cancel->tag = user;
    pthread_mutex_lock(&client->lock);
    bool closing = client->closing; /* then all are cancelled anyway */
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

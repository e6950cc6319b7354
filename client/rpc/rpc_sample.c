/* SPDX-License-Identifier: Apache-2.0 */
/* Shadows.Sample; see umbrage/sample.h. */
#include "umbrage/sample.h"

#include <string.h>

#include "base/reserved.h"
#include "base/try.h"
#include "base/vec.h"
#include "rpc_client.h"
#include "wire/messages.h"

/* Destination of a reply. */
struct wanted {
    uint32_t count; /* Most points that it may have */
    double *positions;
    struct umb_sample *sample;
};

static enum umb_status decode(void *out, const uint8_t *message, size_t size,
                              struct umb_error *error)
{
    const struct wanted *wanted = out;
    struct umbw_sample_reply reply;
    UMB__TRY(umbw_decode_sample_reply(message, size, &reply, error));
    if (reply.sample.count > wanted->count) {
        return umb_fail(error, UMB_E_PROTOCOL, "points_f64: %zu points, %u were asked for",
                        reply.sample.count, wanted->count);
    }
    if (reply.sample.count > 0) {
        memcpy(wanted->positions, reply.points, reply.sample.count * UMBW_SAMPLE_POINT_BYTES);
    }
    if (!umb__all_finite(wanted->positions, 3 * reply.sample.count)) {
        return umb_fail(error, UMB_E_PROTOCOL, "points_f64: not all numbers are finite");
    }
    *wanted->sample = reply.sample;
    return UMB_OK;
}

enum umb_status umb_client_sample(struct umb_client *client, const char *asset,
                                  const struct umb_sample_settings *settings, double *positions,
                                  struct umb_sample *sample, struct umb_client_async *async,
                                  struct umb_error *error)
{
    struct umbw_sample_request request = {.settings = *settings};
    struct umbw_buffer body = {NULL, 0, 0};
    struct wanted wanted = {settings->count, positions, sample};
    const struct umb__ending ending = {&wanted, sizeof wanted, decode, NULL};
    const struct umb__call_plan plan = {.asset = asset, .path = UMBW_PATH_SAMPLE, .safe = true};
    memset(sample, 0, sizeof *sample);
    if (UMB__UNKNOWN(settings, "settings", error)) {
        return UMB_E_ARGUMENT;
    }
    UMB__TRY(umb__asset_take(asset, request.asset, error));
    const enum umb_status status = umbw_encode_sample_request(&request, &body, error);
    return umb__call_run(client, plan, status, &body, &ending, async, error);
}

/* SPDX-License-Identifier: Apache-2.0 */
/* See head_room.h. */
#include "bake/head_room.h"

#include "bake/bake_transmittance.h"
#include "format/layout.h"
#include "umbrage/curve.h"

#define OCCLUDER_DEPTH_MAX_BYTES ((uint64_t)48 << 20)
#define OCCLUDER_DEPTH_ENTRY     (UMB__ENTRY_HEAD + 8U) /* its head, and the padding after it */

enum umb_status umbb_head_occluder_depth_bytes(const struct umb__content *content, int translucent,
                                               size_t *bytes, struct umb_error *error)
{
    struct umb__content whole = *content;
    struct umb_error cause = {0};
    uint64_t taken;
    whole.curve_count = content->light_count * UMB_CURVE_ROWS_MAX;
    whole.occluder_depth_words = 0;
    whole.transmittance_bytes = translucent ? UMBB_TRANSMITTANCE_BYTES_MAX : 0;
    *bytes = 0;
    const enum umb_status status = umb__content_head_bytes(&whole, &taken, &cause);
    if (status != UMB_OK || taken + OCCLUDER_DEPTH_ENTRY > UMB__CANONICAL_MAX) {
        return umb_fail(error, UMB_E_BAD_SCENE, "%u lights with %u frusta are too many: %s",
                        content->light_count, content->frustum_count,
                        status != UMB_OK ? cause.message
                                         : "they leave no room in a head of 64 MiB");
    }
    const uint64_t left = UMB__CANONICAL_MAX - OCCLUDER_DEPTH_ENTRY - taken;
    *bytes = (size_t)(left < OCCLUDER_DEPTH_MAX_BYTES ? left : OCCLUDER_DEPTH_MAX_BYTES);
    return UMB_OK;
}

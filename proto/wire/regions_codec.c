/* SPDX-License-Identifier: Apache-2.0 */
/* See regions.h. */
#include "wire/regions.h"

#include "base/try.h"
#include "umbrage/v1/regions.pb-c.h"
#include "wire/codec.h"

#define RANGE_STRIDE .stride = sizeof(struct umb_range), .most = UMBW_RANGES_MAX

/* Offsets and lengths are two arrays on the wire. */
UMBW_TABLE(RANGES, umbrage__v1__region_request, "", sizeof(struct umbw_region_request),
           {1, UMBW_AT(umbw_region_request, asset), .flags = UMBW_REQUIRED},
           {2, UMBW_AT(umbw_region_request, ranges[0].offset),
            UMBW_COUNT(umbw_region_request, count), RANGE_STRIDE},
           {3, UMBW_AT(umbw_region_request, ranges[0].length),
            UMBW_COUNT(umbw_region_request, length_count), RANGE_STRIDE});

enum umb_status umbw_decode_region_request(const uint8_t *message, size_t size,
                                           struct umbw_region_request *out, struct umb_error *error)
{
    uint64_t total = 0;
    UMB__TRY(umbw_decode(&RANGES, message, size, out, error));
    if (out->count != out->length_count) {
        return umb_fail(error, UMB_E_ARGUMENT, "offsets, lengths: %zu and %zu, must be as many",
                        out->count, out->length_count);
    }
    if (out->count == 0) {
        return umb_fail(error, UMB_E_ARGUMENT, "offsets: none, must be 1 to %d", UMBW_RANGES_MAX);
    }
    for (size_t i = 0; i < out->count; i++) {
        const uint64_t offset = out->ranges[i].offset, length = out->ranges[i].length;
        total += length;
        if (length == 0 || length > UMBW_REGION_BYTES_MAX || total > UMBW_REGION_BYTES_MAX ||
            offset > INT64_MAX - length) {
            return umb_fail(error, UMB_E_ARGUMENT,
                            "lengths[%zu]: %llu bytes from %llu, must be 1 or more and together at "
                            "most %d",
                            i, (unsigned long long)length, (unsigned long long)offset,
                            UMBW_REGION_BYTES_MAX);
        }
    }
    out->length_count = 0;
    return UMB_OK;
}

enum umb_status umbw_encode_region_request(const struct umbw_region_request *in,
                                           struct umbw_buffer *buffer, struct umb_error *error)
{
    struct umbw_region_request copy = *in;
    copy.length_count = copy.count;
    return umbw_encode(&RANGES, &copy, buffer, error);
}

UMBW_TABLE(REPLY, umbrage__v1__region_reply, "", sizeof(struct umbw_region_reply),
           {1, UMBW_AT(umbw_region_reply, asset_id), .flags = UMBW_REQUIRED},
           {2, UMBW_AT(umbw_region_reply, file_bytes)},
           {3, UMBW_AT(umbw_region_reply, data), UMBW_COUNT(umbw_region_reply, data_size)});
UMBW_CODEC(region_reply, struct umbw_region_reply, REPLY)

/* The public enums, by their numbers on the wire. */
static const int TECHNIQUES[] = {UMB_MAP_PCF, UMB_MAP_VSM, UMB_MAP_ESM, UMB_MAP_EVSM, UMB_MAP_MSM};
static const int FORMATS[] = {UMB_MAP_F32, UMB_MAP_F16, UMB_MAP_U16};

#define DERIVE(member) UMBW_AT(umbw_derive_request, member)

#define MAP_ENUM(numbers) .flags = UMBW_CHECKED | UMBW_PARTIAL | UMBW_FILLED, .values = numbers

UMBW_TABLE(VIEW, umbrage__v1__cascade_view, "view.", 0, {1, DERIVE(view.eye)},
           {2, DERIVE(view.right)}, {3, DERIVE(view.up)}, {4, DERIVE(view.forward)},
           {5, DERIVE(view.tan_x)}, {6, DERIVE(view.tan_y)}, {7, DERIVE(view.near_m)},
           {8, DERIVE(view.far_m)},
           {9, DERIVE(settings.cascades.count), .flags = UMBW_REQUIRED, .most = UMB_CASCADES_MAX},
           {10, DERIVE(settings.cascades.weight)},
           {11, DERIVE(settings.cascades.fit), .flags = UMBW_CHECKED},
           {12, DERIVE(settings.cascades.blend)});

/* A request has a view if it has cascades. mips: 1, as UMB_MAP_MIPS is. */
UMBW_TABLE(DERIVE_TABLE, umbrage__v1__derive_map_request, "", sizeof(struct umbw_derive_request),
           {1, DERIVE(asset), .flags = UMBW_REQUIRED}, {2, DERIVE(settings.light)},
           {3, DERIVE(settings.map.technique), MAP_ENUM(TECHNIQUES)},
           {4, DERIVE(settings.map.format), MAP_ENUM(FORMATS)}, {5, DERIVE(settings.width)},
           {6, DERIVE(settings.height)}, {7, DERIVE(settings.rect), .flags = UMBW_SPARSE},
           {8, UMBW_COUNT(umbw_derive_request, settings.cascades.count), .table = &VIEW,
            .most = 1024},
           {9, DERIVE(settings.map.access)}, {10, DERIVE(settings.map.blur)},
           {11, DERIVE(settings.map.exponent)}, {12, DERIVE(settings.map.negative_exponent)},
           {13, DERIVE(settings.map.depth_plane)}, {14, DERIVE(settings.map.moment_bias)},
           {15, DERIVE(settings.contrast)}, {16, DERIVE(settings.match_contrast)});
UMBW_CODEC(derive_request, struct umbw_derive_request, DERIVE_TABLE)

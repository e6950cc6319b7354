/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_WIRE_REGIONS_H
#define UMBRAGE_WIRE_REGIONS_H
/* The messages of umbrage.v1.Regions as plain structs; rules as in messages.h. */
#include "maps/map_view.h"
#include "wire/messages.h"

#define UMBW_PATH_REGIONS_STREAM "/umbrage.v1.Regions/Stream"
#define UMBW_PATH_REGIONS_FOLLOW "/umbrage.v1.Regions/Follow"
#define UMBW_PATH_REGIONS_DERIVE "/umbrage.v1.Regions/DeriveMap"
#define UMBW_RANGES_MAX          128       /* of one request */
#define UMBW_REGION_BYTES_MAX    (1 << 20) /* of one reply */

struct umbw_range {
    uint64_t offset, length;
};

struct umbw_region_request {
    char asset[UMBW_ASSET_NAME_MAX + 1];
    size_t count;                              /* 1 to UMBW_RANGES_MAX */
    struct umbw_range ranges[UMBW_RANGES_MAX]; /* together at most UMBW_REGION_BYTES_MAX */
};

struct umbw_region_reply {
    uint8_t asset_id[UMB_ID_BYTES];
    uint64_t file_bytes;
    const uint8_t *data; /* decoder: into the message */
    size_t data_size;
};

struct umbw_derive_request {
    char asset[UMBW_ASSET_NAME_MAX + 1];
    struct umb_derive_settings settings; /* camera: NULL */
    struct umb__map_view view;           /* Of cascades, if settings.cascades.count > 0 */
};

/* Enums and lengths of vectors are checked, the rest by umb_derive. Fails and trust as below. */
UMB_CHECKED enum umb_status umbw_decode_derive_request(const uint8_t *message, size_t size,
                                                       struct umbw_derive_request *request,
                                                       struct umb_error *error);
UMB_CHECKED enum umb_status umbw_encode_derive_request(const struct umbw_derive_request *request,
                                                       struct umbw_buffer *buffer,
                                                       struct umb_error *error);

/* Fails: E_ARGUMENT naming the field, E_TOO_LARGE, E_NO_MEMORY. Trust: safe on hostile bytes. */
UMB_CHECKED enum umb_status umbw_decode_region_request(const uint8_t *message, size_t size,
                                                       struct umbw_region_request *request,
                                                       struct umb_error *error);
UMB_CHECKED enum umb_status umbw_decode_region_reply(const uint8_t *message, size_t size,
                                                     struct umbw_region_reply *reply,
                                                     struct umb_error *error);

/* Append prefix and message. Fails: E_NO_MEMORY, E_TOO_LARGE. */
UMB_CHECKED enum umb_status umbw_encode_region_request(const struct umbw_region_request *request,
                                                       struct umbw_buffer *buffer,
                                                       struct umb_error *error);
UMB_CHECKED enum umb_status umbw_encode_region_reply(const struct umbw_region_reply *reply,
                                                     struct umbw_buffer *buffer,
                                                     struct umb_error *error);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_WIRE_REGIONS_H
#define UMBRAGE_WIRE_REGIONS_H
/* The messages of umbrage.v1.Regions; the rules of messages.h apply. */
#include "maps/map_view.h"
#include "umbrage/region.h"
#include "wire/messages.h"

#define UMBW_PATH_REGIONS_STREAM "/umbrage.v1.Regions/Stream"
#define UMBW_PATH_REGIONS_FOLLOW "/umbrage.v1.Regions/Follow"
#define UMBW_PATH_REGIONS_DERIVE "/umbrage.v1.Regions/DeriveMap"
#define UMBW_RANGES_MAX          128       /* Most byte ranges of one request */
#define UMBW_REGION_BYTES_MAX    (1 << 20) /* Most bytes of one reply */

struct umbw_region_request {
    char asset[UMBW_ASSET_NAME_MAX + 1];
    size_t count;                             /* 1 to UMBW_RANGES_MAX */
    size_t length_count;                      /* 0; for the codec */
    struct umb_range ranges[UMBW_RANGES_MAX]; /* together at most UMBW_REGION_BYTES_MAX */
};

struct umbw_region_reply {
    uint8_t asset_id[UMB_ID_BYTES];
    uint64_t file_bytes;
    const uint8_t *data; /* Decoder: points into the message */
    size_t data_size;
};

struct umbw_derive_request {
    char asset[UMBW_ASSET_NAME_MAX + 1];
    struct umb_derive_settings settings; /* camera: NULL */
    struct umb__map_view view;           /* View of cascades, if settings.cascades.count > 0 */
};

/* The codec checks enums, lengths of vectors and the count of cascades; umb_derive checks the rest.
 * The encoder fails with E_UNSUPPORTED if the protocol has no such technique or format. */
UMBW_MESSAGE(derive_request, struct umbw_derive_request);
UMBW_MESSAGE(region_request, struct umbw_region_request);
UMBW_MESSAGE(region_reply, struct umbw_region_reply);

#endif

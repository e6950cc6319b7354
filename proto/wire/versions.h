/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_WIRE_VERSIONS_H
#define UMBRAGE_WIRE_VERSIONS_H
/* The request of umbrage.v1.Regions/Watch, whose replies are those of regions.h; the rules of
 * messages.h apply. */
#include "wire/messages.h"

#define UMBW_PATH_REGIONS_WATCH "/umbrage.v1.Regions/Watch"

struct umbw_version_request {
    char asset[UMBW_ASSET_NAME_MAX + 1];
};

UMBW_MESSAGE(version_request, struct umbw_version_request);

#endif

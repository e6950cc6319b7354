/* SPDX-License-Identifier: Apache-2.0 */
/* See versions.h. */
#include "wire/versions.h"

#include "umbrage/v1/regions.pb-c.h"
#include "wire/codec.h"

UMBW_TABLE(REQUEST, umbrage__v1__version_request, "", sizeof(struct umbw_version_request),
           {1, UMBW_AT(umbw_version_request, asset), .flags = UMBW_REQUIRED | UMBW_CHECKED});
UMBW_CODEC(version_request, struct umbw_version_request, REQUEST)

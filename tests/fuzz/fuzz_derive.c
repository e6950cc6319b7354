/* SPDX-License-Identifier: Apache-2.0 */
/*
 * DeriveMap requests, decoded as the daemon does and run against a small asset. The core is built
 * with checks of floats in sanitizer builds: no number of a request may end in one.
 */
#include <math.h>
#include <string.h>

#include "fuzz.h"
#include "make_asset.h"
#include "umbrage/derive.h"
#include "umbrage/maps.h"
#include "wire/regions.h"

#define TEXELS_MOST 1024 /* of all maps: an execution is short */

static struct umb_asset *asset(void)
{
    static struct umb_asset *open;
    static const double origin[3] = {10, -20, 30};
    static const uint32_t log2_size = 6;
    if (open == NULL) {
        const struct voxels voxels = {random_voxel, &log2_size, log2_size, 2};
        struct bytes packed = make_packed(&voxels, 0.25, origin);
        struct umb_error error;
        FUZZ_DEMAND(umb_asset_open_bytes(packed.data, packed.size, NULL, &open, &error) == UMB_OK);
        bytes_finish(&packed);
    }
    return open;
}

/* Every number of a map that was made is finite. */
static void check(const struct umb_derived *derived)
{
    FUZZ_DEMAND(derived->count >= 1 && derived->count <= UMB_CASCADES_MAX);
    for (uint32_t i = 0; i < derived->count; i++) {
        FUZZ_DEMAND(derived->maps[i] != NULL);
        FUZZ_DEMAND(isfinite(derived->contrast[i]) && derived->contrast[i] > 0);
    }
    for (uint32_t i = 0; i + 1 <= derived->count && derived->count > 1; i++) {
        FUZZ_DEMAND(isfinite(derived->splits[i]) && derived->splits[i] < derived->splits[i + 1]);
    }
    FUZZ_DEMAND(isfinite(derived->texel_error_m));
}

static void run(const struct umb_derive_settings *settings, const struct umb__map_view *view)
{
    struct umb_derived *derived = NULL;
    struct umb_error error = {0};
    const uint8_t *file = NULL;
    size_t size = 0;
    if (umb__derive(asset(), settings, view, NULL, &derived, &error) != UMB_OK) {
        FUZZ_DEMAND(derived == NULL && error.message[0] != '\0');
        FUZZ_DEMAND(error.status != UMB_E_INTERNAL);
        return;
    }
    check(derived);
    FUZZ_DEMAND(umb_derived_ktx2(derived, &file, &size, &error) == UMB_OK);
    FUZZ_DEMAND(size > 12 && memcmp(file + 1, "KTX 20", 6) == 0);
    FUZZ_DEMAND(size <= umb_derive_bytes(settings));
    umb_derived_destroy(derived);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct umbw_derive_request request;
    struct umbw_buffer buffer = {0};
    if (umbw_decode_derive_request(data, size, &request, NULL) != UMB_OK) {
        return 0;
    }
    struct umb_derive_settings *settings = &request.settings;
    const uint64_t maps = settings->cascades.count > 0 ? settings->cascades.count : 1;
    if (settings->width <= 64 && settings->height <= 64 &&
        settings->width * (uint64_t)settings->height * maps <= TEXELS_MOST) {
        run(settings, settings->cascades.count > 0 ? &request.view : NULL);
    }
    FUZZ_DEMAND(umbw_encode_derive_request(&request, &buffer, NULL) == UMB_OK);
    umbw_buffer_finish(&buffer);
    return 0;
}

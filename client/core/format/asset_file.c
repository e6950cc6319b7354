/* SPDX-License-Identifier: Apache-2.0 */
/* Asset files as bytes: writing in either encoding, and proof; see umbrage/file.h. */
#include "umbrage/file.h"

#include <string.h>

#include "base/try.h"
#include "format/asset_parts.h"

static enum umb_status drop_bytes(void *user, const void *bytes, size_t count)
{
    (void)user;
    (void)bytes;
    (void)count;
    return UMB_OK;
}

/* Packs an asset and compares the id of the packed content with the id in the asset. */
static enum umb_status pack_again(const struct umb_asset *asset, const struct umb_sha256 *sha256,
                                  const struct umb_sink *sink, struct umb_error *error)
{
    struct umb__octree octree;
    struct umb__content content;
    uint8_t id[UMB_ID_BYTES];
    if (!sha256) {
        return umb_fail(error, UMB_E_ARGUMENT, "sha256: NULL, packing needs one");
    }
    UMB__TRY(umb__asset_export(asset, &octree, &content, error));
    enum umb_status status = umb__pack_write(&content, &octree, sha256, sink, id, error);
    umb__octree_finish(&octree);
    if (status == UMB_OK && memcmp(id, asset->id, sizeof id) != 0) {
        char made[UMB_ID_TEXT_SIZE], claimed[UMB_ID_TEXT_SIZE];
        umb_id_to_text(id, made);
        umb_id_to_text(asset->id, claimed);
        status =
            umb_fail(error, UMB_E_CORRUPT,
                     "id: the content has %s, the file claims %s: damaged or of another version",
                     made, claimed);
    }
    return status;
}

enum umb_status umb_asset_write(const struct umb_asset *asset, enum umb_encoding encoding,
                                const struct umb_sha256 *sha256, const struct umb_sink *sink,
                                struct umb_error *error)
{
    switch (encoding) {
    case UMB_ENCODING_PACKED:
        return pack_again(asset, sha256, sink, error);
    case UMB_ENCODING_MAPPED:
        return umb__mapped_write(asset, sink, error);
    }
    return umb_fail(error, UMB_E_ARGUMENT,
                    "encoding: %d is unknown, give UMB_ENCODING_PACKED or "
                    "UMB_ENCODING_MAPPED",
                    (int)encoding);
}

enum umb_status umb_asset_prove(const struct umb_asset *asset, const struct umb_sha256 *sha256,
                                struct umb_error *error)
{
    const struct umb_sink nowhere = {.write = drop_bytes, .user = NULL};
    return pack_again(asset, sha256, &nowhere, error);
}

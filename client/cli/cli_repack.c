/* SPDX-License-Identifier: Apache-2.0 */
/* See cli_repack.h. */
#include "cli_repack.h"

#include <string.h>
#include "rpc/rpc_sha256.h"

static enum umb_status drop_bytes(void *user, const void *bytes, size_t count)
{
    (void)user;
    (void)bytes;
    (void)count;
    return UMB_OK;
}

enum umb_status umbc_repack(const struct umb_asset *asset, const struct umb_sink *sink,
                            struct umb_error *error)
{
    const struct umb_sink nowhere = {.write = drop_bytes, .user = NULL};
    struct umb_octree octree;
    struct umb_content content;
    struct umb_asset_info info;
    uint8_t id[UMB_ID_BYTES];
    enum umb_status status = umb_asset_export(asset, &octree, &content, error);
    if (status != UMB_OK) {
        return status;
    }
    status =
        umb_pack_write(&content, &octree, &umb__client_sha256, sink ? sink : &nowhere, id, error);
    umb_octree_finish(&octree);
    umb_asset_get_info(asset, &info);
    if (status == UMB_OK && memcmp(id, info.id, sizeof id) != 0) {
        char made[UMB_ID_TEXT_SIZE];
        char claimed[UMB_ID_TEXT_SIZE];
        umb_id_to_text(id, made);
        umb_id_to_text(info.id, claimed);
        status =
            umb_fail(error, UMB_E_CORRUPT,
                     "id: the content has %s, the file claims %s: damaged or of another version",
                     made, claimed);
    }
    return status;
}

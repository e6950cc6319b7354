/* SPDX-License-Identifier: Apache-2.0 */
#include "example.h"
#include "umbrage/file.h"
#include "umbrage/region.h"

static enum umb_status append(void *user, const void *bytes, size_t count)
{
    return fwrite(bytes, 1, count, user) == count ? UMB_OK : UMB_E_IO;
}

static int example(const struct umb_asset *asset, FILE *file)
{
#include "file.1"
    return UMB_OK;
}

int main(void)
{
    struct umb_asset *asset = example_asset(), *mapped = NULL;
    struct umb_asset_info before, after;
    FILE *file = fopen("city.umbm", "wb");
    EXPECT(file != NULL);
    const int status = example(asset, file);
    EXPECT(fclose(file) == 0);
    if (status == UMB_OK) {
        EXPECT(umb_asset_open_file("city.umbm", NULL, &mapped, &error) == UMB_OK);
        umb_asset_get_info(asset, &before);
        umb_asset_get_info(mapped, &after);
        EXPECT(after.encoding == UMB_ENCODING_MAPPED && memcmp(before.id, after.id, 32) == 0);
    }
    umb_asset_close(mapped);
    umb_asset_close(asset);
    return example_end((enum umb_status)status);
}

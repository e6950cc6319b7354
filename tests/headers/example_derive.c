/* SPDX-License-Identifier: Apache-2.0 */
#include "example.h"
#include "umbrage/derive.h"

static int example(struct umb_asset *asset)
{
    const uint8_t *bytes;
    size_t size;
#include "derive.1"
    EXPECT(size > (size_t)4 * 1024 * 1024);
    return UMB_OK;
}

int main(void)
{
    struct umb_asset *asset = example_asset();
    const int status = example(asset);
    umb_asset_close(asset);
    return example_end((enum umb_status)status);
}

/* SPDX-License-Identifier: Apache-2.0 */
#include "example.h"
#include "umbrage/gpu.h"

static int example(struct umb_asset *asset)
{
#include "gpu.1"
    EXPECT(layout.entries > 0 && placement.info[1] == 0 && precision.across < 0.01);
    return UMB_OK;
}

int main(void)
{
    struct umb_asset *asset = example_asset();
    const int status = example(asset);
    umb_asset_close(asset);
    return example_end((enum umb_status)status);
}

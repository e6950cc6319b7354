/* SPDX-License-Identifier: Apache-2.0 */
#include "example.h"
#include "umbrage/curve.h"

static int example(struct umb_asset *asset)
{
    struct umb_query_settings settings = {0};
    struct umb_query query;
#include "curve.1"
    EXPECT(row.bound_m <= dial.max_error_m && umb_query_taps(&query) == row.taps);
    return UMB_OK;
}

int main(void)
{
    struct umb_asset *asset = example_asset();
    const int status = example(asset);
    umb_asset_close(asset);
    return example_end((enum umb_status)status);
}

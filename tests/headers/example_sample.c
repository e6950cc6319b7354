/* SPDX-License-Identifier: Apache-2.0 */
#include "example.h"
#include "umbrage/sample.h"

static int example(struct umb_asset *asset)
{
#include "sample.1"
    const struct umb_query_settings query_settings = {.bias_mode = UMB_BIAS_NONE};
    struct umb_query query;
    struct umb_answers answers = {.values = values};
    EXPECT(umb_query_prepare(asset, &query_settings, &query, &error) == UMB_OK);
    umb_query_run(&query, &points, 0, points.count, &answers);
    EXPECT(points.count == POINTS && example_lit() > POINTS / 3 && example_lit() < POINTS * 2 / 3);
    return UMB_OK;
}

int main(void)
{
    struct umb_asset *asset = example_asset();
    const int status = example(asset);
    umb_asset_close(asset);
    return example_end((enum umb_status)status);
}

/* SPDX-License-Identifier: Apache-2.0 */
#include "example.h"

static int example(struct umb_asset *asset)
{
    const struct umb_points points = example_points();
    struct umb_answers answers = {.values = values};
#include "query.1"
    EXPECT(answers.stats.points == POINTS && example_lit() > 0 && example_lit() < POINTS);
    return UMB_OK;
}

int main(void)
{
    struct umb_asset *asset = example_asset();
    const int status = example(asset);
    umb_asset_close(asset);
    return example_end((enum umb_status)status);
}

/* SPDX-License-Identifier: Apache-2.0 */
#include "example.h"
#include "umbrage/volume.h"

static int example(struct umb_asset *asset)
{
    struct umb_segment_answer shares[POINTS / 2];
    (void)example_points();
    const struct umb_segments segments = {.ends = positions, .count = POINTS / 2};
    struct umb_segment_answers answers = {.segments = shares};
    const uint32_t light = 0;
#include "volume.1"
    double lit = 0;
    for (int i = 0; i < POINTS / 2; i++) {
        lit += shares[i].lit;
    }
    EXPECT(lit > 1 && lit < POINTS / 2 - 1);
    return UMB_OK;
}

int main(void)
{
    struct umb_asset *asset = example_asset();
    const int status = example(asset);
    umb_asset_close(asset);
    return example_end((enum umb_status)status);
}

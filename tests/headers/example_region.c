/* SPDX-License-Identifier: Apache-2.0 */
#include "example.h"
#include "umbrage/region.h"

static float whole[POINTS];

static int example(void)
{
    struct umb_region_source source;
    const struct umb_points points = example_points();
    const struct umb_query_settings settings = {.taps = 9};
    const struct umb_partial_view view = {.light = UINT32_MAX};
    const struct umb_region_request request = {.views = &view, .view_count = 1};
    struct umb_partial_answers answers = {.values = values};
    EXPECT(umb_region_file_open("city.umb", &source, &error) == UMB_OK);
#include "region.1"
    umb_region_file_close(&source);
    if (status == UMB_OK) {
        example_answers(&settings, whole);
        EXPECT(answers.exact == POINTS && memcmp(whole, values, sizeof values) == 0);
    }
    return status;
}

int main(void)
{
    return example_end((enum umb_status)example());
}

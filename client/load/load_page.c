/* SPDX-License-Identifier: Apache-2.0 */
/* The result of a load test as a page: load_page.html draws the data written here. */
#include <math.h>
#include "load/load_print.h"
#include "tool/report.h"

#define CURVE_POINTS 121
#define CURVE_NINES  4.3 /* 99.995 % */

extern const unsigned char umbu_page_load_page[];
extern const size_t umbu_page_load_page_size;

/* What --json prints, with the percentiles as a curve and with the doubt. */
static void put_data(struct umbu_json *json, const void *user)
{
    const struct umbc_load_story *story = user;
    umbc_load_put(json, story);
    if (umbc_load_doubt(story) != NULL) {
        umbu_json_text(json, "doubt", umbc_load_doubt(story));
    }
    umbu_json_begin(json, "curve", '[');
    for (size_t i = 0; i < CURVE_POINTS; i++) {
        const double share = 1 - pow(10, -CURVE_NINES * (double)i / (CURVE_POINTS - 1));
        umbu_json_begin(json, NULL, '[');
        umbu_json_number(json, NULL, share);
        umbu_json_number(json, NULL,
                         1e-6 * (double)umbc_histogram_percentile(&story->result->latency, share));
        umbu_json_end(json, ']');
    }
    umbu_json_end(json, ']');
}

void umbc_load_print_page(FILE *file, const struct umbc_load_story *story)
{
    const struct umbu_report report = {
        .title = "umbrage load",
        .page = umbu_page_load_page,
        .page_size = umbu_page_load_page_size,
        .data = put_data,
        .user = story,
    };
    umbu_report_print(file, &report);
}

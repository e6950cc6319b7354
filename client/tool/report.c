/* SPDX-License-Identifier: Apache-2.0 */
/* Reports as one HTML file, see report.h. */
#include "tool/report.h"

#include <string.h>

extern const unsigned char umbu_page_report_head[];
extern const size_t umbu_page_report_head_size;

/* Prints HTML up to a mark; returns what follows it, or the end. */
static const char *put_until(FILE *to, const char *at, const char *end, const char *mark)
{
    const size_t length = strlen(mark);
    const char *found = at;
    while (found < end && ((size_t)(end - found) < length || memcmp(found, mark, length) != 0)) {
        found++;
    }
    (void)fwrite(at, 1, (size_t)(found - at), to);
    return found < end ? found + length : end;
}

void umbu_report_print(FILE *to, const struct umbu_report *report)
{
    struct umbu_json json = {.file = to, .in_html = true};
    const char *at = (const char *)umbu_page_report_head;
    const char *end = at + umbu_page_report_head_size;
    at = put_until(to, at, end, "@TITLE@");
    (void)fputs(report->title, to);
    at = put_until(to, at, end, "@DATA@");
    umbu_json_begin(&json, NULL, '{');
    report->data(&json, report->user);
    umbu_json_close(&json);
    (void)fwrite(at, 1, (size_t)(end - at), to);
    at = (const char *)report->page;
    end = at + report->page_size;
    if (report->pictures != NULL) {
        at = put_until(to, at, end, "@PICTURES@");
        report->pictures(to, report->user);
    }
    (void)fwrite(at, 1, (size_t)(end - at), to);
}

/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TOOL_REPORT_H
#define UMBRAGE_TOOL_REPORT_H
/*
 * Reports as one HTML file that needs no network: a common head (report_head.html: style, charts,
 * tables), the data as JSON, and a page that draws from it.
 *
 * The Makefile turns NAME.html into the byte array umbu_page_NAME.
 */
#include <stddef.h>
#include <stdio.h>
#include "tool/json.h"

struct umbu_report {
    const char *title;         /* Plain text without '<' and '&'. */
    const unsigned char *page; /* [page_size] HTML behind the head, to the end of the file. */
    size_t page_size;
    void (*data)(struct umbu_json *json, const void *user); /* Writes the data's members. */
    void (*pictures)(FILE *to, const void *user); /* Writes what stands for @PICTURES@, or NULL. */
    const void *user;
};

/* Prints a report. A failed write shows in ferror(to). */
void umbu_report_print(FILE *to, const struct umbu_report *report);

#endif

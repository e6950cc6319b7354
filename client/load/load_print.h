/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_LOAD_LOAD_PRINT_H
#define UMBRAGE_LOAD_LOAD_PRINT_H
/* What a load test found, for people, for programs and as a page. */
#include <stdio.h>
#include "load/load_options.h"
#include "load/load_sweep.h"
#include "tool/json.h"

/* One finished load test. */
struct umbc_load_story {
    const struct umbc_load_options *options;
    const struct umb_client_description *about;
    const struct umbc_load_result *result; /* of the run, or at the knee */
    const struct umbc_load_sweep *sweep;   /* or NULL */
};

/* Percentiles that are told. */
#define UMBC_LOAD_SHARES 7
extern const double UMBC_LOAD_SHARE[UMBC_LOAD_SHARES];           /* 0.5 ... 0.9999, 1 */
extern const char *const UMBC_LOAD_SHARE_NAME[UMBC_LOAD_SHARES]; /* "p50" ... "max" */

double umbc_load_ms(const struct umbc_load_result *result, size_t share);

/* "camera", "random", ... or the trace's name. */
const char *umbc_load_kind_name(const struct umbc_load_source *source);

void umbc_load_print_text(FILE *file, const struct umbc_load_story *story);
void umbc_load_print_json(FILE *file, const struct umbc_load_story *story);

/* Writes the members of the JSON object. */
void umbc_load_put(struct umbu_json *json, const struct umbc_load_story *story);

/* Prints an HTML page (tool/report.h). */
void umbc_load_print_page(FILE *file, const struct umbc_load_story *story);

/* Why a result says little, or NULL. */
const char *umbc_load_doubt(const struct umbc_load_story *story);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_STUDY_REPORT_H
#define UMBRAGE_SERVER_STUDY_STUDY_REPORT_H
/* Shared parts of the files of a study's report. */
#include <stdio.h>
#include "study/study.h"
#include "tool/json.h"

/* The whole study as one JSON object. A failed write shows in ferror(to). */
void umbt_study_json(FILE *to, const struct umbt_study *study);

/* Writes the members of that object. */
void umbt_study_put(struct umbu_json *json, const struct umbt_study *study);

/* The study as a self-contained page: numbers, charts, pictures. */
void umbt_study_page(FILE *to, const struct umbt_study *study);

#endif

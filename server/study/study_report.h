/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_STUDY_REPORT_H
#define UMBRAGE_SERVER_STUDY_STUDY_REPORT_H
/* Shared parts of the files of a study's report. */
#include <stdio.h>
#include "study/study.h"

/* The whole study as one JSON object. A failed write shows in ferror(to). */
void umbt_study_json(FILE *to, const struct umbt_study *study);

/* The study as a self-contained page: numbers, charts, pictures. */
void umbt_study_page(FILE *to, const struct umbt_study *study);

/* Replaces FOLDER/name as a whole. Fails: E_ARGUMENT, E_CANNOT_CREATE, E_IO. */
UMB_CHECKED enum umb_status umbt_study_write(const struct umbt_study *study, const char *name,
                                             const void *bytes, size_t size,
                                             struct umb_error *error);

#endif

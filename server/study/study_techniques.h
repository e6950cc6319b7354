/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_STUDY_TECHNIQUES_H
#define UMBRAGE_SERVER_STUDY_STUDY_TECHNIQUES_H
/*
 * The shadow maps of the literature in the study: every row of `umbrage-study techniques`, and the
 * voxel DAG, on the points that one camera sees. Each is compared with traced rays over its own
 * filter.
 */
#include <stdio.h>
#include "study/study.h"

/* Measures all techniques. Fails: E_NO_MEMORY, E_ARGUMENT (the camera sees nothing). */
UMB_CHECKED enum umb_status umbt_study_techniques(struct umbt_study *study,
                                                  struct umb_error *error);

/* Prints the techniques as a JSON object. */
void umbt_study_techniques_json(FILE *to, const struct umbt_study *study);

#endif

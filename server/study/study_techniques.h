/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_STUDY_TECHNIQUES_H
#define UMBRAGE_SERVER_STUDY_STUDY_TECHNIQUES_H
/*
 * The shadow maps of the literature in the study: every row of `umbrage-study techniques`, and the
 * voxel DAG, on the points that one camera sees. Each is compared with traced rays over its own
 * filter.
 */
#include "study/study.h"
#include "tool/json.h"

/* Measures all techniques. Fails: E_NO_MEMORY, E_ARGUMENT (the camera sees nothing). */
UMB_CHECKED enum umb_status umbt_study_techniques(struct umbt_study *study,
                                                  struct umb_error *error);

/* Writes them as members of the open JSON object. */
void umbt_study_techniques_json(struct umbu_json *json, const struct umbt_study *study);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_STUDY_ERRORS_H
#define UMBRAGE_SERVER_STUDY_STUDY_ERRORS_H
/*
 * Errors of one setting's answers (study.h). Sums run in the order of the samples, so a report's
 * errors can be reproduced exactly. Pure functions.
 */
#include "study/study.h"

/* Answers with their truths; borrowed, arrays of `count`. */
struct umbt_judged {
    size_t count; /* surface samples */
    const float *answers;
    const float *area;  /* the area truth */
    const uint8_t *lit; /* the hard truth */
    /* Distance in metres from the sample to a change of truth; infinite: none within reach. */
    const float *boundary_m;
    const uint8_t *undefined; /* 1: left out, but counted */
};

/* Errors against the area truth. Out: judged, undefined, rms, worst, over_*; counts are added
 * to. */
void umbt_errors_area(const struct umbt_judged *judged, struct umbt_study_result *result);

/*
 * Errors against the hard truth. An answer above one half means lit, one below it shadowed. Exactly
 * one half means neither: a coarse cell contains a boundary. Such an answer is neither false light
 * nor false shadow. The sample's distance from the boundary counts as the answer's error.
 *
 * In:  result->judged, by umbt_errors_area. wrong: scratch, float[count].
 * Out: false_light, false_shadow, undecided, off_*.
 */
void umbt_errors_edges(const struct umbt_judged *judged, float *wrong,
                       struct umbt_study_result *result);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_STUDY_ERRORS_H
#define UMBRAGE_SERVER_STUDY_STUDY_ERRORS_H
/*
 * How wrong the answers of one setting are (study.h). Sums run in the order of the samples, so that
 * a report's errors can be reproduced exactly. Pure.
 */
#include "study/study.h"

/* What answers are judged by; borrowed, arrays of `count`. */
struct umbt_judged {
    size_t count; /* surface samples */
    const float *answers;
    const float *area;        /* the area truth */
    const uint8_t *lit;       /* the hard truth */
    const float *boundary_m;  /* from the sample to where it changes; infinite: out of reach */
    const uint8_t *undefined; /* 1: left out, but counted */
};

/* Against the area truth. Out: judged, undefined, rms, worst, over_*; counts are added to. */
void umbt_errors_area(const struct umbt_judged *judged, struct umbt_study_result *result);

/*
 * Against the hard truth. An answer above one half says lit, one below it shadowed. One half
 * exactly says neither: a coarse cell with a boundary somewhere in it. Such an answer is neither
 * false light nor false shadow, but it knows the boundary no better than to the sample's distance
 * from it, and counts as wrong by that.
 *
 * In:  result->judged, by umbt_errors_area. wrong: scratch, float[count].
 * Out: false_light, false_shadow, undecided, off_*.
 */
void umbt_errors_edges(const struct umbt_judged *judged, float *wrong,
                       struct umbt_study_result *result);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_STUDY_TRUTH_H
#define UMBRAGE_SERVER_STUDY_STUDY_TRUTH_H
/*
 * The traced truth of each footprint in a study, traced once: settings with the same frustum and
 * filter share it, for assets and peers alike.
 */
#include "study/study_probe.h"

struct umbt_study_truth {
    struct umbt_truth rays; /* parameters of the rays; `closed` does not matter */
    float *values;          /* [surface samples] */
    double error;           /* estimated RMS error, against twice the rays a side */
};

struct umbt_study_truths {
    uint32_t count;
    struct umbt_study_truth list[UMBT_STUDY_SETTINGS_MAX];
};

/* The truth of a probe's footprint, traced on first use. Fails: E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbt_truths_get(struct umbt_study_truths *truths,
                                            const struct umbt_probe *probe,
                                            const struct umbt_study_truth **truth,
                                            struct umb_error *error);
void umbt_truths_finish(struct umbt_study_truths *truths);

#endif

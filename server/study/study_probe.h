/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_STUDY_PROBE_H
#define UMBRAGE_SERVER_STUDY_STUDY_PROBE_H
/* Probes: settings of a study that are ready to query. study_measure.c judges them, study_times.c
 * times them. */
#include "study/traced_shadow.h"
#include "study/study.h"
#include "study/study_peers.h"

/* One setting, prepared. */
struct umbt_probe {
    struct umbt_study *study;
    struct umbt_study_result *result;
    const struct umbt_study_bake *bake;
    struct umbt_truth truth;
    /* An asset uses query; a peer uses the others that it needs. */
    struct umb_query query;
    const struct umbt_peers *peers;
    const struct umbt_peer *peer;
    float *moved; /* owned */
    struct umbt_map16_query map;
    struct umbt_nanovdb_query volume;
    struct umb_map_query derived;
};

/* All samples of the study as points of a query; borrowed. */
struct umb_points umbt_study_points_all(const struct umbt_study *study);

/*
 * Queries samples first .. first + count - 1 with a setting.
 *
 * Out: values: float[count]; for a peer only the answers of facing samples, one after the other
 *      (umbt_probe_answer puts them in their places).
 * Threads: any.
 */
void umbt_probe_query(const struct umbt_probe *probe, size_t first, size_t count, float *values);

/* Works like umbt_probe_query, but answers every sample. values[0] is the answer of sample
 * `first`. */
void umbt_probe_answer(const struct umbt_probe *probe, size_t first, size_t count, float *values);

/* Prepares a setting for queries. Fails: E_NO_MEMORY, and the errors of umb_query_prepare. */
UMB_CHECKED enum umb_status umbt_probe_prepare(struct umbt_probe *probe, struct umb_error *error);
void umbt_probe_finish(struct umbt_probe *probe);

/* A sample's unit normal; zero for free points. */
void umbt_study_normal(const struct umbt_study_points *points, size_t i, double normal[3]);

/* Measures the times of all results and of the rays. probes: [result_count], prepared. Fails:
 * E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbt_study_times(struct umbt_study *study, struct umbt_probe *probes,
                                             struct umb_error *error);

#endif

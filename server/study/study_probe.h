/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_STUDY_PROBE_H
#define UMBRAGE_SERVER_STUDY_STUDY_PROBE_H
/* Probes: settings of a study that are ready to query. study_measure.c judges them, study_times.c
 * times them. */
#include "study/nanovdb_peer.h"
#include "study/shadow_map16.h"
#include "study/study.h"
#include "study/traced_shadow.h"
#include "umbrage/derive.h"

/*
 * Peers that answer the samples of a study, made from its open assets, so that resolution and
 * frustum are the same. They are a plain 16-bit shadow map with percentage closer filtering
 * (shadow_map16.h), a NanoVDB mask grid of the voxels (nanovdb_peer.h, if the build has it), and
 * the maps that `umbrage derive` makes for GPUs.
 *
 * The map and the grid get an advantage: samples that face away are not part of their time, and the
 * others are moved off their surface and converted to floats before. An asset's time includes all
 * these steps. All peers know parallel light only: under a lamp there are none.
 */
#define UMBT_PEERS_MAX         32
#define UMBT_PEER_DERIVED_TAPS 9 /* filter width of derived maps */

/* One peer of one bake. */
struct umbt_peer {
    struct umbt_study_result setting; /* method, name, bake, bytes, build_s of its results */
    enum umbt_map16_way way;          /* DEPTH_MAP */
    struct umbt_map16 map;            /* DEPTH_MAP */
    struct umbt_nanovdb *volume;      /* NANOVDB */
    struct umb_derived *derived;      /* DERIVED */
};

struct umbt_peers {
    uint32_t count;
    struct umbt_peer list[UMBT_PEERS_MAX];
    /* Samples that face the light or have no normal, in order. */
    size_t facing_count;
    uint32_t *rank;         /* [points + 1]: facing samples before each */
    double (*positions)[3]; /* [facing_count] */
    float (*normals)[3];    /* [facing_count] */
};

/*
 * Makes the peers at all resolutions that each of them supports. study->missing names the other
 * peers and the reason. Fails: E_NO_MEMORY, and the errors of umb_derive.
 */
UMB_CHECKED enum umb_status umbt_peers_make(struct umbt_study *study, struct umbt_peers *peers,
                                            struct umb_error *error);
void umbt_peers_finish(struct umbt_peers *peers);

/* The area truth of a setting: what its filter estimates, by rays. */
struct umbt_study_truth {
    struct umbt_truth rays;
    enum umbt_study_method method; /* TENT, FOOTPRINT; others: that of `rays` alone */
    double footprint_m;            /* FOOTPRINT: side of the square of surface */
};

/* Returns the share of the filter's footprint that sees the light. Threads: any. */
float umbt_study_truth_visibility(const struct umbt_study_truth *truth, const double point[3],
                                  const double normal[3]);

/* Returns 1 if the footprint reaches into a closed solid, where answers are unspecified. */
int umbt_study_truth_is_undefined(const struct umbt_study_truth *truth, const double point[3],
                                  const double normal[3]);

/* Returns 1 if two truths of one study are equal at every point. */
int umbt_study_truth_is_same(const struct umbt_study_truth *a, const struct umbt_study_truth *b);

/* One setting, prepared. */
struct umbt_probe {
    struct umbt_study *study;
    struct umbt_study_result *result;
    const struct umbt_study_bake *bake;
    struct umbt_study_truth truth;
    /* An asset uses query; a peer uses the others that it needs. */
    struct umb_query query;
    const struct umbt_peers *peers;
    const struct umbt_peer *peer;
    float *moved; /* owned */
    struct umbt_map16_query map;
    struct umbt_nanovdb_query volume;
    struct umb_map_query derived;
};

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

/* Names of the methods. */
extern const char *const umbt_study_method_names[UMBT_STUDY_METHODS];

/* Returns the query's settings of a method of an asset. */
struct umb_query_settings umbt_study_settings(const struct umbt_study *study,
                                              const struct umbt_study_result *result);

/* Computes two unit vectors that span the plane perpendicular to a unit normal. */
void umbt_study_tangents(const double normal[3], double u[3], double v[3]);

/* A sample's unit normal; zero for free points. */
void umbt_study_normal(const struct umbt_study_points *points, size_t i, double normal[3]);

/* Measures the times of all results and of the rays. probes: [result_count], prepared. Fails:
 * E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbt_study_times(struct umbt_study *study, struct umbt_probe *probes,
                                             struct umb_error *error);

/*
 * Opens a counter of the instructions that the calling thread executes in user space, kept by the
 * processor (perf_event_open). Equal work takes equal counts, however busy the machine is. Virtual
 * machines and containers often have no counter or do not allow it.
 *
 * Returns a descriptor for close(); -1: `reason` says why there is none.
 */
int umbt_instructions_open(char *reason, size_t size);

/* Returns the count since the counter was opened; 0 for -1. */
uint64_t umbt_instructions_read(int counter);

/* ---- errors; sums run in the order of the samples, so that they can be reproduced ---- */

/* Answers with their truths; borrowed, arrays of `count`. */
struct umbt_judged {
    size_t count;   /* surface samples */
    size_t border;  /* number of the first sample near a boundary; those before are the view's */
    double reach_m; /* distance that counts where no boundary is found */
    const float *answers;
    const float *area;  /* the area truth */
    const float *sharp; /* the hard truth */
    /* Distance in metres from the sample to a change of truth; infinite: none within reach. */
    const float *boundary_m;
    const uint8_t *undefined; /* 1: left out, but counted */
};

/* Errors against the area truth. Out: judged, undefined, rms, worst, over_*; counts are added
 * to. */
void umbt_errors_area(const struct umbt_judged *judged, struct umbt_study_result *result);

/*
 * Errors against the hard truth. An answer that is half or more away from it is wrong. An answer of
 * exactly one half takes no side, because a coarse cell contains a boundary: it is wrong, but
 * neither false light nor false shadow. The sample's distance from the boundary counts as the error
 * of a wrong answer; a right answer's error is 0.
 *
 * In:  off: scratch, float[count].
 * Out: wrong, wrong_*, false_light, false_shadow, undecided, off_*.
 */
void umbt_errors_edges(const struct umbt_judged *judged, float *off,
                       struct umbt_study_result *result);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_STUDY_H
#define UMBRAGE_SERVER_STUDY_STUDY_H
/*
 * The study: what accuracy costs in time and bytes, for one scene and one light.
 *
 *     bake      bakes the scene at each resolution, open and closed     (study_resolutions.c)
 *     points    draws samples and traces the truth at them              (study_points.c)
 *     measure   queries every setting at the same points, interleaved   (study_measure.c)
 *     report    report.json, report.csv, report.html, the summary       (study_report.c,
 *                                                                       study_page.c)
 *
 * Data flows in that order; each step reads only the results of earlier ones.
 *
 * Two truths. *Hard*: one ray from the sample, lit or not; a user of the shadow wants this. *Area*:
 * the share of the filter's own footprint at the sample's depth that sees the light, from
 * truth_side^2 rays; an n-tap answer estimates this. The first gives errors in metres (distance of
 * the boundary where the answer is wrong), the second in visibility.
 */
#include "study/camera.h"
#include "study/study_scene.h"
#include "umbrage/query.h"

#define UMBT_STUDY_BAKES_MAX      24
#define UMBT_STUDY_SETTINGS_MAX   320
#define UMBT_STUDY_RUNS           7 /* timed runs, interleaved; the median counts */
#define UMBT_STUDY_SPREAD_MAX     0.15
#define UMBT_STUDY_NAME           32
#define UMBT_STUDY_TECHNIQUES_MAX 64

struct umbt_study_options {
    const char *scene, *folder, *light, *sun, *up;
    char named[288];         /* name of `folder` if none was given */
    uint64_t max_resolution; /* the highest one */
    uint64_t points;         /* points of a set */
    uint64_t threads, seed;
    uint64_t truth_side; /* rays a side of the area truth */
    int quick, json, quiet;
};

/* The asset of one resolution, open or closed. */
struct umbt_study_bake {
    char name[UMBT_STUDY_NAME]; /* "4096-closed" */
    uint32_t resolution;
    int closed;           /* 1: wanted closed; the result is in frustum.closed */
    char reason[256];     /* reason why there is no asset, or empty */
    double wall_s, cpu_s; /* time of the whole umbrage-bake, without its self-check */
    uint64_t packed_bytes;
    struct umb_asset *asset;
    struct umb_asset_info info;
    struct umb_light_info light;
    struct umb_frustum_info frustum;
    double voxel_m; /* mean edge of a voxel across the light */
};

/* Kind of samples. */
enum umbt_study_set {
    UMBT_STUDY_VIEW = 0, /* points seen by three cameras, in scan order: coherent */
    UMBT_STUDY_BORDER,   /* surface points close to a true shadow boundary */
    UMBT_STUDY_FREE,     /* anywhere in the scene's box: incoherent */
    UMBT_STUDY_SET_COUNT,
};
extern const char *const umbt_study_set_names[UMBT_STUDY_SET_COUNT];

struct umbt_study_points {
    size_t count;
    size_t first[UMBT_STUDY_SET_COUNT + 1]; /* set s is first[s] .. first[s + 1] - 1 */
    double (*positions)[3];
    float (*normals)[3]; /* zero for free points */
    uint8_t *lit;        /* hard truth */
    /* Distance along the surface to a change of the hard truth; infinite beyond reach_m, and for
     * free points. */
    float *boundary_m;
    double reach_m;
    double to_light[3];
};

/* Source of answers: an asset, or one of the peers of study_peers.h. */
enum umbt_study_method {
    UMBT_STUDY_DAG = 0,
    UMBT_STUDY_PENUMBRA,  /* the asset's UMB_FILTER_PENUMBRA, against the light's disc */
    UMBT_STUDY_DEPTH_MAP, /* the peers */
    UMBT_STUDY_NANOVDB,
    UMBT_STUDY_DERIVED,
};

/* Accuracy of one setting on all sets together, and its times. */
struct umbt_study_result {
    enum umbt_study_method method;
    const char *name;     /* name of the method: "dag", "penumbra", "depth map", ... */
    uint32_t bake;        /* index */
    uint32_t taps, level; /* as in struct umb_query_settings */
    uint64_t bytes;       /* resident */
    double build_s;       /* DERIVED: CPU time besides the bake's */
    /* Samples judged; samples left out because their window reaches into a solid. */
    uint64_t judged, undefined;
    double rms, worst; /* against the area truth */
    double over_001, over_01, over_05;
    double false_light, false_shadow;       /* shares: wrong side of 0.5 against the hard truth */
    double undecided;                       /* share: 0.5, neither side (coarse levels) */
    double off_p50_m, off_p95_m, off_max_m; /* distance to the true boundary where wrong */
    double off_unknown;      /* share of the wrong ones with no boundary within reach */
    double truth_error;      /* error of the area truth itself, estimated, RMS */
    double ns_view, ns_free; /* a point, one thread, CPU time, median */
    double ns_view_all;      /* a point, all threads, wall time, median */
    /* (largest - least) / median of the runs of each time, without the outermost run on each side.
     * A time with a spread above UMBT_STUDY_SPREAD_MAX is not reported. */
    double spread, spread_free, spread_all;
    double nodes, bricks; /* nodes and bricks read a point, in the view; of assets */
    /* From the asset's own curve: greatest distance of an answer from the truth, in space; cache
     * lines read a point of its sample. NaN: no value. */
    double bound_m, lines;
};

/* Times of rays, on the same points. */
struct umbt_study_rays {
    double ns_view, ns_free;  /* one ray a point */
    double ns_view8;          /* one ray a point, eight points a call */
    double ns_area, ns_area8; /* 81 rays a point, view: one a call, eight a call */
    double spread;            /* spread of ns_view */
    int64_t stopped;          /* rays that hit a triangle, in all runs */
};

/* A shadow map of the literature, or an asset's DAG, on one view (study_techniques.c). */
struct umbt_study_technique {
    char name[UMBT_STUDY_NAME];
    const char *truth; /* truth that its filter is compared with: box, point, disc */
    int is_dag;
    uint64_t bytes;                          /* in memory */
    double build_s, ns, spread;              /* CPU time; a point, on one thread */
    double mean, lighter, darker, over_half; /* as in struct umbt_technique_result */
};

struct umbt_study {
    struct umbt_study_options options;
    struct umbt_scene scene;
    struct umbt_study_bake bakes[UMBT_STUDY_BAKES_MAX];
    uint32_t bake_count;
    struct umbt_study_points points;
    struct umbt_study_result results[UMBT_STUDY_SETTINGS_MAX];
    uint32_t result_count;
    struct umbt_study_rays rays;
    const char *missing; /* peers that could not be measured, in a sentence, or "" */
    struct umbt_study_technique techniques[UMBT_STUDY_TECHNIQUES_MAX];
    uint32_t technique_count, technique_resolution;
    size_t technique_points;
    double started_s, seconds; /* times of the whole study, set before the report */
};

/* Bakes each resolution into FOLDER/assets, or reuses an earlier run's asset. A resolution that
 * does not fit in memory is the last, and its reason says so. Fails: E_UNAVAILABLE,
 * E_CANNOT_CREATE, or as the bake of the lowest resolution. */
UMB_CHECKED enum umb_status umbt_study_bake_all(struct umbt_study *study, struct umb_error *error);
void umbt_study_bakes_finish(struct umbt_study *study);

/* Draws the samples and traces their hard truth. Fails: E_NO_MEMORY, E_BAD_SCENE. */
UMB_CHECKED enum umb_status umbt_study_points_make(struct umbt_study *study,
                                                   struct umb_error *error);
void umbt_study_points_finish(struct umbt_study_points *points);

/* Measures every setting. Fails: E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbt_study_measure(struct umbt_study *study, struct umb_error *error);

/* Writes FOLDER/report.json, report.csv and report.html, each as a whole. Fails: E_CANNOT_CREATE,
 * E_IO, E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbt_study_report(const struct umbt_study *study,
                                              struct umb_error *error);

/* Writes in words which setting to take for which error: at most size bytes with the NUL. */
void umbt_study_summary(const struct umbt_study *study, char *text, size_t size);

#endif

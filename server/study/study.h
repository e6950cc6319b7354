/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_STUDY_H
#define UMBRAGE_SERVER_STUDY_STUDY_H
/*
 * The study: what accuracy costs in time and bytes, for one scene and one light.
 *
 *     bake        bakes the scene at each resolution, open and closed    study_resolutions.c
 *     points      draws samples and traces the truth at them             study_points.c
 *     measure     queries every setting at the same points, interleaved  study_measure.c
 *     pictures    one view by each resolution                            study_views.c
 *     techniques  the shadow maps of the literature on one view          study_views.c
 *     report      report.json, report.csv, report.html                   study_report.c
 *
 * Data flows in that order; each step reads only the results of earlier ones.
 *
 * The study has two truths. The *hard* truth is one ray from the sample, lit or not: what the user
 * of a shadow wants. It gives errors in metres: the distance to the shadow boundary where an answer
 * is wrong. The *area* truth is the share of the filter's own footprint, at the sample's depth,
 * that sees the light, by truth_side^2 rays: what an n-tap answer estimates. It gives errors in
 * visibility.
 */
#include "study/study_math.h"
#include "study/techniques.h"
#include "umbrage/query.h"

#define UMBT_STUDY_BAKES_MAX      24
#define UMBT_STUDY_SETTINGS_MAX   320
#define UMBT_STUDY_RUNS           7 /* timed runs, interleaved; the median counts */
#define UMBT_STUDY_NAME           32
#define UMBT_STUDY_PATH           4096
#define UMBT_STUDY_TECHNIQUES_MAX 64
#define UMBT_STUDY_TAPS           9 /* width of the filter of the techniques */

struct umbt_study_options {
    const char *light, *sun, *up;
    char named[288];         /* Default folder of the report */
    uint64_t max_resolution; /* Highest resolution, voxels a side */
    uint64_t points;         /* Number of samples of a set */
    uint64_t truth_side;     /* Rays a side of the area truth */
    int quick;
};

/* The asset of one resolution, open or closed. */
struct umbt_study_bake {
    char name[UMBT_STUDY_NAME]; /* "4096-closed" */
    uint32_t resolution;
    int closed;           /* 1: bake with closed solids; frustum.closed has the result */
    char reason[256];     /* reason why there is no asset, or empty */
    double wall_s, cpu_s; /* times of umbrage-bake without its self-check */
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
    double (*positions)[3];                 /* [count] world space, metres */
    float (*normals)[3];                    /* [count] zero for free points */
    uint8_t *lit;                           /* [count] the hard truth */
    /* [count] Distance in metres along the surface to a change of the hard truth; infinite beyond
     * reach_m, and for free points. */
    float *boundary_m;
    double reach_m;
    double to_light[3];
};

/* Source of answers: an asset, or one of the peers of study_probe.h. */
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
    uint32_t taps, level; /* settings of the query, as in struct umb_query_settings */
    uint64_t bytes;       /* size in memory */
    double build_s;       /* DERIVED: CPU time after the bake */
    /* Number of samples judged; number left out because their window reaches into a solid. */
    uint64_t judged, undefined;
    double rms, worst;                 /* errors of visibility against the area truth */
    double over_001, over_01, over_05; /* shares of samples with an error above 0.01, 0.1, 0.5 */
    double false_light, false_shadow;  /* shares of samples on the wrong side of the hard truth */
    double undecided;                  /* share of answers of exactly 0.5 (coarse levels) */
    /* Distance from a wrong answer to the true boundary: median, 95th percentile, largest. */
    double off_p50_m, off_p95_m, off_max_m;
    double off_unknown;          /* share of the wrong answers with no boundary within reach */
    double truth_error;          /* estimated RMS error of the area truth itself */
    struct umbt_time view, free; /* CPU time of a point on one thread */
    struct umbt_time all;        /* wall time of a point of the view on all threads */
    double nodes, bricks;        /* nodes and bricks of an asset that a point of the view reads */
    /* Greatest distance in metres of an answer from the truth, and cache lines that a point reads,
     * both from the asset's own curve. NaN: no value. */
    double bound_m, lines;
};

/* Ways to trace rays at the same points. */
enum umbt_study_rays {
    UMBT_RAYS_VIEW, /* one ray a point; its spread decides which attempt counts */
    UMBT_RAYS_FREE,
    UMBT_RAYS_VIEW8, /* eight rays a call */
    UMBT_RAYS_AREA,  /* 81 rays a point: one a call, eight a call */
    UMBT_RAYS_AREA8,
    UMBT_RAYS_WAYS,
};

/* A shadow map of the literature, or an asset's DAG, on one view (study_views.c). */
struct umbt_study_technique {
    char name[UMBT_STUDY_NAME];
    enum umbt_technique_truth truth;
    int is_dag;
    struct umbt_technique_result result;
};

struct umbt_study {
    struct umbt_common common; /* output: FOLDER */
    struct umbt_study_options options;
    struct umbt_study_bake bakes[UMBT_STUDY_BAKES_MAX];
    uint32_t bake_count;
    struct umbt_study_points points;
    struct umbt_study_result results[UMBT_STUDY_SETTINGS_MAX];
    uint32_t result_count;
    struct umbt_time rays[UMBT_RAYS_WAYS]; /* Time of a ray; with AREA and AREA8, of a point */
    int64_t stopped;                       /* number of rays that hit a triangle, in all runs */
    int z_up;
    const char *missing; /* sentence about peers that could not be measured, or "" */
    struct umbt_study_technique techniques[UMBT_STUDY_TECHNIQUES_MAX];
    uint32_t technique_count, technique_resolution;
    size_t technique_points;
    double seconds; /* length of the study, set before the report */
};

/* Path of a file beneath FOLDER. Fails: E_ARGUMENT (too long). */
UMB_CHECKED enum umb_status umbt_study_path(const struct umbt_study *study, const char *name,
                                            char path[UMBT_STUDY_PATH], struct umb_error *error);

/* Makes a folder beneath FOLDER, or FOLDER for "", unless it exists. Fails: E_ARGUMENT,
 * E_CANNOT_CREATE. */
UMB_CHECKED enum umb_status umbt_study_folder(const struct umbt_study *study, const char *name,
                                              struct umb_error *error);

/* Bakes each resolution into FOLDER/assets, or reuses an earlier run's asset. A resolution that
 * does not fit in memory is the last, and its reason says so. Fails: E_UNAVAILABLE,
 * E_CANNOT_CREATE, or the failure of the bake of the lowest resolution. */
UMB_CHECKED enum umb_status umbt_study_bake_all(struct umbt_study *study, struct umb_error *error);
void umbt_study_bakes_finish(struct umbt_study *study);

/* Draws the samples and traces their hard truth. Fails: E_NO_MEMORY, E_BAD_SCENE. */
UMB_CHECKED enum umb_status umbt_study_points_make(struct umbt_study *study,
                                                   struct umb_error *error);
void umbt_study_points_finish(struct umbt_study_points *points);

/* Measures every setting. Fails: E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbt_study_measure(struct umbt_study *study, struct umb_error *error);

/* Draws all pictures, and pictures/traced.png. Fails: E_CANNOT_CREATE, E_IO, E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbt_study_pictures(struct umbt_study *study, struct umb_error *error);

/* 1 if a result gets pictures: 1 and 9 taps. */
int umbt_study_has_picture(const struct umbt_study_result *result);

/* Writes a file name beneath FOLDER: "pictures/4096-closed-9.png", or "...-difference.png". */
void umbt_study_picture_name(const struct umbt_study *study, const struct umbt_study_result *result,
                             int difference, char *name, size_t size);

/* Measures the techniques of techniques.h on one view. Fails: E_NO_MEMORY, E_ARGUMENT (the
 * camera sees nothing). */
UMB_CHECKED enum umb_status umbt_study_techniques(struct umbt_study *study,
                                                  struct umb_error *error);

/* Writes FOLDER/report.json, report.csv and report.html, each as a whole. Fails: E_CANNOT_CREATE,
 * E_IO, E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbt_study_report(const struct umbt_study *study,
                                              struct umb_error *error);

/* Writes the members of report.json; user: the struct umbt_study. A failure shows in ferror. */
void umbt_study_json(struct umbu_json *json, const void *user);

/* Writes in words which setting to take for which error: at most size bytes with the NUL. */
void umbt_study_summary(const struct umbt_study *study, char *text, size_t size);

#endif

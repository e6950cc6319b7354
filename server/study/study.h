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
 *     techniques  the shadow maps of the literature on one view          study_techniques.c
 *     verdict     what it means, in words                                study_verdict.c
 *     report      report.json, report.csv, report.html                   study_report.c
 *
 * Data flows in that order; each step reads only the results of earlier ones.
 *
 * The study has two truths. The *hard* truth is one ray from the sample: what the user of a shadow
 * wants. An answer is wrong if it is half or more away from it. Its error in metres is then the
 * distance to the shadow boundary; a right answer's is 0, and both count. The *area* truth is the
 * share of the filter's own footprint that sees the light, by truth_side^2 rays: what the filter
 * estimates. It gives errors in visibility.
 */
#include "study/study_math.h"
#include "study/techniques.h"
#include "umbrage/query.h"

#define UMBT_STUDY_BAKES_MAX      24
#define UMBT_STUDY_SETTINGS_MAX   320
#define UMBT_STUDY_RUNS           7  /* timed runs of a series, interleaved */
#define UMBT_STUDY_RUNS_MAX       28 /* the least of all counts */
#define UMBT_STUDY_NAME           32
#define UMBT_STUDY_PATH           4096
#define UMBT_STUDY_FACES          6 /* most frusta of a light */
#define UMBT_STUDY_TECHNIQUES_MAX 128
#define UMBT_STUDY_TAPS           9 /* width of the filter of the techniques */

struct umbt_study_options {
    const char *light, *sun, *point, *spot, *light_size, *up; /* In the form of umbrage-bake */
    char named[288];                                          /* Default folder of the report */
    uint64_t max_resolution; /* Highest resolution, voxels a side */
    uint64_t points;         /* Number of samples of a set */
    uint64_t truth_side;     /* Rays a side of the area truth */
    int quick;
};

/* An asset of one resolution. */
struct umbt_study_bake {
    char name[UMBT_STUDY_NAME]; /* "4096-closed" */
    char file[UMBT_STUDY_NAME]; /* name of its files in FOLDER/assets: "4096-auto" */
    uint32_t resolution;
    const char *rule;     /* --closed of its bake: "auto" or "off" */
    char reason[256];     /* reason why there is no asset, or empty */
    double wall_s, cpu_s; /* times of umbrage-bake without its self-check */
    struct umb_asset *asset;
    struct umb_asset_info info;
    struct umb_light_info light;
    struct umb_frustum_info frusta[UMBT_STUDY_FACES]; /* Frusta of the light that is studied */
    double voxel_m; /* mean edge of a voxel across the light, at the samples of the view */
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
    /* [count] The hard truth by opaque casters alone, 0 or 1, and the same times the share that
     * translucent casters let through. */
    float *opaque, *sharp;
    /* [count] Distance in metres along the surface to a change of the hard truth; infinite beyond
     * reach_m, and for free points. */
    float *boundary_m;
    double reach_m;
    const struct umb_light_info *lamp; /* spot or point light, borrowed; NULL: parallel light */
    double to_light[3];                /* Sun: towards it. Lamp: the way up of the pictures */
    double footprint_m;                /* mean side of what a pixel of a small picture sees */
};

/* Source of answers: a filter of an asset, or one of the peers of study_probe.h. */
enum umbt_study_method {
    UMBT_STUDY_DAG = 0, /* the box filter */
    UMBT_STUDY_TENT,
    UMBT_STUDY_FOOTPRINT, /* points.footprint_m wide */
    UMBT_STUDY_PENUMBRA,  /* against the light's disc */
    UMBT_STUDY_DEPTH_MAP, /* the peers */
    UMBT_STUDY_NANOVDB,
    UMBT_STUDY_DERIVED,
    UMBT_STUDY_METHODS
};

/* Accuracy of one setting on all surface samples together, and its times. */
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
    /* Shares of the judged samples with a wrong answer: of all, of the view's, of those near a
     * boundary. Parts of the first: too light, too dark, exactly half away (coarse levels). */
    double wrong, wrong_view, wrong_border;
    double false_light, false_shadow, undecided;
    /* Distance from the true boundary over all judged samples, 0 where the answer is right; where
     * no boundary is within reach, the reach. Mean, quantiles, largest. */
    double off_mean_m, off_p95_m, off_p99_m, off_max_m;
    double off_unknown;          /* share of judged samples that are wrong beyond reach */
    double truth_error;          /* estimated RMS error of the area truth itself */
    struct umbt_time view, free; /* CPU time of a point on one thread */
    struct umbt_time all;        /* wall time of a point of the view on all threads */
    double instructions;         /* instructions for a point of the view; NaN: not counted */
    double nodes, bricks;        /* nodes and bricks of an asset that a point of the view reads */
    /* Greatest distance in metres of an answer from the truth, and cache lines that a point reads,
     * both from the asset's own curve. NaN: no value. */
    double bound_m, lines;
};

/* Ways to trace rays at the same points. */
enum umbt_study_rays {
    UMBT_RAYS_VIEW, /* one ray a point */
    UMBT_RAYS_FREE,
    UMBT_RAYS_VIEW8, /* eight rays a call */
    UMBT_RAYS_AREA,  /* 81 rays a point: one a call, eight a call */
    UMBT_RAYS_AREA8,
    UMBT_RAYS_WAYS,
};

/* A shadow map of the literature, or an asset's DAG, on one view (study_techniques.c). */
struct umbt_study_technique {
    char name[UMBT_STUDY_NAME];
    enum umbt_technique_truth truth;
    const struct umbt_study_bake *bake; /* of the DAG; NULL: a shadow map */
    struct umbt_technique_result result;
    /* Of a shadow map: the DAGs with as many texels a side, and of the finest resolution that takes
     * no more bytes. Indices; -1: none. */
    int same_texels, same_bytes;
};

struct umbt_study {
    struct umbt_common common; /* output: FOLDER */
    struct umbt_study_options options;
    struct umbt_study_bake bakes[UMBT_STUDY_BAKES_MAX];
    uint32_t bake_count;
    uint32_t light_count; /* lights in the assets; the first is studied */
    struct umbt_study_points points;
    struct umbt_study_result results[UMBT_STUDY_SETTINGS_MAX];
    uint32_t result_count;
    struct umbt_time rays[UMBT_RAYS_WAYS]; /* Time of a ray; with AREA and AREA8, of a point */
    int64_t stopped;                       /* number of rays that hit a triangle, in all runs */
    int z_up;
    int translucent;     /* 1: casters let light through, by rays and in the assets */
    const char *missing; /* sentence about peers that could not be measured, or "" */
    char uncounted[160]; /* reason why instructions are not counted, or empty */
    struct umbt_study_technique techniques[UMBT_STUDY_TECHNIQUES_MAX];
    uint32_t technique_count, technique_resolution;
    size_t technique_points;
    double seconds; /* length of the study, set before the report */
};

/* Returns 1 if an asset of the study answers by the method. */
static inline int umbt_study_is_asset(enum umbt_study_method method)
{
    return method < UMBT_STUDY_DEPTH_MAP;
}

/* Returns the first frustum of the studied light; parallel light has no other. */
static inline const struct umb_frustum_info *umbt_study_frustum(const struct umbt_study_bake *bake)
{
    return &bake->frusta[0];
}

/* Returns 1 if the asset of a bake is under the closed rule. */
static inline int umbt_study_is_closed(const struct umbt_study_bake *bake)
{
    return bake->frusta[0].closed;
}

/* Computes the unit direction from a point to the light, and returns the light's distance; infinite
 * for parallel light. */
double umbt_study_towards(const struct umbt_study_points *points, const double point[3],
                          double towards[3]);

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

/* Returns true (1) if a result gets pictures: windows of 1 and 9 taps on the asset that the plan
 * chose at each resolution. */
int umbt_study_has_picture(const struct umbt_study *study, const struct umbt_study_result *result);

/* Writes a file name beneath FOLDER: "pictures/4096-closed-9.png", or "...-difference.png". */
void umbt_study_picture_name(const struct umbt_study *study, const struct umbt_study_result *result,
                             int difference, char *name, size_t size);

/* Measures and draws the techniques of techniques.h on one view; under a lamp none. Fails:
 * E_NO_MEMORY, E_ARGUMENT (the camera sees nothing), E_CANNOT_CREATE, E_IO. */
UMB_CHECKED enum umb_status umbt_study_techniques(struct umbt_study *study,
                                                  struct umb_error *error);

/* Names of the truths, by enum umbt_technique_truth. */
extern const char *const umbt_study_truth_names[UMBT_TECHNIQUE_TRUTHS];

/* Writes a file name beneath FOLDER: "pictures/technique-vsm.png"; NULL: the traced truth. */
void umbt_study_technique_picture(const struct umbt_study_technique *technique,
                                  enum umbt_technique_truth truth, char *name, size_t size);

/* Finds same_texels and same_bytes of all techniques. */
void umbt_study_techniques_pair(struct umbt_study *study);

/* Makes a setup's camera for a picture of that size: the view of `umbrage render`. */
UMB_CHECKED enum umb_status umbt_study_camera(const struct umbt_study *study,
                                              const uint32_t size[2], struct umbt_setup *setup,
                                              struct umb_error *error);

/* Writes FOLDER/report.json, report.csv and report.html, each as a whole. Fails: E_CANNOT_CREATE,
 * E_IO, E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbt_study_report(const struct umbt_study *study,
                                              struct umb_error *error);

/* Writes the members of report.json; user: the struct umbt_study. A failure shows in ferror. */
void umbt_study_json(struct umbu_json *json, const void *user);

/* Writes the verdict in words, a sentence a line: at most size bytes with the NUL. */
void umbt_study_summary(const struct umbt_study *study, char *text, size_t size);

#endif

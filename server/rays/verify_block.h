/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_RAYS_VERIFY_BLOCK_H
#define UMBRAGE_SERVER_RAYS_VERIFY_BLOCK_H
/*
 * Inside verification (verify.h): the job that all threads share, the block of points of one
 * thread, and the two halves of the work: drawing points and judging them.
 *
 * A block's random numbers follow from the seed and its number alone, and sums do not depend on
 * order, so the result is the same for every number of threads.
 */
#include <math.h>
#include <stddef.h>
#include "rays/verify.h"
#include "rays/verify_light_frame.h"
#include "umbrage/volume.h"

#define UMBR_SAMPLES_MAX 64 /* samples placed, looked up and judged at a time */

/* Data of all blocks; immutable while they run. Places are local (verify_light_frame.h). */
struct umbr_verify_job {
    const struct umb_asset *asset;
    const struct umbr_rays *rays;
    const struct umbr_verify_options *options;
    struct umb_light_info light;     /* position: local */
    struct umbr_light_frame *frames; /* [light.frustum_count] */
    double origin[3];                /* origin of the asset, world */
    struct umb_box bounds;           /* bounds of the casters, world */
    double free_m;                   /* metres: distance from a lamp within which nothing casts */
    struct umb_query query;          /* opaque casters only */
    struct umb_query light_query;    /* with translucent ones, if texel is not 0 */
    int32_t texel;            /* width in voxels of a map of translucent casters; 0: not judged */
    struct umb_volume volume; /* Target of segments, columns and boxes */
    int is_static;            /* baked under the static rule */
};

struct umbr_verify_block {
    const struct umbr_verify_job *job;
    const struct umbr_light_frame *light_frame;
    const struct umbr_exact *exact; /* rays in doubles, or NULL: floats resolve the voxels */
    enum umb_status status;         /* E_NO_MEMORY if there was no memory for rays in doubles */
    uint64_t random;
    struct umbr_verify_result result;
};

/* A point in voxel space, as a place, and with its voxel's centre. */
struct umbr_sample {
    double voxel[3]; /* voxel space */
    double local[3];
    double centre[3]; /* centre of its voxel, local */
};

/*
 * Prepares a job for a light.
 *
 * In:    job: asset, rays and options are set, everything else is zero.
 * Out:   job: to be closed after any result. exact: rays in doubles, if a frustum needs them; else
 *        NULL.
 * Fails: as umbr_verify.
 */
UMB_CHECKED enum umb_status umbr_verify_job_open(struct umbr_verify_job *job, uint32_t light,
                                                 const struct umbr_exact **exact,
                                                 struct umb_error *error);
void umbr_verify_job_close(struct umbr_verify_job *job);

/* Returns 1 if closed solids have undefined voxels in a block's frustum. */
static inline int umbr_has_undefined(const struct umbr_verify_block *block)
{
    return block->job->options->closed != NULL && block->light_frame->closed;
}

/* SplitMix64. */
static inline uint64_t umbr_next_random(struct umbr_verify_block *block)
{
    uint64_t z = block->random += UINT64_C(0x9e3779b97f4a7c15);
    z = (z ^ z >> 30) * UINT64_C(0xbf58476d1ce4e5b9);
    z = (z ^ z >> 27) * UINT64_C(0x94d049bb133111eb);
    return z ^ z >> 31;
}

/* Uniform in [0, 1). */
static inline double umbr_next_unit(struct umbr_verify_block *block)
{
    return (double)(umbr_next_random(block) >> 11) * 0x1p-53;
}

/* Returns 1 if floats cannot resolve a frustum's voxels, so that all its rays are in doubles. */
int umbr_verify_needs_exact(const struct umbr_light_frame *light_frame,
                            const struct umbr_rays *rays);

/* Draws a point anywhere in voxel space. */
static inline void umbr_draw_anywhere(struct umbr_verify_block *block, double voxel[3])
{
    for (int k = 0; k < 3; k++) {
        voxel[k] = umbr_next_unit(block) * block->light_frame->size;
    }
}

#define UMBR_RING_PLACES 32

/* Computes the offset in voxels, across the light, of place i on one of four rings around a voxel's
 * centre. */
static inline void umbr_ring_offset(int i, double offset[2])
{
    static const double rings[] = {0.001, 0.01, 0.1, 0.25};
    const double turn = 0.78539816339744831 * (i % 8);
    offset[0] = rings[i / 8] * cos(turn);
    offset[1] = rings[i / 8] * sin(turn);
}

/* Looks up places; answers[i]: 1 lit, 0 shadowed. */
void umbr_verify_ask(const struct umbr_verify_job *job, const double (*local)[3], size_t count,
                     uint8_t *lit);

/* Nearest hit of a ray, in floats or doubles as the block is set. */
void umbr_verify_nearest(const struct umbr_verify_block *block, const struct umbr_exact_ray *ray,
                         struct umbr_exact_hit *hit);

/*
 * Traces a point towards the light; returns the truth, 1 lit or 0 shadowed.
 *
 * Out: buried: 1 if the ray's first hit is the inner side of a closed solid, so that the point most
 *      likely lies inside it. Always 0 without the closed rule.
 */
int umbr_verify_trace(const struct umbr_verify_block *block, const double local[3], int *buried);

/*
 * Switches a block to rays in doubles, to judge again a point that float rays judge wrong. Returns
 * 0 if the block uses doubles already, or if out of memory (status). The caller restores `exact`.
 */
int umbr_verify_look_again(struct umbr_verify_block *block);

/* Looks up and judges count <= UMBR_SAMPLES_MAX samples; returns how many were compared. */
uint64_t umbr_verify_judge(struct umbr_verify_block *block, const struct umbr_sample *samples,
                           size_t count);

/* Judges samples by the answers lit[i], 1 or 0. Returns how many samples were compared. */
uint64_t umbr_verify_judge_answers(struct umbr_verify_block *block,
                                   const struct umbr_sample *samples, const uint8_t *lit,
                                   size_t count);

/* Returns 1 if any answer is allowed for a sample, because it lies in the band or in a solid.
 * truth: 1 lit or 0 shadowed. */
int umbr_verify_is_unsure(const struct umbr_verify_block *block, const struct umbr_sample *sample,
                          int truth);

/* Verdict on an answer. */
enum umbr_verdict {
    UMBR_AGREES,
    UMBR_SAYS_NOTHING, /* inside a closed solid, where any answer is right */
    UMBR_IN_BAND,
    UMBR_WRONG, /* by float rays: judge it again (umbr_verify_look_again) */
};

/* Counts a verdict on an answer at a place. Returns 1 if the answer was compared, else 0. */
uint64_t umbr_verify_count(struct umbr_verify_block *block, enum umbr_verdict verdict,
                           const double local[3]);

/* Prepares the job's query of translucent casters, if they are judged. Fails: the errors of
 * umb_query_prepare. */
UMB_CHECKED enum umb_status umbr_verify_light_prepare(struct umbr_verify_job *job, uint32_t light,
                                                      struct umb_error *error);

/* Judges the light that translucent casters leave at a sample which all opaque ones leave lit. */
enum umbr_verdict umbr_verify_judge_light(struct umbr_verify_block *block,
                                          const struct umbr_sample *sample);

/* Computes the light's path through column (x, y) of the block's frustum. ray: from the first voxel
 * of the column, or from the lamp if it stands within the column, to the last voxel. z_first: the
 * ray's start in voxels. Returns 0 if the frustum's middle lies behind the lamp. */
int umbr_verify_column(const struct umbr_verify_block *block, double x, double y,
                       struct umbr_exact_ray *ray, double *z_first);

/* Computes local and centre from voxel; returns 0 outside the frustum, or in another face. */
int umbr_verify_place(const struct umbr_verify_block *block, struct umbr_sample *sample);

/* Finds a boundary of a random kind; lowers *walks by the rows walked. Returns 0 if none was
 * found. */
int umbr_verify_boundary(struct umbr_verify_block *block, uint64_t *walks, double boundary[3]);

/* Judges a place that no frustum of the light covers. The place must be lit, and is counted only if
 * it is not. */
void umbr_verify_judge_outside(struct umbr_verify_block *block, const double local[3]);

/* Draw and judge `count` points, segments, columns or boxes: verify_draw.c, and for all but points
 * verify_volume_queries.c. A scene may have too few places to draw, and fewer are judged then. */
void umbr_verify_points(struct umbr_verify_block *block, uint64_t count);
void umbr_verify_segments(struct umbr_verify_block *block, uint64_t count);
void umbr_verify_columns(struct umbr_verify_block *block, uint64_t count);
void umbr_verify_boxes(struct umbr_verify_block *block, uint64_t count);

#endif

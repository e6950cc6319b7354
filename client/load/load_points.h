/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_LOAD_LOAD_POINTS_H
#define UMBRAGE_LOAD_LOAD_POINTS_H
/*
 * What a load test asks: a pool of batches, made before the run and asked round and round.
 *
 * Camera: a camera flies once round over the asset's bounds and looks ahead and down; a batch is a
 * frame of its pixels in scan order, 16:9, where their rays meet the plane a tenth of the way up.
 * Up is the axis along which the bounds are shortest. Neighbours in a batch are neighbours in
 * space. Random: uniform in the bounds. Boundary: random points close to where light turns to
 * shadow, found by halving random segments through the service itself, before the run. Trace: a
 * file of points, as `umbrage query --points` reads them, in its order. The same asset, seed and
 * counts give the same pool.
 */
#include "cli/cli_points.h"
#include "umbrage/client.h"

enum umbc_load_kind {
    UMBC_LOAD_CAMERA,
    UMBC_LOAD_RANDOM,
    UMBC_LOAD_BOUNDARY,
    UMBC_LOAD_TRACE,
};

struct umbc_load_pool {
    double origin[3]; /* metres: centre of the bounds */
    float *positions; /* [3 * batch * batch_count], relative to origin */
    float *normals;   /* the same, or NULL */
    size_t batch;     /* points of a call */
    size_t batch_count;
};

struct umbc_load_source {
    enum umbc_load_kind kind;
    const char *asset;
    const char *trace; /* of UMBC_LOAD_TRACE: a file */
    enum umbc_points_format format;
    bool with_normals;
    uint32_t light;
    uint64_t seed;
    size_t batch;
};

/*
 * Makes a pool of at least 16 batches and about 2^18 points; a trace is taken whole, up to 2^26
 * points, and its last batch is filled from its beginning.
 *
 * In:    bounds: of the asset. client: asked by UMBC_LOAD_BOUNDARY.
 * Fails: E_NO_MEMORY; of a trace what reading it gives, E_FORMAT (no points); of boundaries what
 * the service gives, E_NOT_FOUND (hardly any shadow within the bounds).
 */
UMB_CHECKED enum umb_status umbc_load_pool_make(const struct umbc_load_source *source,
                                                const struct umb_box *bounds,
                                                struct umb_client *client,
                                                struct umbc_load_pool *pool,
                                                struct umb_error *error);
void umbc_load_pool_finish(struct umbc_load_pool *pool);

/* Batch `index`, counted round and round; borrowed. */
struct umb_points umbc_load_pool_batch(const struct umbc_load_pool *pool, uint64_t index);

#endif

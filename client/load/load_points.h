/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_LOAD_LOAD_POINTS_H
#define UMBRAGE_LOAD_LOAD_POINTS_H
/*
 * The points of a load test: a pool of batches, made before the run and sent again and again.
 *
 *   camera    frames of a camera that flies once round over the asset's bounds and looks ahead and
 *             down. A batch is a frame of pixels, 16:9 in scan order; a point is the place where a
 *             pixel's ray meets the plane at a tenth of the bounds' height. Up is the shortest axis
 *             of the bounds. Neighbours in a batch are neighbours in space.
 *   random    uniform in the bounds
 *   boundary  close to shadow boundaries, found by queries to the service
 *   trace     the points of a file, as `umbrage query --points` reads them, in its order
 *
 * The same asset, seed and counts give the same pool.
 */
#include "cli/shared/cli_points.h"
#include "umbrage/client.h"

enum umbc_load_kind {
    UMBC_LOAD_CAMERA,
    UMBC_LOAD_RANDOM,
    UMBC_LOAD_BOUNDARY,
    UMBC_LOAD_TRACE,
};

struct umbc_load_pool {
    double origin[3]; /* centre of the bounds in metres */
    float *positions; /* [3 * batch * batch_count], relative to origin */
    float *normals;   /* [3 * batch * batch_count], or NULL */
    size_t batch;     /* points in a call */
    size_t batch_count;
};

struct umbc_load_source {
    enum umbc_load_kind kind;
    const char *asset;
    const char *trace; /* file of UMBC_LOAD_TRACE */
    enum umbc_points_format format;
    bool with_normals;
    uint32_t light;
    uint64_t seed;
    size_t batch;
};

/*
 * Makes a pool of at least 16 batches and about 2^18 points. All points of a trace are taken, up to
 * 2^26; its first points are repeated to fill the last batch.
 *
 * In:    bounds: bounds of the asset. client: for UMBC_LOAD_BOUNDARY.
 * Fails: E_NO_MEMORY; for a trace as umbc_points_read, E_FORMAT (no points); for boundaries as the
 *        service, E_NOT_FOUND (hardly any shadow boundary in the bounds).
 */
UMB_CHECKED enum umb_status umbc_load_pool_make(const struct umbc_load_source *source,
                                                const struct umb_box *bounds,
                                                struct umb_client *client,
                                                struct umbc_load_pool *pool,
                                                struct umb_error *error);
void umbc_load_pool_finish(struct umbc_load_pool *pool);

/* Returns batch `index` modulo batch_count; borrowed. */
struct umb_points umbc_load_pool_batch(const struct umbc_load_pool *pool, uint64_t index);

#endif

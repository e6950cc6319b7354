/* SPDX-License-Identifier: Apache-2.0 */
/* See calibrations.h. */
#include "daemon/work/calibrations.h"

#include <math.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#define SLOTS 256 /* 60 KiB */
/* Number of points below which a batch is too small to calibrate on; the library then makes points
 * of its own. */
#define FEW           8192
#define PAIRS         256  /* pairs of consecutive points that are compared */
#define NEAR_IN_EDGES 32.0 /* distance of near points in voxel edges: mostly in the same bricks */

struct slot {
    uint8_t asset[UMB_ID_BYTES];
    uint32_t light;
    enum umbd_point_kind kind;
    int used;
    struct umb_calibration calibration;
};

struct umbd_calibrations {
    pthread_mutex_t lock;
    size_t next; /* slot that is used next */
    struct slot slots[SLOTS];
};

/* Position of a point; positions may lie unaligned in a message. */
static void position_of(const struct umb_points *points, size_t i, double p[3])
{
    const uint8_t *at = points->positions;
    float narrow[3];
    if (points->format == UMB_POINT_F64) {
        memcpy(p, at + i * 3 * sizeof(double), 3 * sizeof(double));
        return;
    }
    memcpy(narrow, at + i * sizeof narrow, sizeof narrow);
    for (int k = 0; k < 3; k++) {
        p[k] = (double)narrow[k];
    }
}

/* Mean edge of a light's voxels, metres; 0 if it has none. */
static double edge_of(const struct umb_asset *asset, uint32_t light)
{
    struct umb_light_info info;
    struct umb_frustum_info frustum;
    double edges[3];
    if (umb_asset_get_light(asset, light, &info) != UMB_OK || info.frustum_count == 0 ||
        umb_asset_get_frustum(asset, info.first_frustum, &frustum) != UMB_OK) {
        return 0;
    }
    umb_frustum_voxel_edges(&frustum, edges);
    return (edges[0] + edges[1] + edges[2]) / 3;
}

enum umbd_point_kind umbd_point_kind_of(const struct umb_asset *asset, uint32_t light,
                                        const struct umb_points *points, int are_depths)
{
    if (points->count < FEW) {
        return UMBD_POINTS_FEW;
    }
    if (are_depths) {
        return UMBD_POINTS_COHERENT;
    }
    const double near_m = NEAR_IN_EDGES * edge_of(asset, light);
    int near = 0;
    for (size_t pair = 0; pair < PAIRS; pair++) {
        const size_t i = pair * (points->count / PAIRS);
        double a[3], b[3];
        position_of(points, i, a);
        position_of(points, i + 1, b);
        near += hypot(hypot(b[0] - a[0], b[1] - a[1]), b[2] - a[2]) <= near_m;
    }
    return near >= PAIRS / 2 ? UMBD_POINTS_COHERENT : UMBD_POINTS_SCATTERED;
}

struct umbd_calibrations *umbd_calibrations_create(void)
{
    struct umbd_calibrations *table = calloc(1, sizeof *table);
    if (table != NULL && pthread_mutex_init(&table->lock, NULL) != 0) {
        free(table);
        return NULL;
    }
    return table;
}

void umbd_calibrations_destroy(struct umbd_calibrations *table)
{
    if (table != NULL) {
        (void)pthread_mutex_destroy(&table->lock);
        free(table);
    }
}

/* Finds a slot; NULL if there is none. Called under the lock. */
static struct slot *find(struct umbd_calibrations *table, const uint8_t asset[UMB_ID_BYTES],
                         uint32_t light, enum umbd_point_kind kind)
{
    for (size_t i = 0; i < SLOTS; i++) {
        struct slot *slot = &table->slots[i];
        if (slot->used && slot->light == light && slot->kind == kind &&
            memcmp(slot->asset, asset, UMB_ID_BYTES) == 0) {
            return slot;
        }
    }
    return NULL;
}

void umbd_calibrations_put(struct umbd_calibrations *table, const uint8_t asset[UMB_ID_BYTES],
                           uint32_t light, enum umbd_point_kind kind,
                           const struct umb_calibration *calibration)
{
    pthread_mutex_lock(&table->lock);
    struct slot *slot = find(table, asset, light, kind);
    if (slot == NULL) {
        slot = &table->slots[table->next];
        table->next = (table->next + 1) % SLOTS;
    }
    memcpy(slot->asset, asset, UMB_ID_BYTES);
    slot->light = light;
    slot->kind = kind;
    slot->calibration = *calibration;
    slot->used = 1;
    pthread_mutex_unlock(&table->lock);
}

int umbd_calibrations_get(struct umbd_calibrations *table, const uint8_t asset[UMB_ID_BYTES],
                          uint32_t light, enum umbd_point_kind kind,
                          struct umb_calibration *calibration)
{
    memset(calibration, 0, sizeof *calibration);
    pthread_mutex_lock(&table->lock);
    const struct slot *slot = find(table, asset, light, kind);
    if (slot != NULL) {
        *calibration = slot->calibration;
    }
    pthread_mutex_unlock(&table->lock);
    return slot != NULL;
}

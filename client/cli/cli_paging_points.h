/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CLI_CLI_PAGING_POINTS_H
#define UMBRAGE_CLI_CLI_PAGING_POINTS_H
/* Points that `umbrage stream` asks a region about while it sharpens: figures and pictures. */
#include <stdbool.h>
#include "cli_points.h"
#include "umbrage/region.h"

#define UMBC_PAGING_POINTS_MAX (16U << 20)

struct umbc_paging_points {
    size_t count;
    double *positions;       /* [3 * count] world space */
    float *normals;          /* [3 * count], or NULL */
    float *values, *error_m; /* [count] of the last evaluation */
};

/* What a region knows of the points. */
struct umbc_paging_figures {
    uint64_t exact, within_1m, within_10cm; /* points whose border is known as well */
    double worst_m;                         /* of any point; 0: all exact */
};

/* Reads all points of a file. Fails: as umbc_points_read; E_TOO_LARGE, E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbc_paging_points_load(const char *path,
                                                    enum umbc_points_format format, bool normals,
                                                    struct umbc_paging_points *points,
                                                    struct umb_error *error);
void umbc_paging_points_finish(struct umbc_paging_points *points);

/* Asks the region about all points. want: see umb_region_query. */
UMB_CHECKED enum umb_status umbc_paging_points_ask(struct umbc_paging_points *points,
                                                   struct umb_region *region,
                                                   const struct umb_query_settings *settings,
                                                   bool want, struct umbc_paging_figures *figures,
                                                   struct umb_error *error);

/*
 * Writes what the camera sees of the points, shaded by the last answers, as a PPM picture; points
 * that are not exact yet are orange.
 * In: light: unit vector in which the light travels.
 * Fails: E_CANNOT_CREATE, E_IO, E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbc_paging_points_draw(const struct umbc_paging_points *points,
                                                    const struct umb_partial_view *view,
                                                    const double light[3], const uint32_t size[2],
                                                    const char *path, struct umb_error *error);

#endif

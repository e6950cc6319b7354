/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CLI_CLI_PAGING_POINTS_H
#define UMBRAGE_CLI_CLI_PAGING_POINTS_H
/* Points that `umbrage stream` asks after each step: figures and pictures. */
#include <stdbool.h>
#include "cli/shared/cli_points.h"
#include "umbrage/region.h"

#define UMBC_PAGING_POINTS_MAX (16U << 20)

struct umbc_paging_points {
    struct umbc_point_list list;
    float *values, *error_m; /* [count] answers of the last step, and their errors in metres */
};

/* Accuracy of a region's answers. */
struct umbc_paging_figures {
    /* Number of points whose shadow boundary is known exactly, to 1 m, and to 10 cm */
    uint64_t exact, within_1m, within_10cm;
    double worst_m; /* largest error of a point in metres; 0: all exact */
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
 * Writes a PPM picture of the points that the camera sees, shaded by the last answers. Points that
 * are not exact yet are orange.
 *
 * In:    light: unit vector along which the light travels.
 * Fails: E_CANNOT_CREATE, E_IO, E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbc_paging_points_draw(const struct umbc_paging_points *points,
                                                    const struct umb_partial_view *view,
                                                    const double light[3], const uint32_t size[2],
                                                    const char *path, struct umb_error *error);

#endif

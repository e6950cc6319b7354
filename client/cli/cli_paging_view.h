/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CLI_CLI_PAGING_VIEW_H
#define UMBRAGE_CLI_CLI_PAGING_VIEW_H
/* Texts of boxes, cameras and paths, for `umbrage stream`, `frames` and `derive`. */
#include <stdbool.h>
#include <stddef.h>
#include "umbrage/partial.h"

/* Views along a path. */
struct umbc_views {
    struct umb_partial_view *list; /* [count] */
    size_t count;
};

/* Reads "X0,Y0,Z0,X1,Y1,Z1", two corners in any order. Returns false for anything else. */
bool umbc_parse_box(const char *text, struct umb_partial_view *view);

/*
 * Reads "eye=X,Y,Z,target=X,Y,Z[,fov=DEG][,far=M]". fov is the vertical field of view, 60 degrees
 * by default.
 *
 * In: aspect: width / height. up: 'y' or 'z'. Returns false for anything else.
 */
bool umbc_parse_camera(const char *text, double aspect, char up, struct umb_partial_view *view);

/*
 * Reads a path: a camera a line; empty lines and lines that begin with # are skipped. A view takes
 * its other settings from `base`.
 *
 * Fails: E_NO_INPUT, E_FORMAT (the line is named), E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbc_read_path(const char *path, double aspect, char up,
                                           const struct umb_partial_view *base,
                                           struct umbc_views *views, struct umb_error *error);
void umbc_views_finish(struct umbc_views *views);

/* Computes the pixel at which a camera sees a point, from the upper left corner. Returns false for
 * a point outside of the picture. */
bool umbc_project(const struct umb_partial_view *view, const double point[3], size_t width,
                  size_t height, size_t pixel[2]);

#endif

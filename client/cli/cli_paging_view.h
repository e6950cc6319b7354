/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CLI_CLI_PAGING_VIEW_H
#define UMBRAGE_CLI_CLI_PAGING_VIEW_H
/* Boxes and cameras of `umbrage stream`, as people write them. */
#include <stdbool.h>
#include <stddef.h>
#include "umbrage/partial.h"

/* Views along a path. */
struct umbc_views {
    struct umb_partial_view *list; /* [count] */
    size_t count;
};

/* "X0,Y0,Z0,X1,Y1,Z1", corners in any order. Returns false if it is anything else. */
bool umbc_parse_box(const char *text, struct umb_partial_view *view);

/*
 * "eye=X,Y,Z,target=X,Y,Z[,fov=DEG][,far=M]": fov is the picture's height, 60 without.
 * In: aspect: width / height. up: 'y' or 'z'. Returns false if it is anything else.
 */
bool umbc_parse_camera(const char *text, double aspect, char up, struct umb_partial_view *view);

/*
 * Reads a path: a camera a line; empty lines and lines with # are skipped. Each gets what `base`
 * has set besides.
 * Fails: E_NO_INPUT, E_FORMAT (the line is named), E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbc_read_path(const char *path, double aspect, char up,
                                           const struct umb_partial_view *base,
                                           struct umbc_views *views, struct umb_error *error);
void umbc_views_finish(struct umbc_views *views);

/* Where a camera sees a point: pixels from the upper left corner. False: behind or beside. */
bool umbc_project(const struct umb_partial_view *view, const double point[3], size_t width,
                  size_t height, size_t pixel[2]);

#endif

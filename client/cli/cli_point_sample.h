/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CLI_CLI_POINT_SAMPLE_H
#define UMBRAGE_CLI_CLI_POINT_SAMPLE_H
/* A fair sample of the points of a file, to calibrate on before they are asked. */
#include "cli_points.h"

#define UMBC_SAMPLE_POINTS 262144 /* touch more than caches hold */

/*
 * Reads ranges of consecutive points from all over a file, or all of a small one.
 *
 * In:    path, format, with_normals: as umbc_points_open takes them. most: points that are wanted.
 * Out:   batch: made here; umbc_batch_finish it, also after a failure. Its count is 0 for stdin,
 *        pipes and whatever cannot be read: reading all of it will say why.
 * Fails: E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbc_points_sample(const char *path, enum umbc_points_format format,
                                               bool with_normals, size_t most,
                                               struct umbc_batch *batch, struct umb_error *error);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_VERIFY_VOXELS_H
#define UMBRAGE_SERVER_STUDY_VERIFY_VOXELS_H
/* `verify --every-voxel`: compares all columns of a light with rays (rays/verify_squares.h). */
#include "rays/verify.h"

/*
 * Compares every voxel of one light.
 *
 * In:    options: closed, threads, progress and cancelled are read; progress gets columns.
 * Out:   result: records: columns; points: voxels that were judged one by one. After the first
 *        row of squares with a disagreement outside the band the rest is left out.
 * Fails: as umbr_verify_squares; E_UNSUPPORTED (an asset under the static rule); E_LIMIT (too many
 *        voxels of a row of squares must be judged one by one).
 */
UMB_CHECKED enum umb_status umbt_voxels_verify(const struct umb_asset *asset, uint32_t light,
                                               const struct umbr_rays *rays,
                                               const struct umbr_verify_options *options,
                                               struct umbr_verify_result *result,
                                               struct umb_error *error);

/* Number of columns of all faces of a light. */
uint64_t umbt_columns_of(const struct umb_asset *asset, uint32_t light);

#endif

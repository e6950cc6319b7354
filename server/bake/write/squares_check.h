/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_WRITE_SQUARES_CHECK_H
#define UMBRAGE_SERVER_BAKE_WRITE_SQUARES_CHECK_H
/* Inside the self-check (self_check.h): what earlier bakes compared is left out, and the rest is
 * compared voxel by voxel. */
#include "bake/write/self_check.h"

/*
 * Compares the squares of an asset that no earlier bake compared, and notes them in check->proofs.
 *
 * Out:   sample: 1 if the squares are too many, or could not be judged: the random check is needed.
 *        The digests of squares are in check->proofs then, without a comparison.
 * Fails: as umbb_self_check_part.
 */
UMB_CHECKED enum umb_status umbb_squares_check(const struct umb_asset *asset,
                                               const struct umbb_check *check,
                                               struct umbb_checked *checked, int *sample,
                                               struct umb_error *error);

/* Notes that all squares without a comparison were covered by a random check of so many points a
 * light. */
void umbb_squares_sampled(struct umbb_proofs *proofs, uint64_t points);

#endif

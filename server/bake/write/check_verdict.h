/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_WRITE_CHECK_VERDICT_H
#define UMBRAGE_SERVER_BAKE_WRITE_CHECK_VERDICT_H
/* The verdict on a comparison with rays. */
#include "bake/write/self_check.h"

/* Fails if the comparison of a light disagrees outside the band: as umbb_self_check_part. */
UMB_CHECKED enum umb_status umbb_check_verdict(const struct umbb_check *check, uint32_t light,
                                               const struct umbr_verify_result *result,
                                               struct umb_error *error);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
#include "bake/write/check_verdict.h"

enum umb_status umbb_check_verdict(const struct umbb_check *check, uint32_t light,
                                   const struct umbr_verify_result *result, struct umb_error *error)
{
    const double *p = result->worst_point;
    if (result->outside_band == 0) {
        return UMB_OK;
    }
    if (check->open_on_word > 0) {
        return umb_fail(error, UMB_E_BAD_SCENE,
                        "--closed on: %zu parts are not closed, and light gets in: light %u: %llu "
                        "of %llu points disagree with traced rays, one at %.9g %.9g %.9g; nothing "
                        "was published (--closed auto bakes such parts as they are)",
                        check->open_on_word, light, (unsigned long long)result->outside_band,
                        (unsigned long long)result->points, p[0], p[1], p[2]);
    }
    return umb_fail(error, UMB_E_INTERNAL,
                    "self-check: light %u: %llu of %llu points disagree with traced rays by more "
                    "than a voxel, one at %.9g %.9g %.9g; nothing was published",
                    light, (unsigned long long)result->outside_band,
                    (unsigned long long)result->points, p[0], p[1], p[2]);
}

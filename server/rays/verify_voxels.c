/* SPDX-License-Identifier: Apache-2.0 */
/* All squares of a light. They are compared row by row, because each call has a limit of voxels
 * that are judged one by one. */
#include "rays/verify_squares.h"

#include <stdlib.h>
#include <string.h>

#include "base/try.h"

static uint32_t size_of(const struct umb_asset *asset, uint32_t frustum)
{
    struct umb_frustum_info info;
    return umb_asset_get_frustum(asset, frustum, &info) == UMB_OK ? 1U << info.log2_size : 0;
}

uint64_t umbr_columns_of(const struct umb_asset *asset, uint32_t light)
{
    struct umb_light_info info;
    uint64_t columns = 0;
    if (umb_asset_get_light(asset, light, &info) == UMB_OK) {
        for (uint32_t face = 0; face < info.frustum_count; face++) {
            const uint64_t size = size_of(asset, info.first_frustum + face);
            columns += size * size;
        }
    }
    return columns;
}

/* Adds the result of a row of squares. */
static void add_row(struct umbr_verify_result *sum, const struct umbr_verify_result *row)
{
    umbr_verify_result_add(sum, row);
    if (row->has_worst && !sum->has_worst) {
        sum->has_worst = 1;
        memcpy(sum->worst_point, row->worst_point, sizeof sum->worst_point);
    }
}

/* Compares one face. In: squares: [size / UMBR_SQUARE] working memory. */
static enum umb_status verify_face(const struct umb_asset *asset, uint32_t light, uint32_t frustum,
                                   const struct umbr_rays *rays,
                                   const struct umbr_verify_options *options,
                                   struct umbr_square *squares, struct umbr_verify_result *result,
                                   struct umb_error *error)
{
    const uint32_t size = size_of(asset, frustum);
    for (uint32_t y = 0; y < size && result->outside_band == 0; y += UMBR_SQUARE) {
        struct umbr_squares_result row;
        size_t count = 0;
        for (uint32_t x = 0; x < size; x += UMBR_SQUARE) {
            squares[count++] = (struct umbr_square){frustum, x, y};
        }
        UMB__TRY(umbr_verify_squares(asset, light, rays, options, squares, count, &row, error));
        if (row.gave_up) {
            return umb_fail(error, UMB_E_LIMIT,
                            "frustum %u, row %u: too many voxels must be judged one by one; "
                            "compare points instead (--points N)",
                            frustum, y);
        }
        add_row(result, &row.found);
        if (options->progress != NULL) {
            options->progress(options->progress_user, result->records);
        }
    }
    return UMB_OK;
}

enum umb_status umbr_verify_voxels(const struct umb_asset *asset, uint32_t light,
                                   const struct umbr_rays *rays,
                                   const struct umbr_verify_options *options,
                                   struct umbr_verify_result *result, struct umb_error *error)
{
    struct umb_asset_info about;
    struct umb_light_info info;
    *result = (struct umbr_verify_result){.points = 0};
    umb_asset_get_info(asset, &about);
    UMB__TRY(umb_asset_get_light(asset, light, &info));
    if (about.receiver_mask_bytes > 0) {
        return umb_fail(error, UMB_E_UNSUPPORTED,
                        "verification: an asset under the static rule is right on surfaces only; "
                        "compare points");
    }
    struct umbr_square *squares =
        malloc((size_of(asset, info.first_frustum) / UMBR_SQUARE + 1U) * sizeof *squares);
    if (squares == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "verification: memory for squares refused");
    }
    enum umb_status status = UMB_OK;
    for (uint32_t face = 0; face < info.frustum_count && status == UMB_OK; face++) {
        status = verify_face(asset, light, info.first_frustum + face, rays, options, squares,
                             result, error);
    }
    free(squares);
    return status;
}

/* SPDX-License-Identifier: Apache-2.0 */
/* Queries of cascades, and their seams; see umbrage/cascades.h. */
#include "umbrage/cascades.h"

#include <math.h>
#include <string.h>
#include "base/bytes.h"
#include "base/try.h"
#include "base/vec.h"

/* Returns a point's distance along the view, metres. */
static double view_depth(const struct umb_cascade_plan *plan, const struct umb_points *points,
                         size_t index)
{
    const uint8_t *bytes = points->positions;
    double p[3];
    for (size_t k = 0; k < 3; k++) {
        const size_t at = 3 * index + k;
        p[k] = points->origin[k] - plan->eye[k];
        p[k] += points->format == UMB_POINT_F64 ? umb__load_f64(bytes + 8 * at)
                                                : (double)umb__load_f32(bytes + 4 * at);
    }
    return umb__dot(p, plan->forward);
}

void umb_cascades_run(const struct umb_cascade_plan *plan, const struct umb_map_query *queries,
                      const struct umb_points *points, size_t first, size_t count, float *values)
{
    for (size_t i = first; i < first + count; i++) {
        const double z = view_depth(plan, points, i);
        uint32_t slice = 0;
        while (slice + 1 < plan->count && z >= plan->splits[slice + 1]) {
            slice++;
        }
        umb_map_run(&queries[slice], points, i, 1, values);
        const double end = plan->splits[slice + 1];
        const double band = plan->blend * (end - plan->splits[slice]);
        if (slice + 1 < plan->count && z > end - band) {
            const double share = (z - (end - band)) / band;
            const double fine = (double)values[i];
            umb_map_run(&queries[slice + 1], points, i, 1, values);
            values[i] = (float)(fine + share * ((double)values[i] - fine));
        }
    }
}

/* Computes the root mean square of the difference between coarse and fine answers, for one contrast
 * of the coarse filter. In: scratch: fine answers, with room for the coarse answers after them. */
static enum umb_status seam_difference(const struct umb_cascade_seam *seam, double contrast,
                                       const struct umb_points *points, float *scratch,
                                       double *difference, struct umb_error *error)
{
    struct umb_map_filter filter = seam->coarse_filter;
    struct umb_map_query query;
    float *coarse = scratch + points->count;
    double sum = 0.0;
    filter.contrast = contrast;
    UMB__TRY(umb_map_prepare(seam->coarse, &filter, &query, error));
    umb_map_run(&query, points, 0, points->count, coarse);
    for (size_t i = 0; i < points->count; i++) {
        const double d = (double)coarse[i] - (double)scratch[i];
        sum += d * d;
    }
    *difference = sqrt(sum / (double)points->count);
    return UMB_OK;
}

enum umb_status umb_cascades_match(struct umb_cascade_seam *seam, const struct umb_points *points,
                                   float *scratch, struct umb_error *error)
{
    /* A golden-section search over log2 of the contrast, -10..10. Answers fall as the contrast
     * rises, so the difference has one minimum if the coarse layer is lighter, or darker, all along
     * the seam. Otherwise the result may be no minimum, but it is never worse than contrast 1. */
    const double golden = 0.61803398874989484820;
    struct umb_map_query query;
    double low = -10.0, high = 10.0, at[2], value[2] = {0.0, 0.0};
    UMB__TRY(umb_map_prepare(seam->fine, &seam->fine_filter, &query, error));
    umb_map_run(&query, points, 0, points->count, scratch);
    seam->contrast = 1.0;
    enum umb_status status = seam_difference(seam, 1.0, points, scratch, &seam->difference, error);
    seam->after = seam->difference;
    for (int step = 0; step < 20 && status == UMB_OK; step++) {
        at[0] = high - golden * (high - low);
        at[1] = low + golden * (high - low);
        for (int k = 0; k < 2 && status == UMB_OK; k++) {
            status = seam_difference(seam, exp2(at[k]), points, scratch, &value[k], error);
            if (status == UMB_OK && value[k] < seam->after) {
                seam->after = value[k];
                seam->contrast = exp2(at[k]);
            }
        }
        if (value[0] <= value[1]) {
            high = at[1];
        } else {
            low = at[0];
        }
    }
    return status;
}

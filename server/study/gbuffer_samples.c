/* SPDX-License-Identifier: Apache-2.0 */
/* Places of sub-samples in their pixels (gbuffer.h). */
#include "study/gbuffer.h"

/* Computes the offset of sub-sample k of aa * aa in its pixel, 0..1. The grid is turned, so that no
 * two sub-samples share a row or a column. */
static void subsample_offset(uint32_t aa, uint32_t k, double *u, double *v)
{
    const double i = (double)(k % aa), j = (double)(k / aa), n = (double)aa;
    *u = (i + (j + 0.5) / n) / n;
    *v = (j + (n - 0.5 - i) / n) / n;
}

void umbt_gbuffer_direction(const struct umbt_gbuffer *buffer, const struct umbt_camera *camera,
                            uint32_t height, size_t index, double direction[3])
{
    const uint32_t per_pixel = buffer->aa * buffer->aa;
    const size_t pixel = index / per_pixel;
    double u = 0.0, v = 0.0;
    subsample_offset(buffer->aa, (uint32_t)(index % per_pixel), &u, &v);
    u = ((double)(pixel % buffer->width) + u) / (double)buffer->width;
    v = ((double)(buffer->first_row + pixel / buffer->width) + v) / (double)height;
    umbt_camera_ray(camera, u, v, direction);
}

/* SPDX-License-Identifier: Apache-2.0 */
/* How texels fit pixels; see umbrage/aliasing.h. */
#include "umbrage/aliasing.h"

#include <math.h>
#include <string.h>
#include "maps/map_receiver.h"
#include "maps/map_view.h"
#include "base/vec.h"

/* Computes the gradients of pixel coordinates, per metre. Returns 0 for a point behind the
 * camera. */
static int pixel_gradients(const struct umb__map_view *camera, const double size[2],
                           const double world[3], double gradient[2][3], double *distance)
{
    const double *axes[2] = {camera->right, camera->up};
    const double tangents[2] = {camera->tan_x, camera->tan_y};
    double p[3];
    umb__subtract(world, camera->eye, p);
    const double z = umb__dot(p, camera->forward);
    if (!(z > 0.0)) {
        return 0;
    }
    for (int i = 0; i < 2; i++) {
        const double scale = 0.5 * size[i] / (tangents[i] * z);
        const double at = umb__dot(p, axes[i]) / z;
        for (int k = 0; k < 3; k++) {
            gradient[i][k] = scale * (axes[i][k] - at * camera->forward[k]);
        }
    }
    *distance = umb__length(p);
    return 1;
}

/* Computes how much each coordinate changes along each axis of a plane. */
static void along_plane(double gradient[2][3], double axes[2][3], double out[2][2])
{
    for (int i = 0; i < 2; i++) {
        for (int k = 0; k < 2; k++) {
            out[i][k] = umb__dot(gradient[i], axes[k]);
        }
    }
}

/*
 * Computes the singular values of a 2 x 2 matrix: the sum and the difference of the lengths of the
 * matrix's rotation and reflection parts. The greater value has no cancellation.
 */
static void singular_values(double m[2][2], double *most, double *least)
{
    const double turn = hypot(m[0][0] + m[1][1], m[1][0] - m[0][1]);
    const double mirror = hypot(m[0][0] - m[1][1], m[1][0] + m[0][1]);
    *most = 0.5 * (turn + mirror);
    *least = 0.5 * fabs(turn - mirror);
}

static void to_light(const struct umb_map_frustum *frustum, const double world[3], double out[3])
{
    if (frustum->directional) {
        memcpy(out, frustum->light, 3 * sizeof *out);
    } else {
        umb__subtract(frustum->light, world, out);
    }
    (void)umb__unit(out);
}

static void all_infinite(struct umb_aliasing *a)
{
    *a = (struct umb_aliasing){.most = INFINITY,
                               .least = INFINITY,
                               .along = {INFINITY, INFINITY},
                               .perspective = INFINITY,
                               .projection = INFINITY};
}

enum umb_status umb_aliasing_at(const struct umb_map_frustum *frustum,
                                const struct umb_camera *camera, uint32_t width, uint32_t height,
                                const double world[3], const double normal[3],
                                struct umb_aliasing *aliasing)
{
    const double size[2] = {(double)width, (double)height};
    double n[3] = {normal[0], normal[1], normal[2]}, light[3], eye[3], distance = 0.0;
    double pixel[2][3], axes[2][3], a[2][2], b[2][2], m[2][2];
    struct umb__map_point point;
    struct umb__map_view view;
    memset(aliasing, 0, sizeof *aliasing);
    if (umb__map_view_make(camera, &view, NULL) != UMB_OK || !umb__unit(n) ||
        !pixel_gradients(&view, size, world, pixel, &distance) ||
        !umb__frustum_map(frustum, world, &point)) {
        return UMB_E_NOT_FOUND;
    }
    to_light(frustum, world, light);
    umb__subtract(camera->eye, world, eye);
    const double cos_a = umb__dot(n, eye) / distance, cos_b = umb__dot(n, light);
    if (!(cos_a > 0.0 && cos_b >= 0.0)) {
        return UMB_E_NOT_FOUND;
    }
    umb__across(n, axes[0], axes[1]);
    along_plane(point.gradient, axes, a);
    along_plane(pixel, axes, b);
    const double determinant = a[0][0] * a[1][1] - a[0][1] * a[1][0];
    /* Patches above 1e300 pixels count as infinite. */
    if (!(cos_b > 0.0 && fabs(determinant) > 1e-300)) {
        all_infinite(aliasing);
        return UMB_OK;
    }
    const double inverse[2][2] = {{a[1][1] / determinant, -a[0][1] / determinant},
                                  {-a[1][0] / determinant, a[0][0] / determinant}};
    for (int i = 0; i < 2; i++) {
        for (int k = 0; k < 2; k++) {
            m[i][k] = b[i][0] * inverse[0][k] + b[i][1] * inverse[1][k];
        }
    }
    singular_values(m, &aliasing->most, &aliasing->least);
    for (int k = 0; k < 2; k++) {
        aliasing->along[k] = hypot(m[0][k], m[1][k]);
    }
    const double pixels_a_metre =
        0.5 * sqrt(size[0] * size[1] / (view.tan_x * view.tan_y)) / distance;
    const double texels_a_metre =
        sqrt(umb__length(point.gradient[0]) * umb__length(point.gradient[1]));
    aliasing->perspective = pixels_a_metre / texels_a_metre;
    aliasing->projection = cos_a / cos_b;
    return UMB_OK;
}

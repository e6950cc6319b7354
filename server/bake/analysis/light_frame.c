/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The light's axes, its box, and the transform between world and voxels.
 */
#include "bake/analysis/light_frame.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/try.h"
#include "base/vec.h"
#include "tool/threads.h"

/* Triangles that a thread measures at a time. */
#define MEASURE_BLOCK ((size_t)1 << 15)

/* Computes sine and cosine of 0..45 degrees by series; the omitted terms are below 1e-19. */
static void small_sin_cos(double degrees, double *sine, double *cosine)
{
    const double x = degrees * 0.017453292519943295, square = x * x;
    double s = 0.0, c = 0.0;
    for (int n = 19; n >= 3; n -= 2) { /* Horner: 1 - x^2/(2*3) (1 - x^2/(4*5) (...)) */
        s = square / (double)(n * (n - 1)) * (1.0 - s);
        c = square / (double)((n - 1) * (n - 2)) * (1.0 - c);
    }
    *sine = x * (1.0 - s);
    *cosine = 1.0 - c;
}

void umbb_sin_cos_degrees(double degrees, double *sine, double *cosine)
{
    double angle = fmod(degrees, 360.0); /* exact */
    angle = angle < 0.0 ? angle + 360.0 : angle;
    const int quadrant = (int)(angle / 90.0) & 3;
    const double rest = fmin(fmax(angle - 90.0 * (int)(angle / 90.0), 0.0), 90.0);
    double s, c;
    if (rest <= 45.0) {
        small_sin_cos(rest, &s, &c);
    } else {
        small_sin_cos(90.0 - rest, &c, &s);
    }
    *sine = quadrant == 0 ? s : quadrant == 1 ? c : quadrant == 2 ? -s : -c;
    *cosine = quadrant == 0 ? c : quadrant == 1 ? -s : quadrant == 2 ? -c : s;
    *sine += 0.0; /* -0 becomes 0 */
    *cosine += 0.0;
}

void umbb_sun_direction(double azimuth_deg, double elevation_deg, int z_up, double direction[3])
{
    double sin_a, cos_a, sin_e, cos_e;
    umbb_sin_cos_degrees(azimuth_deg, &sin_a, &cos_a);
    umbb_sin_cos_degrees(elevation_deg, &sin_e, &cos_e);
    const double towards[3] = {sin_a * cos_e, cos_a * cos_e, sin_e};
    umbb_compass_direction(towards, z_up, direction);
}

void umbb_compass_direction(const double east_north_up[3], int z_up, double direction[3])
{
    const double east = east_north_up[0], north = east_north_up[1], up = east_north_up[2];
    direction[0] = -east + 0.0;
    direction[1] = (z_up ? -north : -up) + 0.0;
    direction[2] = (z_up ? -up : north) + 0.0;
    umbb_direction_normalise(direction);
}

static void cross(const double a[3], const double b[3], double out[3])
{
    for (int i = 0; i < 3; i++) {
        const int k = (i + 1) % 3, l = (i + 2) % 3;
        out[i] = a[k] * b[l] - a[l] * b[k];
        out[i] += 0.0; /* -0 becomes 0 */
    }
}

int umbb_direction_normalise(double direction[3])
{
    const double most = fmax(fmax(fabs(direction[0]), fabs(direction[1])), fabs(direction[2]));
    if (!(most > 1e-300) || !isfinite(most)) {
        return 0;
    }
    for (int i = 0; i < 3; i++) {
        direction[i] /= most;
    }
    const double length = sqrt(umb__dot(direction, direction));
    for (int i = 0; i < 3; i++) {
        direction[i] = direction[i] / length + 0.0;
    }
    return 1;
}

void umbb_light_axes(const double w[3], double axes[3][3])
{
    int least = 0;
    for (int i = 1; i < 3; i++) {
        least = fabs(w[i]) < fabs(w[least]) ? i : least;
    }
    double helper[3] = {0.0, 0.0, 0.0};
    helper[least] = 1.0;
    cross(helper, w, axes[0]);
    umbb_direction_normalise(axes[0]); /* its length is at least sqrt(2/3) */
    cross(w, axes[0], axes[1]);
    memcpy(axes[2], w, sizeof axes[2]);
}

enum umb_status umbb_world_check(const double (*corners)[3][3], size_t count,
                                 struct umb_error *error)
{
    for (size_t i = 0; i < count; i++) {
        for (int k = 0; k < 3; k++) {
            const double *p = corners[i][k];
            if (!(fabs(p[0]) <= UMBB_WORLD_MAX && fabs(p[1]) <= UMBB_WORLD_MAX &&
                  fabs(p[2]) <= UMBB_WORLD_MAX)) {
                return umb_fail(error, UMB_E_BAD_SCENE,
                                "scene: corner (%g, %g, %g) lies beyond %g metres", p[0], p[1],
                                p[2], UMBB_WORLD_MAX);
            }
        }
    }
    return UMB_OK;
}

/* Corners being measured along the axes of a light, in blocks. */
struct measuring {
    const struct umbb_fit *fit;
    double axes[3][3];
    struct umbb_extent (*extents)[3]; /* [blocks] */
};

/* Measures the extents of a block of corners along the three axes. Of equal values (zeros may
 * differ in sign) the first one is kept. */
static enum umb_status measure_block(void *user, size_t first, size_t count,
                                     struct umb_error *error)
{
    const struct measuring *m = user;
    struct umbb_extent extents[3];
    (void)error;
    for (int axis = 0; axis < 3; axis++) {
        extents[axis] = (struct umbb_extent){INFINITY, -INFINITY};
    }
    for (size_t i = first; i < first + count; i++) {
        for (int k = 0; k < 3; k++) {
            double at[3];
            umb__subtract(m->fit->corners[i][k], m->fit->origin, at);
            for (int axis = 0; axis < 3; axis++) {
                umbb_extent_add(&extents[axis], umb__dot(m->axes[axis], at));
            }
        }
    }
    memcpy(m->extents[first / MEASURE_BLOCK], extents, sizeof extents);
    return UMB_OK;
}

/* Measures all corners: block by block, then the blocks in order. */
static enum umb_status measure(const struct umbb_fit *fit, double axes[3][3],
                               struct umbb_extent extents[3], struct umb_error *error)
{
    const size_t blocks = fit->count / MEASURE_BLOCK + 1;
    struct measuring m = {.fit = fit, .extents = malloc(blocks * sizeof *m.extents)};
    if (m.extents == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "light frame: memory for %zu extents refused",
                        blocks);
    }
    memcpy(m.axes, axes, sizeof m.axes);
    const unsigned threads = fit->threads > 0 && blocks > 1 ? fit->threads : 1;
    const enum umb_status status =
        umbu_range_run(threads, fit->count, MEASURE_BLOCK, measure_block, &m, error);
    for (int axis = 0; axis < 3; axis++) {
        extents[axis] = (struct umbb_extent){INFINITY, -INFINITY};
        for (size_t i = 0; status == UMB_OK && i * MEASURE_BLOCK < fit->count; i++) {
            umbb_extent_add(&extents[axis], m.extents[i][axis].low);
            umbb_extent_add(&extents[axis], m.extents[i][axis].high);
        }
    }
    free(m.extents);
    return status;
}

double umbb_extent_scale(const struct umbb_extent *extent, double least, double size,
                         double *offset)
{
    const double scale = (size - 2.0) / fmax(extent->high - extent->low, least);
    *offset = 0.5 * size - 0.5 * (extent->low + extent->high) * scale;
    return scale;
}

enum umb_status umbb_light_frame_fit(const struct umbb_fit *fit, const double direction[3],
                                     struct umb_frustum_info *frustum, struct umb_error *error)
{
    memset(frustum, 0, sizeof *frustum);
    double axes[3][3];
    struct umbb_extent extents[3];
    umbb_light_axes(direction, axes);
    UMB__TRY(measure(fit, axes, extents, error));
    double most = 0.0;
    for (int axis = 0; axis < 3; axis++) {
        most = fmax(most, extents[axis].high - extents[axis].low);
    }
    if (!(most > 1e-9)) {
        return umb_fail(error, UMB_E_BAD_SCENE,
                        "scene: its extent of %g metres is below the least of 1e-9", most);
    }
    const double size = (double)((uint32_t)1 << fit->log2_size);
    frustum->log2_size = fit->log2_size;
    for (int axis = 0; axis < 3; axis++) {
        double *row = frustum->world_to_voxel[axis];
        const double scale =
            umbb_extent_scale(&extents[axis], most * UMBB_EXTENT_SHARE_MIN, size, &row[3]);
        for (int i = 0; i < 3; i++) {
            row[i] = axes[axis][i] * scale;
            frustum->voxel_step[axis][i] = axes[axis][i] / scale;
        }
    }
    frustum->world_to_voxel[3][3] = 1.0;
    return UMB_OK;
}

void umbb_light_frame_apply(const struct umb_frustum_info *frustum, const double origin[3],
                            double (*corners)[3][3], size_t count)
{
    const double(*m)[4] = frustum->world_to_voxel;
    for (size_t i = 0; i < count; i++) {
        for (int k = 0; k < 3; k++) {
            double *p = corners[i][k];
            const double x = p[0] - origin[0], y = p[1] - origin[1], z = p[2] - origin[2];
            for (int axis = 0; axis < 3; axis++) {
                p[axis] = m[axis][0] * x + m[axis][1] * y + m[axis][2] * z + m[axis][3];
            }
        }
    }
}

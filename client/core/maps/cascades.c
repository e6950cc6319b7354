/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Cascades: splits of a view, the frusta of their slices, queries and seams; see
 * umbrage/cascades.h.
 *
 * Light space in this file: u and v across the light, w along it, in metres from the scene's
 * centre. u and v depend on the light alone, so that the texel grid of UMB_CASCADE_SLICE is fixed
 * in the world. Only for LISPSM v is the direction of view, as seen from the light.
 */
#include "umbrage/cascades.h"

#include "base/reserved.h"
#include "base/try.h"
#include "maps/map_view.h"
#include "query/query_parts.h"

#define SINE_MIN 0.05 /* Sine of 3 degrees: LISPSM warps no view closer to the light than that */

/* Bounds of a camera's lengths, so that their squares stay finite and above 0. */
#define LENGTH_MIN      1e-30
#define LENGTH_MAX      1e30
#define TANGENT_MIN     1e-6
#define SLICES_AWAY_MAX 0x1p40 /* Slices from the scene: doubles hold 53 bits */

void umb_cascades_split(double near_m, double far_m, uint32_t count, double weight, double *splits)
{
    splits[0] = near_m;
    for (uint32_t i = 1; i < count; i++) {
        const double share = (double)i / (double)count;
        const double log_split = near_m * pow(far_m / near_m, share);
        splits[i] = weight * log_split + (1.0 - weight) * (near_m + (far_m - near_m) * share);
    }
    splits[count] = far_m;
}

/* An interval along an axis. */
struct extent {
    double low, high;
};

static void extent_add(struct extent *extent, double value)
{
    extent->low = fmin(extent->low, value);
    extent->high = fmax(extent->high, value);
}

/* The light's axes, the scene's extent along them, and the corners of one slice. */
struct fitting {
    double origin[3], axes[3][3];
    struct extent scene[3];
    double corners[8][3]; /* Corners of the slice, light space */
    struct extent slice[3];
    double centre[3], radius; /* Sphere around the slice, light space */
};

static void to_light_space(const struct fitting *fit, const double world[3], double out[3])
{
    double p[3];
    umb__subtract(world, fit->origin, p);
    for (int i = 0; i < 3; i++) {
        out[i] = umb__dot(fit->axes[i], p);
    }
}

static void scene_measure(struct fitting *fit, const struct umb_box *scene)
{
    for (int i = 0; i < 3; i++) {
        fit->scene[i] = (struct extent){INFINITY, -INFINITY};
    }
    for (int corner = 0; corner < 8; corner++) {
        double at[3];
        const double world[3] = {corner & 1 ? scene->max[0] : scene->min[0],
                                 corner & 2 ? scene->max[1] : scene->min[1],
                                 corner & 4 ? scene->max[2] : scene->min[2]};
        to_light_space(fit, world, at);
        for (int i = 0; i < 3; i++) {
            extent_add(&fit->scene[i], at[i]);
        }
    }
}

/*
 * Computes the corners of the slice, and a sphere around the slice. The sphere's radius depends on
 * the camera's lens only. The sphere's centre lies on the axis of view, as far from the near
 * corners as from the far ones, but not behind the far plane.
 */
static void slice_measure(struct fitting *fit, const struct umb__map_view *camera, double near_m,
                          double far_m)
{
    const double square = camera->tan_x * camera->tan_x + camera->tan_y * camera->tan_y;
    const double along = fmin(0.5 * (near_m + far_m) * (1.0 + square), far_m);
    double centre[3];
    for (int k = 0; k < 3; k++) {
        centre[k] = camera->eye[k] + along * camera->forward[k];
        fit->slice[k] = (struct extent){INFINITY, -INFINITY};
    }
    fit->radius = sqrt((far_m - along) * (far_m - along) + far_m * far_m * square);
    to_light_space(fit, centre, fit->centre);
    for (int corner = 0; corner < 8; corner++) {
        const double z = corner & 4 ? far_m : near_m;
        const double x = (corner & 1 ? z : -z) * camera->tan_x;
        const double y = (corner & 2 ? z : -z) * camera->tan_y;
        double world[3];
        for (int k = 0; k < 3; k++) {
            world[k] =
                camera->eye[k] + x * camera->right[k] + y * camera->up[k] + z * camera->forward[k];
        }
        to_light_space(fit, world, fit->corners[corner]);
        for (int i = 0; i < 3; i++) {
            extent_add(&fit->slice[i], fit->corners[corner][i]);
        }
    }
}

/* Checks that doubles resolve the slice's extent across the light. For an eye too far from the
 * scene, the extents become 0, and they are divisors. */
static enum umb_status slice_check(const struct fitting *fit, const struct umb__map_view *camera,
                                   uint32_t index, struct umb_error *error)
{
    for (int i = 0; i < 2; i++) {
        const struct extent *e = &fit->slice[i];
        const double away = fmax(fabs(e->low), fabs(e->high));
        if (!(e->high - e->low > away / SLICES_AWAY_MAX)) {
            return umb_fail(error, UMB_E_ARGUMENT,
                            "camera: eye (%g, %g, %g): slice %u is %g m across and %g m from the "
                            "scene's centre; the limit is 2^40 times its size",
                            camera->eye[0], camera->eye[1], camera->eye[2], index, e->high - e->low,
                            away);
        }
    }
    return UMB_OK;
}

/* Writes row `row` of world_to_map, which then gives scale . (u, v, w) + shift. */
static void row_set(struct umb_map_frustum *frustum, const struct fitting *fit, int row,
                    const double scale[3], double shift)
{
    for (int k = 0; k < 3; k++) {
        frustum->world_to_map[row][k] = 0.0;
        for (int i = 0; i < 3; i++) {
            frustum->world_to_map[row][k] += scale[i] * fit->axes[i][k];
        }
    }
    frustum->world_to_map[row][3] = shift;
}

/* Fits the depth range from the scene's near end to the far end of the slice's casters and
 * receivers, plus a thousandth on each side. */
static void depth_fit(struct umb_map_frustum *frustum, const struct fitting *fit)
{
    const double low = fit->scene[2].low;
    double high = fmin(fit->scene[2].high, fit->slice[2].high);
    high = high > low ? high : fit->scene[2].high; /* A slice before the scene takes all of it */
    const double spare = 1e-3 * fmax(high - low, 1e-3 * fit->radius);
    const double length = high - low + 2.0 * spare;
    const double scale[3] = {0.0, 0.0, 1.0 / length};
    row_set(frustum, fit, 2, scale, (spare - low) / length);
    frustum->depth_m = length;
}

/* Maps an extent across the light onto an axis, and leaves one texel on each side free. */
static void axis_fit(struct umb_map_frustum *frustum, const struct fitting *fit, int axis,
                     struct extent extent)
{
    const double texels = axis == 0 ? (double)frustum->width : (double)frustum->height;
    const double per_m = (texels - 2.0) / (extent.high - extent.low);
    double scale[3] = {0.0, 0.0, 0.0};
    scale[axis] = per_m;
    row_set(frustum, fit, axis, scale, 1.0 - extent.low * per_m);
}

static void slice_fit(struct umb_map_frustum *frustum, const struct fitting *fit)
{
    for (int axis = 0; axis < 2; axis++) {
        const double texels = axis == 0 ? (double)frustum->width : (double)frustum->height;
        /* The slice's low end is rounded down to whole texels, which takes one more texel. */
        const double texel_m = 2.0 * fit->radius / (texels - 3.0);
        const double low = floor((fit->centre[axis] - fit->radius) / texel_m) * texel_m;
        axis_fit(frustum, fit, axis, (struct extent){low, low + (texels - 2.0) * texel_m});
    }
}

/* Computes the part of the slice's extent along an axis that meets the scene; if no part does, the
 * slice's whole extent. */
static struct extent shared(const struct fitting *fit, int axis)
{
    struct extent e = {fmax(fit->slice[axis].low, fit->scene[axis].low),
                       fmin(fit->slice[axis].high, fit->scene[axis].high)};
    const double least = 1e-6 * fit->radius;
    return e.high - e.low > least ? e : fit->slice[axis];
}

/*
 * Fits a perspective along v whose centre lies n metres before the slice's low end v0. With q = v -
 * v0 + n, texel coordinates are x = w / 2 + b (u - u0) / q, where u0 is the eye's u, and y = c + e
 * / q. n = (z_n + sqrt(z_n z_f)) / sin(gamma) makes the aliasing at both ends of the slice equal:
 * z_n and z_f are the slice's splits, gamma is the angle between view and light.
 * Source: Wimmer, Scherzer, Purgathofer 2004, section 4.
 */
static void lispsm_fit(struct umb_map_frustum *frustum, const struct fitting *fit,
                       const struct umb__map_view *camera, const double splits[2])
{
    const double sine = umb__dot(fit->axes[1], camera->forward);
    const struct extent v = shared(fit, 1);
    const double n = (splits[0] + sqrt(splits[0] * splits[1])) / sine;
    const double d = v.high - v.low, w = (double)frustum->width, h = (double)frustum->height;
    double eye[3], widest = 0.0;
    to_light_space(fit, camera->eye, eye);
    for (int corner = 0; corner < 8; corner++) {
        const double at = fmin(fmax(fit->corners[corner][1], v.low), v.high);
        widest = fmax(widest, fabs(fit->corners[corner][0] - eye[0]) / (at - v.low + n));
    }
    const double b = 0.5 * (w - 2.0) / widest;
    const double e = -(h - 2.0) * n * (n + d) / d, c = 1.0 - e / n;
    const double q_shift = n - v.low; /* q = v + q_shift */
    const double x_scale[3] = {b, 0.5 * w, 0.0}, y_scale[3] = {0.0, c, 0.0};
    const double q_scale[3] = {0.0, 1.0, 0.0};
    row_set(frustum, fit, 0, x_scale, 0.5 * w * q_shift - b * eye[0]);
    row_set(frustum, fit, 1, y_scale, c * q_shift + e);
    row_set(frustum, fit, 3, q_scale, q_shift);
    frustum->projection = UMB_MAP_PERSPECTIVE;
}

/* Chooses u and v across the light so that v is the direction of view. Returns 0 if the view is too
 * close to the light's direction. */
static int axes_by_view(struct fitting *fit, const struct umb__map_view *camera)
{
    umb__cross(camera->forward, fit->axes[2], fit->axes[0]);
    if (umb__length(fit->axes[0]) < SINE_MIN) {
        return 0;
    }
    (void)umb__unit(fit->axes[0]);
    umb__cross(fit->axes[2], fit->axes[0], fit->axes[1]);
    return 1;
}

static enum umb_status camera_check(const struct umb__map_view *camera, struct umb_error *error)
{
    const double *axes[3] = {camera->right, camera->up, camera->forward};
    int ok = camera->tan_x >= TANGENT_MIN && camera->tan_y >= TANGENT_MIN && camera->tan_x < 1e3 &&
             camera->tan_y < 1e3;
    for (int i = 0; i < 3; i++) {
        ok = ok && fabs(camera->eye[i]) <= LENGTH_MAX &&
             fabs(umb__dot(axes[i], axes[i]) - 1.0) < 1e-6 &&
             fabs(umb__dot(axes[i], axes[(i + 1) % 3])) < 1e-6;
    }
    if (!ok) {
        return umb_fail(
            error, UMB_E_ARGUMENT,
            "camera: eye within 1e30 m, axes orthonormal, tangents from 1e-6 to below 1000");
    }
    if (!(camera->near_m >= LENGTH_MIN && camera->far_m > camera->near_m &&
          camera->far_m <= LENGTH_MAX)) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "camera: near %g, far %g; 1e-30 <= near < far <= 1e30", camera->near_m,
                        camera->far_m);
    }
    return UMB_OK;
}

static enum umb_status settings_check(const struct umb_cascade_settings *settings,
                                      struct umb_error *error)
{
    if (UMB__UNKNOWN(settings, "settings", error)) {
        return UMB_E_ARGUMENT;
    }
    if (settings->count < 1 || settings->count > UMB_CASCADES_MAX) {
        return umb_fail(error, UMB_E_ARGUMENT, "settings.count is %u; it must be 1..%d",
                        settings->count, UMB_CASCADES_MAX);
    }
    if (!(settings->weight >= 0.0 && settings->weight <= 1.0) ||
        !(settings->blend >= 0.0 && settings->blend <= 0.5)) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "settings: weight %g must be 0..1, blend %g must be 0..0.5",
                        settings->weight, settings->blend);
    }
    if ((unsigned)settings->fit > UMB_CASCADE_LISPSM) {
        return umb_fail(error, UMB_E_ARGUMENT, "settings.fit %d is unknown", (int)settings->fit);
    }
    for (uint32_t i = 0; i < settings->count; i++) {
        if (settings->resolution[i] < 4 || settings->resolution[i] > UMB_MAP_SIDE_MAX) {
            return umb_fail(error, UMB_E_ARGUMENT,
                            "settings.resolution[%u] is %u; it must be 4..%d", i,
                            settings->resolution[i], UMB_MAP_SIDE_MAX);
        }
    }
    return UMB_OK;
}

/* Sets the origin of light space and its axis w. Fails: E_ARGUMENT (a box without extent, a light
 * without direction). */
static enum umb_status light_space_make(struct fitting *fit, const double to_light[3],
                                        const struct umb_box *scene, struct umb_error *error)
{
    int ok = 1;
    double most = 0.0;
    for (int k = 0; k < 3; k++) {
        ok = ok && scene->min[k] <= scene->max[k] && isfinite(scene->max[k] - scene->min[k]);
        most = fmax(most, scene->max[k] - scene->min[k]);
        fit->origin[k] = 0.5 * scene->min[k] + 0.5 * scene->max[k];
        fit->axes[2][k] = -to_light[k];
    }
    if (!ok || !(most > 0.0) || !umb__unit(fit->axes[2])) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "the light needs a direction and the scene's box an extent");
    }
    return UMB_OK;
}

enum umb_status umb__cascades_plan(const struct umb__map_view *camera, const double to_light[3],
                                   const struct umb_box *scene,
                                   const struct umb_cascade_settings *settings,
                                   struct umb_cascade_plan *plan, struct umb_error *error)
{
    struct fitting fit;
    memset(plan, 0, sizeof *plan);
    UMB__TRY(camera_check(camera, error));
    UMB__TRY(settings_check(settings, error));
    UMB__TRY(light_space_make(&fit, to_light, scene, error));
    const int warp = settings->fit == UMB_CASCADE_LISPSM && axes_by_view(&fit, camera);
    if (!warp) {
        umb__across(fit.axes[2], fit.axes[0], fit.axes[1]);
    }
    scene_measure(&fit, scene);
    memcpy(plan->eye, camera->eye, sizeof plan->eye);
    memcpy(plan->forward, camera->forward, sizeof plan->forward);
    plan->count = settings->count;
    plan->blend = settings->blend;
    umb_cascades_split(camera->near_m, camera->far_m, settings->count, settings->weight,
                       plan->splits);
    for (uint32_t i = 0; i < settings->count; i++) {
        struct umb_map_frustum *frustum = &plan->frusta[i];
        *frustum = (struct umb_map_frustum){
            .width = settings->resolution[i], .height = settings->resolution[i], .directional = 1};
        memcpy(frustum->origin, fit.origin, sizeof frustum->origin);
        frustum->world_to_map[3][3] = 1.0;
        for (int k = 0; k < 3; k++) {
            frustum->light[k] = -fit.axes[2][k];
        }
        slice_measure(&fit, camera, plan->splits[i], plan->splits[i + 1]);
        UMB__TRY(slice_check(&fit, camera, i, error));
        depth_fit(frustum, &fit);
        plan->warped[i] = warp;
        if (warp) {
            lispsm_fit(frustum, &fit, camera, &plan->splits[i]);
        } else if (settings->fit == UMB_CASCADE_SLICE) {
            slice_fit(frustum, &fit);
        } else {
            axis_fit(frustum, &fit, 0, shared(&fit, 0));
            axis_fit(frustum, &fit, 1, shared(&fit, 1));
        }
    }
    return UMB_OK;
}

enum umb_status umb_cascades_plan(const struct umb_camera *camera, const double to_light[3],
                                  const struct umb_box *scene,
                                  const struct umb_cascade_settings *settings,
                                  struct umb_cascade_plan *plan, struct umb_error *error)
{
    struct umb__map_view view;
    memset(plan, 0, sizeof *plan);
    UMB__TRY(umb__map_view_make(camera, &view, error));
    return umb__cascades_plan(&view, to_light, scene, settings, plan, error);
}

/* Returns a point's distance along the view, metres. */
static double view_depth(const struct umb_cascade_plan *plan, const struct umb_points *points,
                         size_t index)
{
    double p[3];
    for (unsigned k = 0; k < 3; k++) {
        p[k] = points->origin[k] - plan->eye[k] + umb__coordinate(points, index, k);
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
    double low = -10.0, high = 10.0, value[2] = {0.0, 0.0};
    double at[2] = {high - golden * (high - low), low + golden * (high - low)};
    UMB__TRY(umb_map_prepare(seam->fine, &seam->fine_filter, &query, error));
    umb_map_run(&query, points, 0, points->count, scratch);
    seam->contrast = 1.0;
    enum umb_status status = seam_difference(seam, 1.0, points, scratch, &seam->difference, error);
    seam->after = seam->difference;
    /* A step compares the differences at two places. The first step computes both. A later step
     * computes one; the other is known from the step before. */
    for (int step = 0, k = 1; step < 22 && status == UMB_OK; step++) {
        status = seam_difference(seam, exp2(at[k]), points, scratch, &value[k], error);
        if (status == UMB_OK && value[k] < seam->after) {
            seam->after = value[k];
            seam->contrast = exp2(at[k]);
        }
        if (step == 0) {
            k = 0;
        } else if (value[0] <= value[1]) {
            high = at[1];
            at[1] = at[0];
            value[1] = value[0];
            k = 0;
            at[0] = high - golden * (high - low);
        } else {
            low = at[0];
            at[0] = at[1];
            value[0] = value[1];
            k = 1;
            at[1] = low + golden * (high - low);
        }
    }
    return status;
}

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Pinhole cameras: parsing, fitting, rays.
 *
 * Fitting is exact, not iterative: with the view's axes fixed, a point at (x, z) in the camera's
 * plane is inside the side planes if |x - ex| <= (z - ez) t. The two planes are tight for A = max(x
 * - z t) and B = max(-x - z t), so the nearest eye that sees everything has ex = (A - B) / 2 and ez
 * = -(A + B) / (2 t); the same holds for y, and the farther of the two eyes is taken.
 */
#include "study/camera.h"

#include <math.h>
#include <string.h>
#include "base/try.h"
#include "study/study_math.h"
#include "tool/keys.h"

#define PI              3.14159265358979323846
#define DEFAULT_FOV     35.0
#define DEFAULT_TURN    80.0 /* degrees to either side of the sun's azimuth */
#define DEFAULT_ABOVE   35.0
#define DEFAULT_AZIMUTH 215.0 /* degrees, for a sun straight overhead */
#define FOV_MIN         1.0
#define FOV_MAX         150.0
#define COORDINATE_MAX  1e12
#define FIT_MARGIN      1.04
#define VERTICAL_SINE   0.99985 /* cosine of 1 degree */

static enum umb_status request_check(const struct umbt_camera_request *request, bool has_fov,
                                     struct umb_error *error)
{
    if (has_fov && (request->fov_deg < FOV_MIN || request->fov_deg > FOV_MAX)) {
        return umb_fail(error, UMB_E_ARGUMENT, "--camera: fov=%g is not from %g to %g degrees",
                        request->fov_deg, FOV_MIN, FOV_MAX);
    }
    if (request->has_elevation && fabs(request->elevation_deg) > 90.0) {
        return umb_fail(error, UMB_E_ARGUMENT, "--camera: el=%g is not from -90 to 90 degrees",
                        request->elevation_deg);
    }
    if (request->has_eye && (request->has_azimuth || request->has_elevation)) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "--camera: eye= places the camera, az= and el= fit it; give one of both");
    }
    if (request->has_target && !request->has_eye) {
        return umb_fail(error, UMB_E_ARGUMENT, "--camera: target= needs eye=");
    }
    if (request->has_target && memcmp(request->eye, request->target, sizeof request->eye) == 0) {
        return umb_fail(error, UMB_E_ARGUMENT, "--camera: eye and target are the same point");
    }
    return UMB_OK;
}

enum umb_status umbt_camera_parse(const char *text, struct umbt_camera_request *request,
                                  struct umb_error *error)
{
    struct umbt_camera_request parsed = {0};
    bool has_fov = false;
    const struct umbu_key keys[] = {
        {"eye", &parsed.has_eye, parsed.eye, 3, COORDINATE_MAX},
        {"target", &parsed.has_target, parsed.target, 3, COORDINATE_MAX},
        {"fov", &has_fov, &parsed.fov_deg, 1, FOV_MAX},
        {"az", &parsed.has_azimuth, &parsed.azimuth_deg, 1, 360.0},
        {"el", &parsed.has_elevation, &parsed.elevation_deg, 1, 90.0},
    };
    UMB__TRY(umbu_read_keys("--camera", text, "eye=X,Y,Z target=X,Y,Z fov=DEG az=DEG el=DEG", keys,
                            sizeof keys / sizeof keys[0], error));
    UMB__TRY(request_check(&parsed, has_fov, error));
    *request = parsed;
    return UMB_OK;
}

void umbt_compass_vector(double azimuth_deg, double elevation_deg, int z_up, double out[3])
{
    const double azimuth = azimuth_deg * (PI / 180.0);
    const double elevation = elevation_deg * (PI / 180.0);
    const double east = sin(azimuth) * cos(elevation);
    const double north = cos(azimuth) * cos(elevation);
    const double above = sin(elevation);
    out[0] = east;
    out[1] = z_up ? north : above;
    out[2] = z_up ? above : -north;
}

double umbt_compass_azimuth(const double direction[3], int z_up, double otherwise)
{
    const double above = z_up ? direction[2] : direction[1];
    const double north = z_up ? direction[1] : -direction[2];
    if (!(fabs(above) < VERTICAL_SINE * umb__length(direction))) {
        return otherwise;
    }
    const double degrees = atan2(direction[0], north) * (180.0 / PI);
    return degrees < 0.0 ? degrees + 360.0 : degrees;
}

/* Computes right and up from forward, so that the picture stands upright. In a view straight up or
 * down, north is at the top. */
static void axes_make(struct umbt_camera *camera, int z_up)
{
    double vertical[3] = {0.0, z_up ? 0.0 : 1.0, z_up ? 1.0 : 0.0};
    if (fabs(umb__dot(vertical, camera->forward)) > 0.999999) {
        umbt_compass_vector(0.0, 0.0, z_up, vertical);
    }
    umb__cross(camera->forward, vertical, camera->right);
    (void)umbt_normalize(camera->right);
    umb__cross(camera->right, camera->forward, camera->up);
    (void)umbt_normalize(camera->up);
}

/* Places the eye and returns its distance from the centre, in metres along the view. */
static double eye_fit(const struct umbt_camera_subject *subject, const double centre[3],
                      struct umbt_camera *camera)
{
    const double tan_xy[2] = {camera->tan_x / FIT_MARGIN, camera->tan_y / FIT_MARGIN};
    const double *const across[2] = {camera->right, camera->up};
    double high[2] = {-INFINITY, -INFINITY}, low[2] = {-INFINITY, -INFINITY};
    double size = 0.0, nearest = INFINITY;
    for (size_t i = 0; i < subject->count; i++) {
        double p[3];
        umb__subtract(subject->points[i], centre, p);
        const double z = umb__dot(p, camera->forward);
        for (int k = 0; k < 2; k++) {
            const double x = umb__dot(p, across[k]);
            high[k] = fmax(high[k], x - z * tan_xy[k]);
            low[k] = fmax(low[k], -x - z * tan_xy[k]);
        }
        nearest = fmin(nearest, z);
        size = fmax(size, umb__dot(p, p));
    }
    double back =
        fmin(-(high[0] + low[0]) / (2.0 * tan_xy[0]), -(high[1] + low[1]) / (2.0 * tan_xy[1]));
    /* Keeps the eye at a least distance: for a single point, or points in a line along the view, it
     * would otherwise lie on a point. */
    back = fmin(back, nearest - fmax(1e-3 * sqrt(size), 1e-6));
    umbt_along(centre, back, camera->forward, camera->eye);
    for (int k = 0; k < 2; k++) {
        umbt_along(camera->eye, (high[k] - low[k]) / 2.0, across[k], camera->eye);
    }
    return -back;
}

static double compass_fit(const struct umbt_camera_subject *subject, const double centre[3],
                          double azimuth_deg, double elevation_deg, struct umbt_camera *camera)
{
    double outwards[3];
    umbt_compass_vector(azimuth_deg, elevation_deg, subject->z_up, outwards);
    for (int k = 0; k < 3; k++) {
        camera->forward[k] = -outwards[k];
    }
    (void)umbt_normalize(camera->forward);
    axes_make(camera, subject->z_up);
    return eye_fit(subject, centre, camera);
}

double umbt_camera_fov_deg(const struct umbt_camera *camera)
{
    return atan(camera->tan_y) * (360.0 / PI);
}

struct umb_camera umbt_camera_view(const struct umbt_camera *camera, double near_m, double far_m)
{
    struct umb_camera view = {.fov_y = 2.0 * atan(camera->tan_y),
                              .aspect = camera->tan_x / camera->tan_y,
                              .near_m = near_m,
                              .far_m = far_m};
    memcpy(view.eye, camera->eye, sizeof view.eye);
    memcpy(view.forward, camera->forward, sizeof view.forward);
    memcpy(view.up, camera->up, sizeof view.up);
    return view;
}

enum umb_status umbt_camera_make(const struct umbt_camera_request *request,
                                 const struct umbt_camera_subject *subject, uint32_t width,
                                 uint32_t height, struct umbt_camera *camera,
                                 struct umb_error *error)
{
    const double fov = request->fov_deg > 0.0 ? request->fov_deg : DEFAULT_FOV;
    double centre[3];
    for (int k = 0; k < 3; k++) {
        centre[k] = 0.5 * (subject->box.min[k] + subject->box.max[k]);
    }
    camera->tan_y = tan(fov * (PI / 360.0));
    camera->tan_x = camera->tan_y * (double)width / (double)height;
    if (request->has_eye) {
        memcpy(camera->eye, request->eye, sizeof camera->eye);
        umb__subtract(request->has_target ? request->target : centre, request->eye,
                      camera->forward);
        if (!(umbt_normalize(camera->forward) > 0.0)) {
            return umb_fail(error, UMB_E_ARGUMENT,
                            "--camera: eye is at the scene's centre; give target= as well");
        }
        axes_make(camera, subject->z_up);
        return UMB_OK;
    }
    const double elevation = request->has_elevation ? request->elevation_deg : DEFAULT_ABOVE;
    if (request->has_azimuth) {
        (void)compass_fit(subject, centre, request->azimuth_deg, elevation, camera);
        return UMB_OK;
    }
    const double sun =
        umbt_compass_azimuth(subject->to_light, subject->z_up, DEFAULT_AZIMUTH - DEFAULT_TURN);
    struct umbt_camera other = *camera;
    const double clockwise = compass_fit(subject, centre, sun + DEFAULT_TURN, elevation, camera);
    if (compass_fit(subject, centre, sun - DEFAULT_TURN, elevation, &other) < clockwise) {
        *camera = other;
    }
    return UMB_OK;
}

void umbt_camera_ray(const struct umbt_camera *camera, double u, double v, double direction[3])
{
    umbt_along(camera->forward, (2.0 * u - 1.0) * camera->tan_x, camera->right, direction);
    umbt_along(direction, (1.0 - 2.0 * v) * camera->tan_y, camera->up, direction);
    (void)umbt_normalize(direction);
}

double umbt_camera_depth(const struct umbt_camera *camera, const double position[3])
{
    double from_eye[3];
    umb__subtract(position, camera->eye, from_eye);
    return umb__dot(from_eye, camera->forward);
}

/* SPDX-License-Identifier: Apache-2.0 */
/* Texels and pixels: compared with Lloyd's formula, Stamminger's formula, finite differences, and
 * the grazing limit. */
#include "maps_fixture.h"
#include "maps/map_receiver.h"
#include "base/vec.h"
#include "umbrage/aliasing.h"

enum {
    PIXELS_X = 640,
    PIXELS_Y = 480,
    TEXELS = 512
};

/* A camera that looks along +y with z up. */
static struct umb_camera camera_at(double y, double z)
{
    return (struct umb_camera){.eye = {0, y, z},
                               .forward = {0, 3, 0},
                               .up = {0, 0, 2},
                               .fov_y = 0.85,
                               .aspect = 4.0 / 3.0};
}

/*
 * Computes Lloyd's m in the plane x = 0, where the surface, the light's rays and the eye's rays all
 * lie: the ratio of the widths of the light's and the eye's beam on the surface. Long double.
 */
static long double lloyd(const struct umb_camera *camera, const double light[3], double tangent,
                         const double point[3], const double normal[3])
{
    const long double ly = (long double)(point[1] - light[1]),
                      lz = (long double)(point[2] - light[2]);
    const long double ey = (long double)(point[1] - camera->eye[1]);
    const long double ez = (long double)(point[2] - camera->eye[2]);
    const long double l = hypotl(ly, lz), e = hypotl(ey, ez);
    /* The light looks down: its image plane is across -z; the eye's is across +y. */
    const long double d_l = -lz, d_e = ey;
    const long double cos_phi_l = d_l / l, cos_phi_e = d_e / e;
    const long double cos_psi_l =
        fabsl((long double)normal[1] * ly + (long double)normal[2] * lz) / l;
    const long double cos_psi_e =
        fabsl((long double)normal[1] * ey + (long double)normal[2] * ez) / e;
    const long double w_l = 2.0L * (long double)tangent,
                      w_e = 2.0L * (long double)tan(camera->fov_y / 2);
    const long double r_t = TEXELS, r_j = PIXELS_Y; /* n_l = n_e = 1 */
    return r_j / r_t * (w_l * d_l * cos_phi_l) / (w_e * d_e * cos_phi_e) * cos_psi_e / cos_psi_l;
}

static void a_step_of_one_texel_is_lloyds_m(void **state)
{
    (void)state;
    uint64_t seed = 2007;
    long double worst = 0.0L;
    int seen = 0;
    print_message("seed 2007\n");
    for (int i = 0; i < 1000000; i++) {
        const struct umb_camera camera =
            camera_at(-5.0 * random_unit(&seed), 1.0 + 5.0 * random_unit(&seed));
        const struct umb_map_spot spot = {.position = {0, 20 * random_unit(&seed), 20},
                                          .forward = {0, 0, -1},
                                          .up = {0, 1, 0},
                                          .tangent = 0.3 + random_unit(&seed),
                                          .near_m = 1,
                                          .far_m = 30,
                                          .projection = UMB_MAP_PERSPECTIVE};
        const double point[3] = {0, 0.5 + 20 * random_unit(&seed), random_unit(&seed)};
        const double tilt = (random_unit(&seed) - 0.5) * 3.1;
        const double normal[3] = {0, sin(tilt), cos(tilt)};
        struct umb_map_frustum frustum;
        struct umb_aliasing a;
        assert_int_equal(umb_map_frustum_spot(&spot, TEXELS, TEXELS, &frustum, NULL), UMB_OK);
        if (umb_aliasing_at(&frustum, &camera, PIXELS_X, PIXELS_Y, point, normal, &a) != UMB_OK) {
            continue;
        }
        const long double m = lloyd(&camera, spot.position, spot.tangent, point, normal);
        long double cosine = 1.0L; /* the smaller of the light's and the eye's */
        const double from[2][2] = {{spot.position[1], spot.position[2]},
                                   {camera.eye[1], camera.eye[2]}};
        for (int k = 0; k < 2; k++) {
            const long double y = (long double)from[k][0] - (long double)point[1];
            const long double z = (long double)from[k][1] - (long double)point[2];
            cosine = fminl(cosine, fabsl((long double)normal[1] * y + (long double)normal[2] * z) /
                                       hypotl(y, z));
        }
        const long double error = fabsl((long double)a.along[1] - m) / m * cosine;
        worst = error > worst ? error : worst;
        seen++;
    }
    print_message("%d points, worst relative error times cosine %Lg\n", seen, worst);
    assert_true(seen > 300000);
    /* A dozen roundings; where the ray grazes, the cosines cancel, hence the factor: 14 ulp. */
    assert_true(worst < 3e-15L);
}

/* A horizontal light's-eye view from straight above: dp/ds = 1/z dz/ds cos a / cos b. */
static void under_a_light_from_above_it_is_the_simplified_formula(void **state)
{
    (void)state;
    const struct umb_camera camera = camera_at(0.0, 2.0);
    const struct umb_box ground = {{-50, 0, -1}, {50, 100, 1}};
    const double to_light[3] = {0, 0, 1};
    struct umb_map_frustum frustum;
    assert_int_equal(umb_map_frustum_fit(to_light, &ground, TEXELS, TEXELS, &frustum, NULL),
                     UMB_OK);
    for (double y = 3.0; y < 90.0; y *= 1.3) {
        const double point[3] = {0, y, 0}, normal[3] = {0, 0, 1};
        struct umb_aliasing a;
        assert_int_equal(umb_aliasing_at(&frustum, &camera, PIXELS_X, PIXELS_Y, point, normal, &a),
                         UMB_OK);
        /* A texel is 100 m / 510 deep. On the ground 2 m below the eye, dv/dy = f 2 / y^2 pixels;
         * dp/ds takes the distance r along the ray for y, and cos a = 2 / r. */
        const double texel_m = 100.0 / 510.0, f = 0.5 * PIXELS_Y / tan(camera.fov_y / 2),
                     r = hypot(y, 2.0);
        const double exact = texel_m * f * 2.0 / (y * y);
        const double along = fmin(a.along[0], a.along[1]); /* the axis that lies along the view */
        assert_true(fabs(along - exact) < 1e-9 * exact);
        const double simple = texel_m * f / r * (2.0 / r);
        assert_true(fabs(a.perspective * a.projection - simple) < 1e-9 * simple);
    }
}

/* For any frustum, camera and plane: the patch of a texel, found on the surface by differences. */
static void patches_equal_finite_differences(void **state)
{
    (void)state;
    uint64_t seed = 17;
    for (int i = 0; i < case_count(20000); i++) {
        struct umb_camera camera = camera_at(-3.0, 4.0);
        const double tan_y = tan(camera.fov_y / 2), tan_x = tan_y * camera.aspect;
        camera.near_m = 0.1;
        camera.far_m = 100;
        const struct umb_box box = {{-20, -10, 0}, {20, 30, 8}};
        double to_light[3] = {random_unit(&seed) - 0.5, random_unit(&seed) - 0.5, 0.4};
        struct umb_cascade_plan plan;
        struct umb_cascade_settings settings = {
            .count = 1, .weight = 1, .fit = (enum umb_cascade_fit)(i % 3), .resolution = {TEXELS}};
        assert_int_equal(umb_cascades_plan(&camera, to_light, &box, &settings, &plan, NULL),
                         UMB_OK);
        const double world[3] = {random_unit(&seed) * 4 - 2, 2 + 10 * random_unit(&seed),
                                 2 * random_unit(&seed)};
        double n[3] = {random_unit(&seed) - 0.5, random_unit(&seed) - 0.9,
                       0.5 + random_unit(&seed)};
        struct umb_aliasing a;
        assert_true(umb__unit(n));
        if (umb_aliasing_at(&plan.frusta[0], &camera, PIXELS_X, PIXELS_Y, world, n, &a) != UMB_OK ||
            a.most > 1e4) {
            continue;
        }
        /* The texel's x axis on the surface: the light rays of texels to the left and right are
         * followed to the plane. */
        double pixels[2][2];
        struct umb__map_point here;
        assert_true(umb__frustum_map(&plan.frusta[0], world, &here));
        for (int side = 0; side < 2; side++) {
            const double step = side == 0 ? -1e-4 : 1e-4;
            double p0[3], p1[3], hit[3], d[3], to[3];
            assert_int_equal(
                umb_map_frustum_point(&plan.frusta[0], here.at[0] + step, here.at[1], 0, p0),
                UMB_OK);
            assert_int_equal(
                umb_map_frustum_point(&plan.frusta[0], here.at[0] + step, here.at[1], 1, p1),
                UMB_OK);
            umb__subtract(p1, p0, d);
            umb__subtract(world, p0, to);
            const double t = umb__dot(n, to) / umb__dot(n, d);
            for (int k = 0; k < 3; k++) {
                hit[k] = p0[k] + t * d[k] - camera.eye[k];
            }
            const double z = hit[1]; /* the camera looks along +y with z up */
            pixels[side][0] = 0.5 * PIXELS_X * hit[0] / (z * tan_x);
            pixels[side][1] = 0.5 * PIXELS_Y * hit[2] / (z * tan_y);
        }
        const double m = hypot(pixels[1][0] - pixels[0][0], pixels[1][1] - pixels[0][1]) / 2e-4;
        if (!(fabs(a.along[0] - m) <= 1e-4 * (m + 1e-3))) {
            fail_msg("fit %d: %g, not %g", i % 3, a.along[0], m);
        }
        assert_true(a.most >= a.along[0] * (1 - 1e-12) && a.least <= a.along[0] * (1 + 1e-12));
    }
}

static void a_grazing_light_is_infinite_and_nothing_is_nan(void **state)
{
    (void)state;
    const struct umb_camera camera = camera_at(0.0, 2.0);
    const struct umb_box box = {{-50, 0, -1}, {50, 100, 1}};
    const double point[3] = {0, 10, 0};
    double before = 0.0;
    for (double degrees = 10.0; degrees > 1e-9; degrees *= 0.1) {
        const double angle = degrees * 3.14159265358979 / 180.0;
        const double to_light[3] = {cos(angle), 0, sin(angle)}, up[3] = {0, 0, 1};
        struct umb_map_frustum frustum;
        struct umb_aliasing a;
        assert_int_equal(umb_map_frustum_fit(to_light, &box, TEXELS, TEXELS, &frustum, NULL),
                         UMB_OK);
        assert_int_equal(umb_aliasing_at(&frustum, &camera, PIXELS_X, PIXELS_Y, point, up, &a),
                         UMB_OK);
        assert_true(a.most > before && !isnan(a.least));
        before = a.projection;
    }
    const double to_light[3] = {1, 0, 0}, up[3] = {0, 0, 1}, down[3] = {0, 0, -1};
    struct umb_map_frustum frustum;
    struct umb_aliasing a;
    assert_int_equal(umb_map_frustum_fit(to_light, &box, TEXELS, TEXELS, &frustum, NULL), UMB_OK);
    assert_int_equal(umb_aliasing_at(&frustum, &camera, PIXELS_X, PIXELS_Y, point, up, &a), UMB_OK);
    assert_true(isinf(a.most) && isinf(a.along[0]) && isinf(a.projection));
    assert_int_equal(umb_aliasing_at(&frustum, &camera, PIXELS_X, PIXELS_Y, point, down, &a),
                     UMB_E_NOT_FOUND);
    const double behind[3] = {0, -10, 0};
    assert_int_equal(umb_aliasing_at(&frustum, &camera, PIXELS_X, PIXELS_Y, behind, up, &a),
                     UMB_E_NOT_FOUND);
    assert_true(a.most == 0.0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_step_of_one_texel_is_lloyds_m),
        cmocka_unit_test(under_a_light_from_above_it_is_the_simplified_formula),
        cmocka_unit_test(patches_equal_finite_differences),
        cmocka_unit_test(a_grazing_light_is_infinite_and_nothing_is_nan),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

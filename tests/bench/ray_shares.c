/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Judges points by rays: does a ray from the surface reach the sun?
 *
 *     ray_shares SCENE X,Y,Z <POINTS >ANSWERS
 *
 * X,Y,Z: direction to the sun. POINTS: six floats a point, place and unit normal. ANSWERS: a byte a
 * point: 1 lit, 0 shadowed, 2 not judged, because the surface does not face the sun by more than
 * UMBT_JUDGED_FACING.
 */
#include <stdio.h>
#include <stdlib.h>

#include "base/vec.h"
#include "study/study_math.h"
#include "study/study_picture.h"
#include "study/study_scene.h"

static int judge(const struct umbt_scene *scene, const double to_light[3], const float point[6])
{
    double place[3], normal[3], start[3];
    umbt_widen(point, place);
    umbt_widen(point + 3, normal);
    if (!umbt_normalize(normal) || !(umb__dot(normal, to_light) > UMBT_JUDGED_FACING)) {
        return 2;
    }
    umbt_along(place, 2e-6 * scene->diagonal_m, normal, start);
    return !umbr_occluded(scene->rays, start, to_light, 0, 2 * scene->diagonal_m);
}

int main(int argc, char **argv)
{
    static struct umbt_scene scene;
    struct umb_error error;
    double to_light[3];
    float point[6];
    if (argc != 3 ||
        sscanf(argv[2], "%lf,%lf,%lf", &to_light[0], &to_light[1], &to_light[2]) != 3 ||
        !umbt_normalize(to_light)) {
        (void)fprintf(stderr, "usage: ray_shares SCENE X,Y,Z <POINTS >ANSWERS\n");
        return 2;
    }
    if (umbt_scene_init(&scene, argv[1], 0, &error) != UMB_OK) {
        (void)fprintf(stderr, "ray_shares: %s\n", error.message);
        return 1;
    }
    while (fread(point, sizeof point, 1, stdin) == 1) {
        (void)putchar(judge(&scene, to_light, point));
    }
    umbt_scene_finish(&scene);
    return ferror(stdin) != 0 || fflush(stdout) != 0;
}

/* SPDX-License-Identifier: Apache-2.0 */
/* Search for surfaces too near to a lamp. A test of bounding boxes excludes nearly all triangles.
 * Each remaining triangle is cut to the face, and its distance is computed. */
#include "bake/analysis/frusta.h"

#include <math.h>
#include <string.h>

#include "base/vec.h"
#include "bake/analysis/eye_clip.h"

/* Returns 1 if a triangle's box comes within `reach` of the position on all axes. */
static int is_near(const double corners[3][3], const double position[3], double reach)
{
    for (int k = 0; k < 3; k++) {
        const double a = corners[0][k] - position[k], b = corners[1][k] - position[k];
        const double c = corners[2][k] - position[k];
        if (fmin(fmin(a, b), c) > reach || fmax(fmax(a, b), c) < -reach) {
            return 0;
        }
    }
    return 1;
}

/* Point of segment a, b nearest to the origin. */
static void nearest_on_edge(const double a[3], const double b[3], double out[3])
{
    double way[3];
    umb__subtract(b, a, way);
    const double length = umb__dot(way, way);
    const double share = length > 0 ? fmin(fmax(-umb__dot(a, way) / length, 0), 1) : 0;
    for (int k = 0; k < 3; k++) {
        out[k] = a[k] + share * way[k];
    }
}

/* Computes the point of a triangle nearest to the origin: the foot point if it is inside, else a
 * point of an edge. normal: of unit length. */
static void nearest_place(const double at[3][3], const double normal[3], double out[3])
{
    const double height = umb__dot(normal, at[0]);
    int inside = 1;
    double least = INFINITY;
    for (int i = 0; i < 3; i++) {
        const double *a = at[i], *b = at[(i + 1) % 3];
        double way[3], from[3], across[3], place[3];
        for (int k = 0; k < 3; k++) {
            way[k] = b[k] - a[k];
            from[k] = height * normal[k] - a[k];
        }
        umb__cross(way, from, across);
        inside &= umb__dot(across, normal) >= 0;
        nearest_on_edge(a, b, place);
        if (umb__length(place) < least) {
            least = umb__length(place);
            memcpy(out, place, sizeof place);
        }
    }
    for (int k = 0; inside && k < 3; k++) {
        out[k] = height * normal[k];
    }
}

/* Returns 1 if part of a triangle lies in the face, nearer than `near` along the face's axis. */
static int is_cut_away(const double at[3][3], const struct umbb_eye *eye, double tangent,
                       double near)
{
    const struct umbb_pyramid pyramid = {.low = {-tangent, -tangent}, .high = {tangent, tangent}};
    struct umbb_polygon polygon;
    double turned[3][3], least = INFINITY;
    for (int i = 0; i < 3; i++) {
        for (int axis = 0; axis < 3; axis++) {
            turned[i][axis] = umb__dot(eye->axes[axis], at[i]);
        }
    }
    umbb_eye_clip(&pyramid, (const double(*)[3])turned, &polygon);
    for (size_t i = 0; i < polygon.count; i++) {
        least = fmin(least, polygon.corners[i][2]);
    }
    return least < near;
}

/* Greatest coordinate of a lamp and a triangle, relative to the origin. */
static double greatest(const double position[3], const double corners[3][3], const double origin[3])
{
    double most = 0;
    for (int k = 0; k < 3; k++) {
        most = fmax(most, fabs(position[k] - origin[k]));
        for (int i = 0; i < 3; i++) {
            most = fmax(most, fabs(corners[i][k] - origin[k]));
        }
    }
    return most;
}

/* Returns 1 if light would pass through a triangle whose box is near the light. near: near distance
 * of the face. tangent: greatest |u| / W of the face, guard band included. */
static int judge(const double corners[3][3], const double origin[3], const struct umbb_eye *eye,
                 double near, double tangent, struct umbb_contact *contact)
{
    double at[3][3], normal[3], place[3];
    for (int i = 0; i < 3; i++) {
        umb__subtract(corners[i], eye->position, at[i]);
    }
    umb__triangle_cross((const double(*)[3])at, normal);
    if (!umb__unit(normal)) {
        return 0;
    }
    nearest_place((const double(*)[3])at, normal, place);
    contact->distance = umb__length(place);
    for (int k = 0; k < 3; k++) {
        contact->at[k] = eye->position[k] + place[k];
    }
    if (contact->distance <= UMBB_ON_SHARE * greatest(eye->position, corners, origin)) {
        contact->distance = 0;
        return eye->direction == NULL ||
               fabs(umb__dot(eye->direction, normal)) < eye->cone_sine - 1e-9;
    }
    return is_cut_away((const double(*)[3])at, eye, tangent, near);
}

int umbb_lamp_contact(const struct umbb_fit *fit, const struct umbb_eye *eye,
                      struct umbb_contact *contact)
{
    const double tangent = umbb_guarded_tangent(eye->tangent, fit->log2_size);
    const double near = eye->reach * UMBB_NEAR_SHARE;
    const double reach = near * sqrt(1 + 2 * tangent * tangent);
    int found = 0;
    for (size_t i = 0; i < fit->count; i++) {
        struct umbb_contact one;
        if (is_near(fit->corners[i], eye->position, reach) &&
            judge(fit->corners[i], fit->origin, eye, near, tangent, &one) &&
            (!found || one.distance < contact->distance)) {
            *contact = one;
            found = 1;
        }
    }
    return found;
}

/* SPDX-License-Identifier: Apache-2.0 */
/* Choosing the faces of each light. */
#include "bake/analysis/frusta.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "bake/analysis/light_frame.h"
#include "bake/analysis/perspective_frame.h"
#include "base/try.h"

#define DEG_A_RAD 57.29577951308232

/* The frusta made so far, and the light being added. */
struct list {
    const struct umbb_frusta_input *input;
    struct umb_frustum_info *frusta; /* [6 * lights] */
    uint32_t count;
    double voxel_min;            /* least voxel size of spot and point lights, metres */
    struct umbb_contact contact; /* nearest contact of all the light's faces */
    int has_contact;
};

double umbb_light_reach(const struct umb_box *bounds, const double position[3])
{
    double square = 0.0;
    for (int axis = 0; axis < 3; axis++) {
        const double far = fmax(fabs(bounds->min[axis] - position[axis]),
                                fabs(bounds->max[axis] - position[axis]));
        square += far * far;
    }
    return sqrt(square);
}

/* Least size of voxels, metres. */
static double least_voxel(const struct umb_box *bounds)
{
    double half = 0.0;
    for (int axis = 0; axis < 3; axis++) {
        half = fmax(half, 0.5 * bounds->max[axis] - 0.5 * bounds->min[axis]);
    }
    return half * UMBB_VOXEL_SHARE;
}

/* Appends a fitted frustum of a light. */
static void append(struct list *list, uint32_t light, const struct umb_frustum_info *fitted)
{
    struct umb_frustum_info *frustum = &list->frusta[list->count++];
    *frustum = *fitted;
    frustum->light = light;
    frustum->closed = list->input->closed;
}

/* Records the surface that is too near to a face's light, if there is one. */
static void look_for_contact(struct list *list, const struct umbb_eye *eye)
{
    struct umbb_contact contact;
    if (umbb_lamp_contact(&list->input->fit, eye, &contact) &&
        (!list->has_contact || contact.distance < list->contact.distance)) {
        list->contact = contact;
        list->has_contact = 1;
    }
}

/* Refuses a lamp whose light would pass through a surface. */
static enum umb_status check_contact(const struct list *list, const struct umbb_eye *eye,
                                     const struct umb_light_info *light, uint32_t number,
                                     struct umb_error *error)
{
    const double *p = eye->position, *at = list->contact.at;
    const double least = eye->reach * UMBB_NEAR_SHARE;
    if (!list->has_contact) {
        return UMB_OK;
    }
    if (list->contact.distance > 0) {
        return umb_fail(error, UMB_E_BAD_SCENE,
                        "light %u ('%s') at %.15g %.15g %.15g: a surface in its light is %.3g m "
                        "away, at %.15g %.15g %.15g; the limit is %.3g m (2^-26 of the way to the "
                        "farthest triangle): move the light at least %.1g m away from it",
                        number, light->name, p[0], p[1], p[2], list->contact.distance, at[0], at[1],
                        at[2], least, 2.0 * least);
    }
    return umb_fail(error, UMB_E_BAD_SCENE,
                    "light %u ('%s') at %.15g %.15g %.15g: it is on a surface (0 m away, the limit "
                    "is %.3g m) and shines to both sides of it: move the light at least %.1g m to "
                    "the side that it belongs to",
                    number, light->name, p[0], p[1], p[2], least, 2.0 * least);
}

/* Adds the face along eye->axes[2] if the face sees a caster, or if `always` is 1. Returns 1 if the
 * face sees a caster. */
static int add_face(struct list *list, uint32_t light, const struct umbb_eye *eye, int always)
{
    struct umb_frustum_info frustum;
    look_for_contact(list, eye);
    const int seen = umbb_perspective_fit(&list->input->fit, eye, &frustum);
    if (seen || always) {
        append(list, light, &frustum);
    }
    return seen;
}

/* Turns the eye along an axis of a cube, against this axis if sign is -1. cube: all three axes. */
static void look_along(struct umbb_eye *eye, const double cube[3][3], int axis, int sign)
{
    for (int k = 0; k < 3; k++) {
        eye->axes[0][k] = cube[(axis + (sign > 0 ? 1 : 2)) % 3][k];
        eye->axes[1][k] = cube[(axis + (sign > 0 ? 2 : 1)) % 3][k];
        eye->axes[2][k] = sign > 0 ? cube[axis][k] : 0.0 - cube[axis][k];
    }
}

/* Adds the faces of a cube whose first face looks along `front`; the opposite face only if `all`. A
 * light gets at least one face. The faces share the cube's axes, so they meet edge to edge. If
 * these are the world's axes, each face differs from a face in world axes by quarter turns only. */
static void add_cube(struct list *list, uint32_t light, struct umbb_eye *eye, const double front[3],
                     int all)
{
    double cube[3][3];
    const uint32_t before = list->count;
    eye->tangent = 1.0;
    umbb_light_axes(front, cube);
    for (int axis = 2; axis >= 0; axis--) {
        for (int sign = 1; sign >= (axis < 2 || all ? -1 : 1); sign -= 2) {
            look_along(eye, (const double(*)[3])cube, axis, sign);
            if (all) {
                double w[3];
                memcpy(w, eye->axes[2], sizeof w);
                umbb_light_axes(w, eye->axes);
            }
            (void)add_face(list, light, eye, 0);
        }
    }
    if (list->count == before) {
        umbb_light_axes(front, eye->axes);
        (void)add_face(list, light, eye, 1);
    }
}

static enum umb_status add_light(struct list *list, const struct umbb_light_choice *choice,
                                 uint32_t number, struct umb_error *error)
{
    const struct umbb_frusta_input *input = list->input;
    const struct umb_light_info *light = &choice->lights[number];
    if (light->kind == UMB_LIGHT_DIRECTIONAL) {
        struct umb_frustum_info frustum;
        UMB__TRY(umbb_light_frame_fit(&input->fit, light->direction, &frustum, error));
        append(list, number, &frustum);
        return UMB_OK;
    }
    struct umbb_eye eye = {.reach = umbb_light_reach(&input->bounds, light->position),
                           .voxel_min = list->voxel_min};
    memcpy(eye.position, light->position, sizeof eye.position);
    if (!(eye.reach > 1e-9)) {
        return umb_fail(error, UMB_E_BAD_SCENE,
                        "light %u: nothing of the scene is farther from it than %g metres", number,
                        eye.reach);
    }
    const double half_deg = choice->cones[number] * DEG_A_RAD;
    double cosine;
    list->has_contact = 0;
    if (light->kind != UMB_LIGHT_POINT) {
        umbb_sin_cos_degrees(half_deg, &eye.cone_sine, &cosine);
        eye.direction = light->direction;
    }
    if (light->kind == UMB_LIGHT_POINT) {
        static const double z[3] = {0.0, 0.0, 1.0};
        add_cube(list, number, &eye, z, 1);
    } else if (half_deg > UMBB_SPOT_HALF_ANGLE_DEG) {
        add_cube(list, number, &eye, light->direction, 0);
    } else {
        eye.tangent = eye.cone_sine / cosine;
        umbb_light_axes(light->direction, eye.axes);
        (void)add_face(list, number, &eye, 1);
    }
    return check_contact(list, &eye, light, number, error);
}

enum umb_status umbb_frusta_fit(const struct umbb_frusta_input *input,
                                struct umbb_light_choice *choice, struct umb_frustum_info **frusta,
                                uint32_t *count, struct umb_error *error)
{
    struct list list = {.input = input, .voxel_min = least_voxel(&input->bounds)};
    *frusta = NULL;
    *count = 0;
    list.frusta = calloc((size_t)6 * choice->count, sizeof *list.frusta);
    if (list.frusta == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY,
                        "analysis: memory for the frusta of %u lights refused", choice->count);
    }
    for (uint32_t i = 0; i < choice->count; i++) {
        choice->lights[i].first_frustum = list.count;
        const enum umb_status status = add_light(&list, choice, i, error);
        if (status != UMB_OK) {
            free(list.frusta);
            return status;
        }
        choice->lights[i].frustum_count = list.count - choice->lights[i].first_frustum;
    }
    *frusta = list.frusta;
    *count = list.count;
    return UMB_OK;
}

/* SPDX-License-Identifier: Apache-2.0 */
/* Which faces a light has. */
#include "bake/analysis/frusta.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "bake/analysis/light_frame.h"
#include "bake/analysis/perspective_frame.h"

#define DEG_A_RAD 57.29577951308232

/* The frusta so far. */
struct list {
    const struct umbb_frusta_input *input;
    struct umb_frustum_info *frusta; /* [6 * lights] */
    uint32_t count;
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

static struct umb_frustum_info *next(struct list *list, uint32_t light)
{
    struct umb_frustum_info *frustum = &list->frusta[list->count++];
    frustum->light = light;
    frustum->closed = list->input->closed;
    return frustum;
}

/* The face along w; 1 if it sees a caster. It is taken into the list if so, or if `always`. */
static int add_face(struct list *list, uint32_t light, struct umbb_eye *eye, const double w[3],
                    int always)
{
    struct umb_frustum_info frustum;
    umbb_light_axes(w, eye->axes);
    const int seen = umbb_perspective_fit(list->input->corners, list->input->count, eye,
                                          list->input->origin, list->input->log2_size, &frustum);
    if (seen || always) {
        struct umb_frustum_info *to = next(list, light);
        const struct umb_frustum_info kept = *to;
        *to = frustum;
        to->light = kept.light;
        to->closed = kept.closed;
    }
    return seen;
}

/* Cube faces around `front`; the one behind only if `all`. A light has at least one. */
static void add_cube(struct list *list, uint32_t light, struct umbb_eye *eye, const double front[3],
                     int all)
{
    double axes[3][3];
    const uint32_t before = list->count;
    eye->tangent = 1.0;
    umbb_light_axes(front, axes);
    for (int axis = 2; axis >= 0; axis--) {
        const double back[3] = {0.0 - axes[axis][0], 0.0 - axes[axis][1], 0.0 - axes[axis][2]};
        (void)add_face(list, light, eye, axes[axis], 0);
        if (axis < 2 || all) {
            (void)add_face(list, light, eye, back, 0);
        }
    }
    if (list->count == before) {
        (void)add_face(list, light, eye, front, 1);
    }
}

static enum umb_status add_light(struct list *list, const struct umbb_light_choice *choice,
                                 uint32_t number, struct umb_error *error)
{
    const struct umbb_frusta_input *input = list->input;
    const struct umb_light_info *light = &choice->lights[number];
    if (light->kind == UMB_LIGHT_DIRECTIONAL) {
        struct umb_frustum_info frustum;
        const enum umb_status status =
            umbb_light_frame_fit(input->corners, input->count, light->direction, input->origin,
                                 input->log2_size, &frustum, error);
        struct umb_frustum_info *to = next(list, number);
        frustum.light = to->light;
        frustum.closed = to->closed;
        *to = frustum;
        return status;
    }
    struct umbb_eye eye = {.reach = umbb_light_reach(&input->bounds, light->position)};
    memcpy(eye.position, light->position, sizeof eye.position);
    if (!(eye.reach > 1e-9)) {
        return umb_fail(error, UMB_E_BAD_SCENE,
                        "light %u: nothing of the scene is farther from it than %g metres", number,
                        eye.reach);
    }
    const double half_deg = choice->cones[number] * DEG_A_RAD;
    if (light->kind == UMB_LIGHT_POINT) {
        static const double z[3] = {0.0, 0.0, 1.0};
        add_cube(list, number, &eye, z, 1);
    } else if (half_deg > UMBB_SPOT_HALF_ANGLE_DEG) {
        add_cube(list, number, &eye, light->direction, 0);
    } else {
        double sine, cosine;
        umbb_sin_cos_degrees(half_deg, &sine, &cosine);
        eye.tangent = sine / cosine;
        (void)add_face(list, number, &eye, light->direction, 1);
    }
    return UMB_OK;
}

enum umb_status umbb_frusta_fit(const struct umbb_frusta_input *input,
                                struct umbb_light_choice *choice, struct umb_frustum_info **frusta,
                                uint32_t *count, struct umb_error *error)
{
    struct list list = {.input = input};
    *frusta = NULL;
    *count = 0;
    list.frusta = calloc((size_t)6 * choice->count, sizeof *list.frusta);
    if (list.frusta == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY,
                        "analysis: memory for the frusta of %u lights "
                        "refused",
                        choice->count);
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

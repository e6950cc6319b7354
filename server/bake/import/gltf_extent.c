/* SPDX-License-Identifier: Apache-2.0 */
/* Extents of lights, see gltf.h. */
#include "bake/import/gltf.h"

#include <math.h>
#include <string.h>

#include "base/try.h"
#include "base/vec.h"
#include "scene/scene_buffer.h"

#define ANGLE_MAX 1.5707963267948966

/* The extras of a light, and the light that they are read for. */
struct extras {
    const json_t *of_node, *of_light;
    const struct umbs_light *light;
};

static const json_t *find(const struct extras *extras, const char *key)
{
    const json_t *json = json_object_get(extras->of_node, key);
    return json != NULL ? json : json_object_get(extras->of_light, key);
}

/* Reads a number above 0, or one of 0 and above. Fails: E_BAD_SCENE. */
static enum umb_status read_size(const struct extras *extras, const char *key, double most,
                                 int may_be_0, double *size, struct umb_error *error)
{
    const json_t *json = find(extras, key);
    *size = json_number_value(json); /* 0 for what is no number */
    if (!json_is_number(json)) {
        return UMBB_REFUSE(error, "light '%s': %s %s; give a number of at most %g",
                           extras->light->name, key, json == NULL ? "is missing" : "is no number",
                           most);
    }
    return (*size > 0.0 || (may_be_0 && *size == 0.0)) && *size <= most
               ? UMB_OK
               : UMBB_REFUSE(error, "light '%s': %s: %g, must be %s and at most %g",
                             extras->light->name, key, *size, may_be_0 ? "0 or more" : "above 0",
                             most);
}

/* Finds the vector of a rectangle's width: the node's x axis, perpendicular to the direction. */
static enum umb_status read_rectangle(const struct extras *extras, const double (*world)[4],
                                      struct umbs_light_extent *extent, struct umb_error *error)
{
    const double *d = extras->light->direction;
    double x[3] = {world[0][0], world[1][0], world[2][0]}, width;
    UMB__TRY(read_size(extras, "umbrage_width", UMB_LAMP_SIZE_MAX, 0, &width, error));
    UMB__TRY(read_size(extras, "umbrage_height", UMB_LAMP_SIZE_MAX, 0, &extent->extent, error));
    for (int turn = 0; turn < 2; turn++) { /* twice, so that rounding leaves nothing along d */
        const double along = umb__dot(x, d);
        for (int k = 0; k < 3; k++) {
            x[k] -= along * d[k];
        }
        if (!umb__unit(x)) {
            return UMBB_REFUSE(error, "light '%s': umbrage_width: its node has no x axis",
                               extras->light->name);
        }
    }
    umb__scale(width, x);
    memcpy(extent->side, x, sizeof x);
    return UMB_OK;
}

static enum umb_status read_shape(const struct extras *extras, const double (*world)[4],
                                  const char *shape, struct umbs_light *light,
                                  struct umbs_light_extent *extent, struct umb_error *error)
{
    const int is_rectangle = shape != NULL && strcmp(shape, "rectangle") == 0;
    if (light->kind == UMB_LIGHT_DIRECTIONAL) {
        return UMBB_REFUSE(error,
                           "light '%s': umbrage_shape: it is directional; give it to a spot or "
                           "point light",
                           light->name);
    }
    if (!is_rectangle && (shape == NULL || strcmp(shape, "disc") != 0)) {
        return UMBB_REFUSE(error, "light '%s': umbrage_shape: unknown; give rectangle or disc",
                           light->name);
    }
    light->kind = is_rectangle ? UMB_LIGHT_RECTANGLE : UMB_LIGHT_DISC;
    return is_rectangle ? read_rectangle(extras, world, extent, error)
                        : read_size(extras, "umbrage_diameter", UMB_LAMP_SIZE_MAX, 0,
                                    &extent->extent, error);
}

enum umb_status umbb_gltf_extent(const json_t *node, const json_t *punctual,
                                 const double (*world)[4], struct umbs_light *light,
                                 struct umbs_light_extent *extent, struct umb_error *error)
{
    const struct extras extras = {json_object_get(node, "extras"),
                                  json_object_get(punctual, "extras"), light};
    const int is_sun = light->kind == UMB_LIGHT_DIRECTIONAL;
    const char *key = is_sun ? "umbrage_angle" : "umbrage_diameter";
    const json_t *shape = find(&extras, "umbrage_shape");
    *extent = (struct umbs_light_extent){0};
    if (shape != NULL) {
        UMB__TRY(read_shape(&extras, world, json_string_value(shape), light, extent, error));
    } else if (find(&extras, key) != NULL) {
        UMB__TRY(read_size(&extras, key, is_sun ? ANGLE_MAX : UMB_LAMP_SIZE_MAX, 1, &extent->extent,
                           error));
    } else {
        return UMB_OK;
    }
    extent->is_given = 1;
    return UMB_OK;
}

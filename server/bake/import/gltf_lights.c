/* SPDX-License-Identifier: Apache-2.0 */
/* Lights of glTF nodes (gltf.h). Source: KHR_lights_punctual, Khronos Group 2018. */
#include "bake/import/gltf.h"

#include <math.h>
#include <string.h>

#include "common/clean_text.h"
#include "scene/scene_buffer.h"

#define QUARTER_TURN 1.5707963267948966

static double clamp(double value, double low, double high)
{
    return value >= low ? (value <= high ? value : high) : low; /* NaN becomes low */
}

/* Unit vector of -z of the node; straight down in node space if the node has lost that axis. */
static void light_direction(const double world[3][4], double direction[3])
{
    double length =
        sqrt(world[0][2] * world[0][2] + world[1][2] * world[1][2] + world[2][2] * world[2][2]);
    for (int k = 0; k < 3; k++) {
        direction[k] = length > 1e-30 ? -world[k][2] / length : (k == 2 ? -1.0 : 0.0);
    }
}

/* The largest component of colour times intensity becomes the intensity. */
static void light_color(const json_t *json, struct umbs_light *light)
{
    const double intensity = umbb_gltf_number(json, "intensity", 1.0);
    double color[3] = {1.0, 1.0, 1.0};
    (void)umbb_gltf_numbers(json, "color", 3, color);
    for (int k = 0; k < 3; k++) {
        light->color[k] = clamp(color[k] * intensity, 0.0, 1e30);
        light->intensity = light->color[k] > light->intensity ? light->color[k] : light->intensity;
    }
    for (int k = 0; k < 3 && light->intensity > 0.0; k++) {
        light->color[k] /= light->intensity;
    }
}

/* Reads the kind and the cones. Returns 0 for an unknown kind. */
static int light_kind(const json_t *json, struct umbs_light *light)
{
    const char *type = json_string_value(json_object_get(json, "type"));
    const json_t *spot = json_object_get(json, "spot");
    if (type == NULL) {
        return 0;
    }
    if (strcmp(type, "spot") == 0) {
        light->kind = UMB_LIGHT_SPOT;
        light->outer_cone =
            clamp(umbb_gltf_number(spot, "outerConeAngle", 0.5 * QUARTER_TURN), 0.0, QUARTER_TURN);
        light->inner_cone =
            clamp(umbb_gltf_number(spot, "innerConeAngle", 0.0), 0.0, light->outer_cone);
        return 1;
    }
    const int is_point = strcmp(type, "point") == 0;
    light->kind = is_point ? UMB_LIGHT_POINT : UMB_LIGHT_DIRECTIONAL;
    return is_point || strcmp(type, "directional") == 0;
}

enum umb_status umbb_gltf_add_light(struct umbb_gltf_scene *scene, const json_t *node,
                                    const char *name, const double world[3][4],
                                    struct umb_error *error)
{
    static const char extension[] = "KHR_lights_punctual";
    struct umbs_scene_builder *builder = &scene->file.job->scene;
    const int64_t number = umbb_gltf_index(umbb_gltf_extension(node, extension), "light");
    const json_t *list =
        json_object_get(umbb_gltf_extension(scene->file.json, extension), "lights");
    const json_t *json = json_array_get(list, (size_t)number);
    struct umbs_light light = {0};
    if (number == UMBB_GLTF_NONE) {
        return UMB_OK;
    }
    umbs_text_clean(light.name, sizeof light.name, name, strlen(name));
    if (json == NULL) {
        return umb_fail(error, UMB_E_BAD_SCENE, "light %lld of node '%s' does not exist",
                        (long long)number, light.name);
    }
    if (!light_kind(json, &light)) {
        umbs_scene_warn(builder, "light '%s' is of a kind that casts no shadow", light.name);
        return UMB_OK;
    }
    light_direction(world, light.direction);
    for (int k = 0; k < 3; k++) {
        light.position[k] = world[k][3];
    }
    light.range = clamp(umbb_gltf_number(json, "range", 0.0), 0.0, UMBS_COORDINATE_MAX);
    light_color(json, &light);
    return umbs_scene_add_light(builder, &light, error);
}

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Reads a glTF scene: walks its nodes and appends instances of their meshes, and lights.
 * Source: glTF 2.0, section 3.5; EXT_mesh_gpu_instancing; KHR_lights_punctual, Khronos Group 2018.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bake/import/gltf.h"
#include "base/try.h"
#include "common/clean_text.h"
#include "scene/scene_buffer.h"

#define NODE_DEPTH_MAX 1024U
#define QUARTER_TURN   1.5707963267948966

typedef const double (*transform)[4]; /* [3][4], affine, row major */

struct node {
    const json_t *json;
    const char *name; /* of the file, or "nodes[number]" */
    char own_name[32];
};

static enum umb_status bad_transform(const struct node *node, struct umb_error *error)
{
    char name[80];
    umbs_text_clean(name, sizeof name, node->name, strlen(node->name));
    return UMBB_REFUSE(error,
                       "transform of node '%s' is not of finite numbers, not affine or over %g",
                       name, UMBS_COORDINATE_MAX);
}

/* parent * m. Returns 0 if the result is not a usable affine transform. */
static int multiply(transform parent, transform m, double out[3][4])
{
    int good = 1;
    for (int row = 0; row < 3; row++) {
        for (int column = 0; column < 4; column++) {
            double sum = column == 3 ? parent[row][3] : 0.0;
            for (int k = 0; k < 3; k++) {
                sum += parent[row][k] * m[k][column];
            }
            out[row][column] = sum;
            good &= fabs(sum) <= UMBS_COORDINATE_MAX; /* false for NaN */
        }
    }
    return good;
}

/* Makes a transform that scales, then rotates, then moves. The rotation is normalised, because
 * files round quaternions, those in bytes by a hundredth. Returns 0 if the rotation is 0. */
static int compose(const double move[3], const double turn[4], const double size[3],
                   double out[3][4])
{
    const double x = turn[0], y = turn[1], z = turn[2], w = turn[3];
    const double length = x * x + y * y + z * z + w * w;
    if (!(length > 0.0)) {
        return 0;
    }
    const double s = 2.0 / length;
    const double rotation[3][3] = {
        {1.0 - s * (y * y + z * z), s * (x * y - z * w), s * (x * z + y * w)},
        {s * (x * y + z * w), 1.0 - s * (x * x + z * z), s * (y * z - x * w)},
        {s * (x * z - y * w), s * (y * z + x * w), 1.0 - s * (x * x + y * y)},
    };
    for (int row = 0; row < 3; row++) {
        for (int column = 0; column < 3; column++) {
            out[row][column] = rotation[row][column] * size[column];
        }
        out[row][3] = move[row];
    }
    return 1;
}

/* Reads the array at `key` if there is one. Returns 0 if it is not of `count` numbers. */
static int optional_numbers(const json_t *json, const char *key, size_t count, double *numbers)
{
    return json_object_get(json, key) == NULL || umbb_gltf_numbers(json, key, count, numbers);
}

/* The node's own transform. Returns 0 if it is none. */
static int local_transform(const json_t *json, double local[3][4])
{
    double m[16], move[3] = {0, 0, 0}, turn[4] = {0, 0, 0, 1}, size[3] = {1, 1, 1};
    if (json_object_get(json, "matrix") == NULL) {
        return optional_numbers(json, "translation", 3, move) &&
               optional_numbers(json, "rotation", 4, turn) &&
               optional_numbers(json, "scale", 3, size) && compose(move, turn, size, local);
    }
    int good = umbb_gltf_numbers(json, "matrix", 16, m);
    for (int column = 0; good && column < 4; column++) {
        const double last = m[4 * column + 3] - (column == 3 ? 1.0 : 0.0);
        good = fabs(last) <= 1e-6; /* tolerates the files' rounding */
        for (int row = 0; row < 3; row++) {
            local[row][column] = m[4 * column + row];
        }
    }
    return good;
}

static enum umb_status add_meshes(struct umbb_gltf *gltf, const struct umbb_gltf_mesh *mesh,
                                  transform world, struct umb_error *error)
{
    for (uint32_t i = 0; i < mesh->count; i++) {
        UMB__TRY(umbs_scene_add_instance(&gltf->job->scene, mesh->first + i, world, error));
    }
    return UMB_OK;
}

/* Columns of EXT_mesh_gpu_instancing. */
enum {
    COLUMN_TRANSLATION = 0,
    COLUMN_ROTATION,
    COLUMN_SCALE,
    COLUMN_COUNT,
};

/* Places of a node's mesh: rows of accessors. */
struct places {
    uint32_t count;                                  /* 0: the node has none */
    struct umbb_gltf_accessor columns[COLUMN_COUNT]; /* count 0: the node lacks the column */
};

static enum umb_status open_places(struct umbb_gltf *gltf, const json_t *node,
                                   struct places *places, struct umb_error *error)
{
    static const struct umbb_gltf_use uses[COLUMN_COUNT] = {
        {"TRANSLATION", "VEC3 of floats", 3, UMBB_GLTF_FLOAT},
        {"ROTATION", "VEC4 of floats or signed integers of 8 or 16 bits", 4,
         UMBB_GLTF_FLOAT | UMBB_GLTF_SIGNED},
        {"SCALE", "VEC3 of floats", 3, UMBB_GLTF_FLOAT},
    };
    const json_t *attributes =
        json_object_get(umbb_gltf_extension(node, "EXT_mesh_gpu_instancing"), "attributes");
    *places = (struct places){0};
    for (int i = 0; i < COLUMN_COUNT; i++) {
        const int64_t number = umbb_gltf_index(attributes, uses[i].name);
        struct umbb_gltf_accessor *column = &places->columns[i];
        if (number == UMBB_GLTF_NONE) {
            continue;
        }
        UMB__TRY(umbb_gltf_accessor(gltf, number, &uses[i], column, error));
        if (places->count > 0 && places->count != column->count) {
            return UMBB_REFUSE(error,
                               "EXT_mesh_gpu_instancing: accessors of %u and of %u elements in one "
                               "node",
                               places->count, column->count);
        }
        places->count = column->count;
    }
    return UMB_OK;
}

/* Adds the node's mesh, once or at all its places. The limit of triangles ends the loop over
 * places. A mesh without triangles would not reach that limit, so it is left out. */
static enum umb_status add_instances(struct umbb_gltf *gltf, const struct node *node,
                                     transform world, struct umb_error *error)
{
    const int64_t number = umbb_gltf_index(node->json, "mesh");
    const struct umbb_gltf_mesh *mesh;
    struct places places;
    if (number == UMBB_GLTF_NONE) {
        return UMB_OK;
    }
    UMB__TRY(umbb_gltf_get_mesh(gltf, number, &mesh, error));
    gltf->skinned += json_object_get(node->json, "skin") != NULL;
    UMB__TRY(open_places(gltf, node->json, &places, error));
    if (places.count == 0) {
        return add_meshes(gltf, mesh, world, error);
    }
    for (uint32_t i = 0; mesh->count > 0 && i < places.count; i++) {
        double values[COLUMN_COUNT][4] = {{0, 0, 0, 0}, {0, 0, 0, 1}, {1, 1, 1, 0}};
        double local[3][4], place[3][4];
        for (int k = 0; k < COLUMN_COUNT; k++) {
            if (places.columns[k].count > 0) {
                umbb_gltf_get(&places.columns[k], i, values[k]);
            }
        }
        if (!compose(values[COLUMN_TRANSLATION], values[COLUMN_ROTATION], values[COLUMN_SCALE],
                     local) ||
            !multiply(world, (transform)local, place)) {
            return bad_transform(node, error);
        }
        UMB__TRY(add_meshes(gltf, mesh, (transform)place, error));
    }
    return UMB_OK;
}

static double clamp(double value, double low, double high)
{
    return value >= low ? (value <= high ? value : high) : low; /* NaN becomes low */
}

/* Computes the unit vector of the node's -z axis. If the node's transform makes that axis zero, the
 * vector is 0 0 -1. */
static void light_direction(transform world, double direction[3])
{
    double length =
        sqrt(world[0][2] * world[0][2] + world[1][2] * world[1][2] + world[2][2] * world[2][2]);
    for (int k = 0; k < 3; k++) {
        direction[k] = length > 1e-30 ? -world[k][2] / length : (k == 2 ? -1.0 : 0.0);
    }
}

/* Sets intensity and colour of a light: the largest component of colour times intensity becomes the
 * intensity. */
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
    const char *type = umbb_gltf_text(json, "type");
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

/* Appends the light of a node, if it has one (KHR_lights_punctual). A light shines along the node's
 * -z; the node's scale does not change the light. */
static enum umb_status add_light(struct umbb_gltf *gltf, const struct node *node, transform world,
                                 struct umb_error *error)
{
    static const char extension[] = "KHR_lights_punctual";
    struct umbs_scene_builder *builder = &gltf->job->scene;
    const int64_t number = umbb_gltf_index(umbb_gltf_extension(node->json, extension), "light");
    const json_t *list = json_object_get(umbb_gltf_extension(gltf->json, extension), "lights");
    const json_t *json = json_array_get(list, (size_t)number);
    struct umbs_light light = {0};
    struct umbs_light_extent extent;
    if (number == UMBB_GLTF_NONE) {
        return UMB_OK;
    }
    umbs_text_clean(light.name, sizeof light.name, node->name, strlen(node->name));
    if (number == UMBB_GLTF_BAD) {
        return UMBB_REFUSE(error, "the light of node '%s' is not a whole number from 0 to 2^40",
                           light.name);
    }
    if (json == NULL) {
        return UMBB_REFUSE(error, "light %lld of node '%s' does not exist", (long long)number,
                           light.name);
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
    UMB__TRY(umbb_gltf_extent(node->json, json, world, &light, &extent, error));
    return umbs_scene_add_light(builder, &light, &extent, error);
}

/* Finds a node by its number. A second visit fails: nodes form trees, and a graph could be walked
 * for ever. */
static enum umb_status visit(struct umbb_gltf *gltf, const json_t *number, struct node *node,
                             struct umb_error *error)
{
    const int64_t index = umbb_gltf_to_index(number);
    UMB__TRY(umbb_gltf_item(gltf, "nodes", index, &node->json, error));
    if (gltf->nodes[index]++ > 0) {
        return UMBB_REFUSE(error,
                           "nodes[%lld] has two parents or is recursive; nodes must form trees",
                           (long long)index);
    }
    (void)snprintf(node->own_name, sizeof node->own_name, "nodes[%lld]", (long long)index);
    node->name = umbb_gltf_text(node->json, "name");
    if (node->name == NULL || node->name[0] == '\0') {
        node->name = node->own_name;
    }
    return UMB_OK;
}

static enum umb_status walk_nodes(struct umbb_gltf *gltf, const json_t *numbers, transform parent,
                                  unsigned depth, struct umb_error *error)
{
    if (depth > NODE_DEPTH_MAX) {
        return UMBB_REFUSE(error, "nodes nest deeper than %u", NODE_DEPTH_MAX);
    }
    for (size_t i = 0; i < json_array_size(numbers); i++) {
        struct node node;
        double local[3][4], world[3][4];
        UMB__TRY(visit(gltf, json_array_get(numbers, i), &node, error));
        if (!local_transform(node.json, local) || !multiply(parent, (transform)local, world)) {
            return bad_transform(&node, error);
        }
        UMB__TRY(add_instances(gltf, &node, (transform)world, error));
        UMB__TRY(add_light(gltf, &node, (transform)world, error));
        UMB__TRY(walk_nodes(gltf, json_object_get(node.json, "children"), (transform)world,
                            depth + 1, error));
    }
    return UMB_OK;
}

static void warn_about_losses(const struct umbb_gltf *gltf)
{
    struct umbs_scene_builder *builder = &gltf->job->scene;
    const size_t animations = json_array_size(json_object_get(gltf->json, "animations"));
    if (gltf->bare > 0) {
        umbs_scene_warn(builder,
                        "%u meshes whose alpha is a texture have no coordinates in it and are "
                        "taken as opaque",
                        gltf->bare);
    }
    if (gltf->skinned > 0) {
        umbs_scene_warn(builder, "%u skinned meshes are taken in their rest pose", gltf->skinned);
    }
    if (gltf->morphed > 0) {
        umbs_scene_warn(builder, "%u meshes with morph targets are taken without them",
                        gltf->morphed);
    }
    if (animations > 0) {
        umbs_scene_warn(builder, "%zu animations are ignored: the scene is taken as static",
                        animations);
    }
}

static enum umb_status read_scene(struct umbb_gltf *gltf, struct umb_error *error)
{
    static const double identity[3][4] = {{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}};
    const struct umbs_scene_builder *builder = &gltf->job->scene;
    const size_t meshes = json_array_size(json_object_get(gltf->json, "meshes"));
    const int64_t number = umbb_gltf_index(gltf->json, "scene");
    const json_t *root;
    if (meshes == 0) {
        return UMBB_REFUSE(error, "no meshes, so no triangles");
    }
    UMB__TRY(umbb_gltf_item(gltf, "scenes", number != UMBB_GLTF_NONE ? number : 0, &root, error));
    UMB__TRY(walk_nodes(gltf, json_object_get(root, "nodes"), identity, 0, error));
    warn_about_losses(gltf);
    if (builder->world_triangles == 0) {
        return UMBB_REFUSE(error,
                           "no node shows a triangle (%zu meshes, %zu triangles, %u faces dropped)",
                           meshes, builder->triangles.count, builder->dropped_faces);
    }
    return UMB_OK;
}

enum umb_status umbb_gltf_read(struct umbb_import *job, struct umb_error *error)
{
    struct umbb_gltf gltf;
    enum umb_status status = umbb_gltf_open(&gltf, job, error);
    if (status == UMB_OK) {
        status = read_scene(&gltf, error);
    }
    umbb_gltf_close(&gltf);
    return status;
}

/* SPDX-License-Identifier: Apache-2.0 */
/* See gltf_instances.h. Source: EXT_mesh_gpu_instancing; glTF 2.0 specification, section 3.5. */
#include "bake/import/gltf_instances.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "bake/import/json_scan.h"

#define NO_ACCESSOR (-1)

struct node {
    size_t first_child, child_count; /* in children */
    int has_places;
    int64_t translation, rotation, scale; /* accessors, or NO_ACCESSOR */
};

static enum umb_status no_memory(struct umb_error *error)
{
    return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for nodes");
}

/* Appends an array's numbers. */
static enum umb_status read_numbers(struct umbb_cursor *json, struct umbs_array *numbers,
                                    struct umb_error *error)
{
    if (!umbb_json_enter(json, '[')) {
        return UMB_OK;
    }
    while (umbb_json_item(json)) {
        uint32_t *room = umbs_array_reserve(numbers, 1, sizeof *room);
        if (room == NULL) {
            return no_memory(error);
        }
        const int64_t number = umbb_json_number(json, UMBB_GLTF_NO_NODE);
        *room = number >= 0 && number < UMBB_GLTF_MANY_ROOTS ? (uint32_t)number : UMBB_GLTF_NO_NODE;
        numbers->count++;
    }
    return UMB_OK;
}

static void read_attributes(struct umbb_cursor *json, struct node *node)
{
    struct umbb_json_text key;
    if (!umbb_json_enter(json, '{')) {
        return;
    }
    while (umbb_json_member(json, &key)) {
        int64_t *accessor = umbb_json_is(key, "TRANSLATION") ? &node->translation
                            : umbb_json_is(key, "ROTATION")  ? &node->rotation
                            : umbb_json_is(key, "SCALE")     ? &node->scale
                                                             : NULL;
        if (accessor != NULL) {
            *accessor = umbb_json_number(json, NO_ACCESSOR);
            node->has_places = 1;
        } else {
            umbb_json_skip(json);
        }
    }
}

/* Finds the member `attributes` of the extension among a node's extensions. */
static void read_extensions(struct umbb_cursor *json, struct node *node)
{
    struct umbb_json_text key;
    if (!umbb_json_enter(json, '{')) {
        return;
    }
    while (umbb_json_member(json, &key)) {
        if (!umbb_json_is(key, "EXT_mesh_gpu_instancing")) {
            umbb_json_skip(json);
            continue;
        }
        if (!umbb_json_enter(json, '{')) {
            continue;
        }
        while (umbb_json_member(json, &key)) {
            if (umbb_json_is(key, "attributes")) {
                read_attributes(json, node);
            } else {
                umbb_json_skip(json);
            }
        }
    }
}

static enum umb_status read_nodes(struct umbb_cursor *json, struct umbb_gltf_instances *instances,
                                  struct umb_error *error)
{
    enum umb_status status = UMB_OK;
    struct umbb_json_text key;
    if (!umbb_json_enter(json, '[')) {
        return UMB_OK;
    }
    while (status == UMB_OK && umbb_json_item(json)) {
        struct node *node = umbs_array_reserve(&instances->nodes, 1, sizeof *node);
        if (node == NULL) {
            return no_memory(error);
        }
        instances->nodes.count++;
        *node = (struct node){.translation = NO_ACCESSOR,
                              .rotation = NO_ACCESSOR,
                              .scale = NO_ACCESSOR,
                              .first_child = instances->children.count};
        if (!umbb_json_enter(json, '{')) {
            continue;
        }
        while (status == UMB_OK && umbb_json_member(json, &key)) {
            if (umbb_json_is(key, "children")) {
                status = read_numbers(json, &instances->children, error);
            } else if (umbb_json_is(key, "extensions")) {
                read_extensions(json, node);
            } else {
                umbb_json_skip(json);
            }
        }
        node->child_count = instances->children.count - node->first_child;
        instances->is_used |= node->has_places;
    }
    return status;
}

/* The roots of scene number `wanted`. */
static enum umb_status read_roots(struct umbb_cursor json, int64_t wanted, struct umbs_array *roots,
                                  struct umb_error *error)
{
    enum umb_status status = UMB_OK;
    struct umbb_json_text key;
    if (!umbb_json_enter(&json, '[')) {
        return UMB_OK;
    }
    for (int64_t i = 0; status == UMB_OK && umbb_json_item(&json); i++) {
        if (i != wanted || !umbb_json_enter(&json, '{')) {
            umbb_json_skip(&json);
            continue;
        }
        while (status == UMB_OK && umbb_json_member(&json, &key)) {
            if (umbb_json_is(key, "nodes")) {
                status = read_numbers(&json, roots, error);
            } else {
                umbb_json_skip(&json);
            }
        }
    }
    return status;
}

enum umb_status umbb_gltf_instances_find(struct umbb_gltf_instances *instances,
                                         const struct umbb_import *job, enum umbb_kind kind,
                                         struct umb_error *error)
{
    struct umbb_cursor json = umbb_gltf_json(job, kind), scenes = {NULL, NULL};
    struct umbb_json_text key;
    int64_t scene = 0;
    enum umb_status status = UMB_OK;
    if (kind == UMBB_KIND_STL || !umbb_json_enter(&json, '{')) {
        return UMB_OK;
    }
    while (status == UMB_OK && umbb_json_member(&json, &key)) {
        if (umbb_json_is(key, "nodes")) {
            status = read_nodes(&json, instances, error);
        } else if (umbb_json_is(key, "scene")) {
            scene = umbb_json_number(&json, 0);
        } else {
            scenes = umbb_json_is(key, "scenes") ? json : scenes;
            umbb_json_skip(&json);
        }
    }
    if (status == UMB_OK && instances->is_used) {
        status = read_roots(scenes, scene, &instances->roots, error);
    }
    if (status == UMB_OK && instances->is_used) {
        status = umbb_gltf_columns_find(&instances->columns, job, kind, error);
    }
    return status;
}

void umbb_gltf_instances_finish(struct umbb_gltf_instances *instances)
{
    umbb_gltf_columns_finish(&instances->columns);
    free(instances->nodes.data);
    free(instances->children.data);
    free(instances->roots.data);
    memset(instances, 0, sizeof *instances);
}

uint32_t umbb_gltf_root(const struct umbb_gltf_instances *instances)
{
    const uint32_t *roots = instances->roots.data;
    return !instances->is_used           ? UMBB_GLTF_NO_NODE
           : instances->roots.count == 1 ? roots[0]
                                         : UMBB_GLTF_MANY_ROOTS;
}

static const struct node *node_of(const struct umbb_gltf_instances *instances, uint32_t node)
{
    return node < instances->nodes.count ? (const struct node *)instances->nodes.data + node : NULL;
}

size_t umbb_gltf_child_count(const struct umbb_gltf_instances *instances, uint32_t node)
{
    const struct node *known = node_of(instances, node);
    return known != NULL                  ? known->child_count
           : node == UMBB_GLTF_MANY_ROOTS ? instances->roots.count
                                          : 0;
}

uint32_t umbb_gltf_child(const struct umbb_gltf_instances *instances, uint32_t node, size_t index)
{
    const struct node *known = node_of(instances, node);
    const uint32_t *numbers = known != NULL ? instances->children.data : instances->roots.data;
    if (index >= umbb_gltf_child_count(instances, node)) {
        return UMBB_GLTF_NO_NODE;
    }
    return numbers[(known != NULL ? known->first_child : 0) + index];
}

/* Opens a column if it is there, and compares its length with those before it. */
static enum umb_status open_column(struct umbb_gltf_instances *instances, int64_t accessor,
                                   uint32_t width, struct umbb_gltf_places *places, int *has,
                                   struct umbb_gltf_column *column, struct umb_error *error)
{
    if (accessor == NO_ACCESSOR) {
        return UMB_OK;
    }
    const enum umb_status status =
        umbb_gltf_column_open(&instances->columns, accessor, width, column, error);
    if (status == UMB_OK && places->count > 0 && places->count != column->count) {
        return umb_fail(error, UMB_E_BAD_SCENE,
                        "EXT_mesh_gpu_instancing: accessors of %u and of %u elements in one node",
                        places->count, column->count);
    }
    *has = status == UMB_OK;
    places->count = status == UMB_OK ? column->count : 0;
    return status;
}

enum umb_status umbb_gltf_places_open(struct umbb_gltf_instances *instances, uint32_t number,
                                      struct umbb_gltf_places *places, struct umb_error *error)
{
    const struct node *node = node_of(instances, number);
    memset(places, 0, sizeof *places);
    if (node == NULL || !node->has_places) {
        return UMB_OK;
    }
    enum umb_status status = open_column(instances, node->translation, 3, places,
                                         &places->has_translation, &places->translation, error);
    if (status == UMB_OK) {
        status = open_column(instances, node->rotation, 4, places, &places->has_rotation,
                             &places->rotation, error);
    }
    if (status == UMB_OK) {
        status = open_column(instances, node->scale, 3, places, &places->has_scale, &places->scale,
                             error);
    }
    return status;
}

int umbb_gltf_place(const struct umbb_gltf_places *places, size_t index, double local[3][4])
{
    double move[3] = {0, 0, 0}, turn[4] = {0, 0, 0, 1}, size[3] = {1, 1, 1};
    if (places->has_translation) {
        umbb_gltf_column_get(&places->translation, index, move);
    }
    if (places->has_rotation) {
        umbb_gltf_column_get(&places->rotation, index, turn);
    }
    if (places->has_scale) {
        umbb_gltf_column_get(&places->scale, index, size);
    }
    const double x = turn[0], y = turn[1], z = turn[2], w = turn[3];
    const double length = x * x + y * y + z * z + w * w;
    if (!(length > 0.0)) {
        return 0;
    }
    const double s = 2.0 / length; /* files round quaternions: those in bytes by a hundredth */
    const double rotation[3][3] = {
        {1.0 - s * (y * y + z * z), s * (x * y - z * w), s * (x * z + y * w)},
        {s * (x * y + z * w), 1.0 - s * (x * x + z * z), s * (y * z - x * w)},
        {s * (x * z - y * w), s * (y * z + x * w), 1.0 - s * (x * x + y * y)},
    };
    for (int row = 0; row < 3; row++) {
        for (int column = 0; column < 3; column++) {
            local[row][column] = rotation[row][column] * size[column];
        }
        local[row][3] = move[row];
    }
    return 1;
}

/* SPDX-License-Identifier: Apache-2.0 */
/* Lights of an Assimp scene (assimp_lights.h). Source: KHR_lights_punctual, Khronos Group 2018. */
#include "bake/import/assimp_lights.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "scene/scene_buffer.h"
#include "common/clean_text.h"

#define NO_NUMBER UINT64_MAX

/* A value of metadata by its key, or NULL. */
static const struct aiMetadataEntry *find_entry(const struct aiMetadata *metadata, const char *key)
{
    for (unsigned i = 0; metadata != NULL && i < metadata->mNumProperties; i++) {
        const struct aiString *name = &metadata->mKeys[i];
        if (name->length == strlen(key) && memcmp(name->data, key, name->length) == 0) {
            return &metadata->mValues[i];
        }
    }
    return NULL;
}

static const struct aiMetadata *find_child(const struct aiMetadata *metadata, const char *key)
{
    const struct aiMetadataEntry *entry = find_entry(metadata, key);
    return entry != NULL && entry->mType == AI_AIMETADATA ? entry->mData : NULL;
}

/* The file's number of a node's light, or NO_NUMBER. */
static uint64_t light_number(const struct aiNode *node)
{
    const struct aiMetadata *extensions = find_child(node->mMetaData, "extensions");
    const struct aiMetadata *punctual = find_child(extensions, "KHR_lights_punctual");
    const struct aiMetadataEntry *entry = find_entry(punctual, "light");
    uint64_t number = NO_NUMBER;
    if (entry != NULL && entry->mType == AI_UINT64) {
        memcpy(&number, entry->mData, sizeof(number));
    } else if (entry != NULL && entry->mType == AI_INT32) {
        int32_t small;
        memcpy(&small, entry->mData, sizeof(small));
        number = small >= 0 ? (uint64_t)small : NO_NUMBER;
    }
    return number;
}

static int same_name(const struct aiString *a, const struct aiString *b)
{
    return a->length == b->length && memcmp(a->data, b->data, a->length) == 0;
}

/* Index of a number in the table, or the table's size. */
static size_t find_number(const struct umbb_light_table *table, uint64_t number)
{
    const uint64_t *numbers = table->numbers.data;
    size_t at = 0;
    while (at < table->numbers.count && numbers[at] != number) {
        at++;
    }
    return at;
}

/* Lists the numbers in the order of first use, children first. Returns 0 if out of memory. */
static int collect(struct umbb_light_table *table, const struct aiNode *node, unsigned depth)
{
    for (unsigned i = 0; depth > 0 && i < node->mNumChildren; i++) {
        if (!collect(table, node->mChildren[i], depth - 1)) {
            return 0;
        }
    }
    uint64_t number = light_number(node);
    if (number == NO_NUMBER || table->numbers.count > table->scene->mNumLights ||
        find_number(table, number) < table->numbers.count) {
        return 1; /* no number, too many to be proven, or known */
    }
    uint64_t *room = umbs_array_reserve(&table->numbers, 1, sizeof(*room));
    if (room != NULL) {
        *room = number;
        table->numbers.count++;
    }
    return room != NULL;
}

/* Marks each light that has a node's name with that node's number. */
static void mark(const struct umbb_light_table *table, const struct aiNode *node, unsigned depth,
                 uint8_t *marks)
{
    for (unsigned i = 0; depth > 0 && i < node->mNumChildren; i++) {
        mark(table, node->mChildren[i], depth - 1, marks);
    }
    size_t at = find_number(table, light_number(node));
    if (at < table->numbers.count && same_name(&table->scene->mLights[at]->mName, &node->mName)) {
        marks[at] = 1;
    }
}

enum umb_status umbb_light_table_init(struct umbb_light_table *table, const struct aiScene *scene,
                                      unsigned depth_max, struct umb_error *error)
{
    memset(table, 0, sizeof(*table));
    table->scene = scene;
    if (scene->mNumLights == 0) {
        return UMB_OK;
    }
    uint8_t *marks = calloc(scene->mNumLights, 1);
    if (marks == NULL || !collect(table, scene->mRootNode, depth_max)) {
        free(marks);
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for lights");
    }
    if (table->numbers.count == scene->mNumLights) {
        mark(table, scene->mRootNode, depth_max, marks);
        table->proven = memchr(marks, 0, scene->mNumLights) == NULL;
    }
    free(marks);
    return UMB_OK;
}

void umbb_light_table_finish(struct umbb_light_table *table)
{
    free(table->numbers.data);
    memset(table, 0, sizeof(*table));
}

static const struct aiLight *find_light(const struct umbb_light_table *table,
                                        const struct aiNode *node)
{
    const struct aiScene *scene = table->scene;
    if (table->proven) {
        size_t at = find_number(table, light_number(node));
        return at < table->numbers.count ? scene->mLights[at] : NULL;
    }
    for (unsigned i = 0; i < scene->mNumLights; i++) {
        if (same_name(&scene->mLights[i]->mName, &node->mName)) {
            return scene->mLights[i];
        }
    }
    return NULL;
}

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

static void light_color(const struct aiLight *source, struct umbs_light *light)
{
    const double product[3] = {(double)source->mColorDiffuse.r, (double)source->mColorDiffuse.g,
                               (double)source->mColorDiffuse.b};
    for (int k = 0; k < 3; k++) {
        light->color[k] = clamp(product[k], 0.0, 1e30);
        light->intensity = light->color[k] > light->intensity ? light->color[k] : light->intensity;
    }
    for (int k = 0; k < 3 && light->intensity > 0.0; k++) {
        light->color[k] /= light->intensity;
    }
}

enum umb_status umbb_light_add(const struct umbb_light_table *table, const struct aiNode *node,
                               const double world[3][4], struct umbs_scene_builder *builder,
                               struct umb_error *error)
{
    struct umbs_light light = {0};
    const struct aiLight *source = find_light(table, node);
    if (source == NULL) {
        return UMB_OK;
    }
    umbs_text_clean(light.name, sizeof(light.name), node->mName.data, sizeof(node->mName.data));
    switch (source->mType) {
    case aiLightSource_DIRECTIONAL:
        light.kind = UMB_LIGHT_DIRECTIONAL;
        break;
    case aiLightSource_SPOT:
        light.kind = UMB_LIGHT_SPOT;
        light.outer_cone = clamp((double)source->mAngleOuterCone, 0.0, 1.5707963267948966);
        light.inner_cone = clamp((double)source->mAngleInnerCone, 0.0, light.outer_cone);
        break;
    case aiLightSource_POINT:
        light.kind = UMB_LIGHT_POINT;
        break;
    default:
        umbs_scene_warn(builder, "light '%s' is of a kind that casts no shadow", light.name);
        return UMB_OK;
    }
    light_direction(world, light.direction);
    for (int k = 0; k < 3; k++) {
        light.position[k] = world[k][3];
    }
    const struct aiMetadataEntry *range = find_entry(node->mMetaData, "PBR_LightRange");
    if (range != NULL && range->mType == AI_FLOAT) {
        float value;
        memcpy(&value, range->mData, sizeof(value));
        light.range = clamp((double)value, 0.0, UMBS_COORDINATE_MAX);
    }
    light_color(source, &light);
    return umbs_scene_add_light(builder, &light, error);
}

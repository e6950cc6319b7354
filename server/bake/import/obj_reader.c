/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Wavefront OBJ in doubles: v, vt, f, usemtl, mtllib; and of its material libraries (MTL) the
 * statements that affect shadows: d, Tr, map_d. Pictures take vn and Kd, too. All other statements
 * are skipped.
 *
 * The reader makes one pass over the mapped text. A vertex of the scene is a triple (v, vt, vn),
 * numbered at its first use; without pictures vn is not read. The triples of one v form a chain, so
 * only seams split a vertex.
 * At the end triangles are grouped by material. Each group is a mesh with one instance, and all
 * meshes share one range of vertices.
 *
 * An unreadable `v` line still adds a vertex, which is not finite; without it the numbers of all
 * later vertices would shift. A face may only refer to statements before it.
 *
 * d (or 1 - Tr if there is no d) below 1 makes a material BLEND with that alpha. map_d makes it
 * MASK at 0.5, by the alpha of its PNG or else by its grey. Of map_d's options -clamp is supported;
 * a map that is moved, scaled or perturbed (-o, -s, -t, -mm, -imfchan) is left out with a warning.
 * Source: Alias/Wavefront, "Object Files (.obj)", Advanced Visualizer appendix B1, 1995; "MTL
 * material format", 1995.
 */
#define _GNU_SOURCE /* tdestroy */
#include <math.h>
#include <search.h>
#include <stdlib.h>
#include <string.h>

#include "bake/import/face_builder.h"
#include "bake/import/texture_table.h"
#include "base/try.h"
#include "common/clean_text.h"

#define LINE_BYTES_MAX (4U << 20) /* a face of 65536 corners of three numbers fits */
#define MATERIALS_MAX  65536U
#define LIBRARIES_MAX  64U /* limit of mtllib names; each may be as large as the scene */
#define CHAIN_MAX      64  /* limit of steps along a chain, against quadratic time */
#define NONE           UMBS_NO_INDEX

/* Position of a v line, and the first scene vertex made of it. */
struct corner_point {
    double position[3];
    uint32_t first; /* scene vertex or NONE */
};

/* The triple of a scene vertex. */
struct made_of {
    uint32_t uv;     /* vt number or NONE */
    uint32_t normal; /* vn number or NONE */
    uint32_t next;   /* scene vertex of the same v, or NONE */
};

/* Run of triangles of one material: from `first` up to the next run. */
struct run {
    uint32_t first;
    uint32_t material;
};

struct obj {
    struct umbb_import *job;
    struct umbs_array points;  /* struct corner_point */
    struct umbs_array uvs;     /* float[2] */
    struct umbs_array normals; /* double[3] */
    struct umbs_array made;    /* struct made_of, one a scene vertex */
    struct umbs_array runs;    /* struct run */
    struct umbb_faces faces;
    void *names; /* tree of the materials' full names */
    struct umbb_texture_table textures;
    uint32_t library_count;
    uint64_t line_number;
};

/* A material's name, in a tree of <search.h>. */
struct name {
    struct umbb_cursor text; /* behind the struct, in the tree */
    uint32_t index;
};

static int compare_names(const void *a, const void *b)
{
    const struct umbb_cursor x = ((const struct name *)a)->text, y = ((const struct name *)b)->text;
    const size_t one = umbb_length(x), two = umbb_length(y);
    return one != two ? (one > two) - (one < two) : memcmp(x.at, y.at, one);
}

/* Finds the material called `name`, or adds an opaque one. Out: index: in scene->materials. */
static enum umb_status get_material(struct obj *obj, struct umbb_cursor name, uint32_t *index,
                                    struct umb_error *error)
{
    struct umbs_scene_builder *scene = &obj->job->scene;
    const struct name wanted = {.text = name};
    const size_t length = umbb_length(name);
    struct name *const *found = tfind(&wanted, &obj->names, compare_names);
    if (found != NULL) {
        *index = (*found)->index;
        return UMB_OK;
    }
    if (scene->materials.count >= MATERIALS_MAX) {
        return umb_fail(error, UMB_E_LIMIT, "more than %u materials", MATERIALS_MAX);
    }
    struct umbs_material material = umbs_material_opaque();
    umbs_text_clean(material.name, sizeof(material.name), name.at, length);
    *index = (uint32_t)scene->materials.count;
    UMB__TRY(umbs_scene_add_material(scene, &material, error));
    struct name *fresh = malloc(sizeof *fresh + length);
    if (fresh != NULL) {
        char *const text = memcpy(fresh + 1, name.at, length);
        *fresh = (struct name){{text, text + length}, *index};
    }
    if (fresh == NULL || tsearch(fresh, &obj->names, compare_names) == NULL) {
        free(fresh);
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a material");
    }
    return UMB_OK;
}

/* Properties of one material from its lines so far. */
struct current {
    uint32_t index;
    double dissolve; /* from d or Tr, 0..1 */
    int has_d;       /* 1: d was given; it overrides Tr, on whose meaning exporters disagree */
    int has_map;
    struct umbb_cursor map; /* rest of the line of map_d */
    float color[3];         /* from Kd, linear */
    int has_image;          /* 1: map_Kd was given */
};

/* Options of a map. An option of several words takes fewer where the next word is no number. */
static const struct {
    const char *name;
    int words;   /* largest number of words after the name */
    int changes; /* 1: the option moves, scales or replaces the image, which is not supported */
} map_options[] = {
    {"-blendu", 1, 0}, {"-blendv", 1, 0}, {"-boost", 1, 0}, {"-cc", 1, 0}, {"-texres", 1, 0},
    {"-type", 1, 0},   {"-clamp", 1, 0},  {"-bm", 1, 0},    {"-mm", 2, 1}, {"-imfchan", 1, 1},
    {"-o", 3, 1},      {"-s", 3, 1},      {"-t", 3, 1},
};

/* Sets a material's alpha. A line without a number is ignored; a number outside of 0 to 1 is
 * ignored with a warning. */
static void set_alpha(struct obj *obj, struct current *current, struct umbb_cursor *line, int is_d)
{
    struct umbs_scene_builder *scene = &obj->job->scene;
    double value;
    struct umbb_cursor first = *line, option;
    if (umbb_take_token(&first, &option) && umbb_is_word(option, "-halo")) {
        *line = first;
    }
    if (current->index == UMBS_NO_INDEX || (!is_d && current->has_d) ||
        !umbb_take_double(line, &value)) {
        return;
    }
    if (!(value >= 0.0) || !(value <= 1.0)) {
        const struct umbs_material *materials = scene->materials.data;
        umbs_scene_warn(scene, "material '%s': %s of %g is not in 0 to 1 and is left out",
                        materials[current->index].name, is_d ? "d" : "Tr", value);
        return;
    }
    current->dissolve = is_d ? value : 1.0 - value;
    current->has_d = is_d;
}

/* Takes one option of a map off the cursor; returns 0 if there is none. */
static int take_option(struct umbb_cursor *line, uint32_t *wrap, int *changes)
{
    struct umbb_cursor at = *line, word;
    (void)umbb_take_token(&at, &word);
    for (size_t i = 0; i < sizeof map_options / sizeof map_options[0]; i++) {
        if (!umbb_is_word(word, map_options[i].name)) {
            continue;
        }
        *changes |= map_options[i].changes;
        for (int k = 0; k < map_options[i].words; k++) {
            struct umbb_cursor next = at, value;
            double number;
            if (k > 0 && !umbb_take_double(&next, &number)) {
                break;
            }
            (void)umbb_take_token(&at, &value);
            if (strcmp(map_options[i].name, "-clamp") == 0 && umbb_is_word(value, "on")) {
                *wrap = UMBS_WRAP_CLAMP;
            }
        }
        *line = at;
        return 1;
    }
    return 0;
}

/* Gives a material the texture of its map_d. */
static enum umb_status read_map(struct obj *obj, struct umbb_cursor line,
                                struct umbs_material *material, struct umb_error *error)
{
    uint32_t wrap = UMBS_WRAP_REPEAT;
    int changes = 0;
    while (umbb_skip_blanks(&line) && take_option(&line, &wrap, &changes)) {
    }
    const struct umbb_cursor name = umbb_trim(line);
    if (changes || name.at == name.end) {
        umbs_scene_warn(&obj->job->scene,
                        "material '%s': map_d with options that are not read is left out",
                        material->name);
        return UMB_OK;
    }
    const struct umbb_image image = {.name = name.at,
                                     .name_length = umbb_length(name),
                                     .luminance = 1,
                                     .wrap_s = wrap,
                                     .wrap_t = wrap};
    return umbb_texture_get(&obj->textures, &image, &material->texture, error);
}

static enum umb_status store(struct obj *obj, const struct current *current,
                             struct umb_error *error)
{
    if (current->index == UMBS_NO_INDEX) {
        return UMB_OK;
    }
    struct umbs_material *materials = obj->job->scene.materials.data;
    struct umbs_material *material = &materials[current->index];
    material->base_alpha = (float)current->dissolve;
    memcpy(material->base_color, current->color, sizeof current->color);
    material->has_image = (uint32_t)current->has_image;
    material->alpha_mode = current->dissolve < 1.0 ? UMBS_ALPHA_BLEND
                           : current->has_map      ? UMBS_ALPHA_MASK
                                                   : UMBS_ALPHA_OPAQUE;
    return current->has_map ? read_map(obj, current->map, material, error) : UMB_OK;
}

/* Takes the colour of Kd. Files have the values that a screen shows, so they become linear by the
 * usual exponent. A line without three numbers is ignored. */
static void set_color(struct current *current, struct umbb_cursor *line)
{
    double values[3];
    for (int k = 0; k < 3; k++) {
        if (!umbb_take_double(line, &values[k]) || !isfinite(values[k])) {
            return;
        }
    }
    for (int k = 0; k < 3; k++) {
        current->color[k] = (float)pow(fmin(fmax(values[k], 0.0), 1.0), 2.2);
    }
}

/* Reads a material library. */
static enum umb_status read_materials(struct obj *obj, const struct umbb_file *file,
                                      struct umb_error *error)
{
    struct umbb_cursor text = umbb_text_of(file), line, word;
    const struct current fresh = {.dissolve = 1.0, .color = {1.0F, 1.0F, 1.0F}};
    struct current current = fresh;
    current.index = UMBS_NO_INDEX;
    while (umbb_take_line(&text, &line)) {
        (void)umbb_take_token(&line, &word);
        if (umbb_is_word(word, "newmtl")) {
            UMB__TRY(store(obj, &current, error));
            current = fresh;
            UMB__TRY(get_material(obj, umbb_trim(line), &current.index, error));
        } else if (umbb_is_word(word, "d")) {
            set_alpha(obj, &current, &line, 1);
        } else if (umbb_is_word(word, "Tr")) {
            set_alpha(obj, &current, &line, 0);
        } else if (umbb_is_word(word, "Kd")) {
            set_color(&current, &line);
        } else if (umbb_is_word(word, "map_Kd")) {
            current.has_image = 1;
        } else if (umbb_is_word(word, "map_d")) {
            current.has_map = 1;
            current.map = line;
        }
    }
    return store(obj, &current, error);
}

static enum umb_status read_vertex(struct obj *obj, struct umbb_cursor line,
                                   struct umb_error *error)
{
    struct corner_point point = {.first = NONE};
    for (int k = 0; k < 3; k++) {
        if (!umbb_take_double(&line, &point.position[k])) {
            point.position[k] = (double)NAN;
        }
    }
    return umbs_array_add(&obj->points, &point, sizeof point, error);
}

static enum umb_status read_uv(struct obj *obj, struct umbb_cursor line, struct umb_error *error)
{
    float uv[2];
    for (int k = 0; k < 2; k++) {
        double value;
        int good = umbb_take_double(&line, &value) && fabs(value) <= 1e30;
        uv[k] = good ? (float)value : 0.0F;
    }
    return umbs_array_add(&obj->uvs, uv, sizeof uv, error);
}

static enum umb_status read_normal(struct obj *obj, struct umbb_cursor line,
                                   struct umb_error *error)
{
    double normal[3];
    for (int k = 0; obj->job->look && k < 3; k++) {
        if (!umbb_take_double(&line, &normal[k])) {
            normal[k] = (double)NAN;
        }
    }
    return obj->job->look ? umbs_array_add(&obj->normals, normal, sizeof normal, error) : UMB_OK;
}

/* The scene vertex of a triple; a new triple gets a new vertex. */
static enum umb_status find_vertex(struct obj *obj, struct corner_point *point, uint32_t uv,
                                   uint32_t normal, uint64_t *vertex, struct umb_error *error)
{
    struct made_of *made = obj->made.data;
    uint32_t at = point->first;
    for (int steps = 0; at != NONE && steps < CHAIN_MAX; steps++, at = made[at].next) {
        if (made[at].uv == uv && made[at].normal == normal) {
            *vertex = at;
            return UMB_OK;
        }
    }
    const struct made_of fresh = {uv, normal, point->first};
    const float *uvs = obj->uvs.data;
    UMB__TRY(umbs_scene_add_vertex(&obj->job->scene, point->position,
                                   uv != NONE ? uvs + 2 * (size_t)uv : NULL, error));
    if (normal != NONE) {
        const double *normals = obj->normals.data;
        UMB__TRY(umbs_scene_set_normal(&obj->job->scene, normals + 3 * (size_t)normal, error));
    }
    *vertex = obj->made.count;
    point->first = (uint32_t)obj->made.count;
    return umbs_array_add(&obj->made, &fresh, sizeof fresh, error);
}

/* Resolves a one-based or negative reference into `count` items; NONE if it is out of range. */
static uint32_t resolve(int64_t reference, size_t count)
{
    int64_t limit = count < UINT32_MAX ? (int64_t)count : (int64_t)UINT32_MAX - 1;
    if (reference > 0 && reference <= limit) {
        return (uint32_t)(reference - 1);
    }
    if (reference < 0 && -reference <= limit) {
        return (uint32_t)((int64_t)count + reference);
    }
    return NONE;
}

/* Reads one corner: v, v/vt, v//vn, v/vt/vn. */
static enum umb_status read_corner(struct obj *obj, struct umbb_cursor *line,
                                   struct umb_error *error)
{
    int64_t reference = 0;
    uint32_t uv = NONE, normal = NONE;
    uint32_t point = NONE;
    if (umbb_take_integer(line, &reference)) {
        point = resolve(reference, obj->points.count);
    }
    if (line->at < line->end && *line->at == '/') {
        line->at++;
        if (umbb_take_integer(line, &reference)) {
            uv = resolve(reference, obj->uvs.count); /* a bad index costs only the texture */
        }
    }
    if (!umbb_at_blank(line) && *line->at != '/') {
        point = NONE; /* not a reference, such as "1x" */
    }
    if (obj->normals.count > 0 && !umbb_at_blank(line) && *line->at == '/') {
        line->at++;
        if (umbb_take_integer(line, &reference)) {
            normal = resolve(reference, obj->normals.count); /* a bad index costs only the look */
        }
    }
    while (!umbb_at_blank(line)) {
        line->at++; /* the rest is not used */
    }
    uint64_t vertex = UMBB_BAD_CORNER;
    if (point != NONE) {
        struct corner_point *points = obj->points.data;
        UMB__TRY(find_vertex(obj, &points[point], uv, normal, &vertex, error));
    }
    return umbb_face_corner(&obj->faces, vertex, error);
}

static enum umb_status read_face(struct obj *obj, struct umbb_cursor line, struct umb_error *error)
{
    obj->faces.line = obj->line_number;
    while (umbb_skip_blanks(&line) && *line.at != '#') {
        UMB__TRY(read_corner(obj, &line, error));
    }
    return umbb_face_end(&obj->faces, error);
}

/* Starts a run at the next triangle. */
static enum umb_status add_run(struct obj *obj, uint32_t material, struct umb_error *error)
{
    const struct run run = {(uint32_t)obj->job->scene.triangles.count, material};
    return umbs_array_add(&obj->runs, &run, sizeof run, error);
}

static enum umb_status use_material(struct obj *obj, struct umbb_cursor line,
                                    struct umb_error *error)
{
    uint32_t material;
    UMB__TRY(get_material(obj, umbb_trim(line), &material, error));
    struct run *last = (struct run *)obj->runs.data + obj->runs.count - 1;
    if (last->material == material || last->first == obj->job->scene.triangles.count) {
        last->material = material;
        return UMB_OK;
    }
    return add_run(obj, material, error);
}

/* Reads one library, or warns: a scene without its materials still casts shadows. */
static enum umb_status read_library(struct obj *obj, struct umbb_cursor name, int *found,
                                    struct umb_error *error)
{
    struct umbb_file file;
    struct umb_error why = {0};
    *found = 1;
    if (obj->library_count > LIBRARIES_MAX) {
        return UMB_OK;
    }
    if (obj->library_count++ == LIBRARIES_MAX) {
        umbs_scene_warn(&obj->job->scene, "mtllib: more than %u names, the others are not read",
                        LIBRARIES_MAX);
        return UMB_OK;
    }
    enum umb_status status = umbb_file_map_named(obj->job, name, &file, &why);
    *found = status == UMB_OK;
    if (status != UMB_OK) {
        if (umbb_length(name) <= 100) {
            umbs_scene_warn(&obj->job->scene, "mtllib: %s", why.message);
        }
        return status == UMB_E_NO_MEMORY ? umb_fail(error, status, "%s", why.message) : UMB_OK;
    }
    status = read_materials(obj, &file, error);
    umbb_file_unmap(&file);
    return status;
}

/* Reads the libraries of a line: its rest is one name, or each word is one. */
static enum umb_status read_libraries(struct obj *obj, struct umbb_cursor line,
                                      struct umb_error *error)
{
    struct umbb_cursor names = umbb_trim(line), name;
    const int several = memchr(names.at, ' ', umbb_length(names)) != NULL;
    int found = umbb_length(names) == 0, ignored;
    if (!found) {
        UMB__TRY(read_library(obj, names, &found, error));
    }
    while (several && !found && umbb_take_token(&names, &name)) {
        UMB__TRY(read_library(obj, name, &ignored, error));
    }
    return UMB_OK;
}

static enum umb_status read_line(struct obj *obj, struct umbb_cursor line, struct umb_error *error)
{
    static const struct {
        const char *word;
        enum umb_status (*read)(struct obj *, struct umbb_cursor, struct umb_error *);
    } statements[] = {
        {"v", read_vertex}, {"vt", read_uv},          {"vn", read_normal},
        {"f", read_face},   {"usemtl", use_material}, {"mtllib", read_libraries},
    };
    struct umbb_cursor word;
    (void)umbb_take_token(&line, &word);
    for (size_t i = 0; line.at < line.end && i < sizeof statements / sizeof statements[0]; i++) {
        if (umbb_is_word(word, statements[i].word)) {
            return statements[i].read(obj, line, error);
        }
    }
    return UMB_OK;
}

/* Joins a line that ends in a backslash with those after it; '\' and '\n' count as blanks. */
static void join_lines(struct umbb_cursor *text, struct umbb_cursor *line)
{
    for (;;) {
        const char *last = line->end;
        last -= last > line->at && last[-1] == '\r';
        struct umbb_cursor more;
        if (last == line->at || last[-1] != '\\' || !umbb_take_line(text, &more)) {
            return;
        }
        line->end = more.end;
    }
}

static enum umb_status read_text(struct obj *obj, struct umb_error *error)
{
    struct umbb_cursor text = umbb_text_of(&obj->job->file), line;
    text.at += umbb_starts_with(text, "\xef\xbb\xbf") ? 3 : 0;
    UMB__TRY(add_run(obj, NONE, error));
    while (umbb_take_line(&text, &line)) {
        obj->line_number++;
        if (line.end > line.at && (line.end[-1] == '\\' || line.end[-1] == '\r')) {
            join_lines(&text, &line);
        }
        if (umbb_length(line) > LINE_BYTES_MAX) {
            return umb_fail(error, UMB_E_LIMIT, "statement %llu has %zu bytes, limit %u",
                            (unsigned long long)obj->line_number, umbb_length(line),
                            LINE_BYTES_MAX);
        }
        UMB__TRY(read_line(obj, line, error));
    }
    return UMB_OK;
}

/* Returns the group of a triangle: 0 without a material, else the material's group. A triangle
 * without coordinates for its material's texture counts as without material: it is opaque. */
static size_t group_of(const struct obj *obj, uint32_t material, const uint32_t triangle[3])
{
    const struct umbs_material *materials = obj->job->scene.materials.data;
    const struct made_of *made = obj->made.data;
    int is_bare = material == NONE;
    const int has_texture = !is_bare && materials[material].texture != UMBS_NO_INDEX;
    for (int k = 0; k < 3 && has_texture; k++) {
        is_bare |= made[triangle[k]].uv == NONE;
    }
    return is_bare ? 0 : (size_t)material + 1;
}

/* Sorts the triangles by material, keeping their order within one. starts: [materials + 2]. */
static void group(const struct obj *obj, uint32_t *starts, uint32_t (*sorted)[3])
{
    struct umbs_scene_builder *scene = &obj->job->scene;
    const uint32_t(*triangles)[3] = scene->triangles.data;
    const struct run *runs = obj->runs.data; /* the last one is the end */
    uint32_t bare = 0;
    for (size_t i = 0; i + 1 < obj->runs.count; i++) {
        for (uint32_t k = runs[i].first; k < runs[i + 1].first; k++) {
            const size_t at = group_of(obj, runs[i].material, triangles[k]);
            bare += at == 0 && runs[i].material != NONE;
            starts[at + 1]++;
        }
    }
    if (bare > 0) {
        umbs_scene_warn(scene,
                        "%u triangles of materials with map_d have no texture coordinates and are "
                        "taken as opaque",
                        bare);
    }
    for (size_t i = 1; i < scene->materials.count + 2; i++) {
        starts[i] += starts[i - 1];
    }
    for (size_t i = 0; i + 1 < obj->runs.count; i++) {
        for (uint32_t k = runs[i].first; k < runs[i + 1].first; k++) {
            const size_t at = group_of(obj, runs[i].material, triangles[k]);
            memcpy(sorted[starts[at]++], triangles[k], sizeof(*sorted));
        }
    }
}

static enum umb_status end_meshes(struct obj *obj, struct umb_error *error)
{
    struct umbs_scene_builder *scene = &obj->job->scene;
    size_t groups = scene->materials.count + 1; /* no material, then each material */
    uint32_t *starts = calloc(groups + 1, sizeof(*starts));
    uint32_t(*sorted)[3] = malloc(scene->triangles.count * sizeof(*sorted));
    enum umb_status status = UMB_OK;
    if (starts == NULL || sorted == NULL) {
        status = umb_fail(error, UMB_E_NO_MEMORY, "out of memory");
        goto done;
    }
    group(obj, starts, sorted);
    free(scene->triangles.data);
    scene->triangles.data = sorted;
    scene->triangles.capacity = scene->triangles.count;
    sorted = NULL;
    /* The sort has moved each start to the end of its group. */
    for (size_t i = 0; status == UMB_OK && i < groups; i++) {
        uint32_t count = starts[i] - (i > 0 ? starts[i - 1] : 0);
        if (count == 0) {
            continue;
        }
        status = umbs_scene_end_mesh(scene, 0, (uint32_t)scene->positions.count, count,
                                     i > 0 ? (uint32_t)(i - 1) : NONE, error);
        if (status == UMB_OK) {
            status = umbs_scene_add_instance(scene, (uint32_t)scene->meshes.count - 1, NULL, error);
        }
    }
done:
    free(starts);
    free(sorted);
    return status;
}

static enum umb_status finish_scene(struct obj *obj, struct umb_error *error)
{
    if (obj->faces.count == 0) {
        return obj->points.count == 0
                   ? UMBB_REFUSE(error, "no faces")
                   : UMBB_REFUSE(error, "%zu vertices and no faces", obj->points.count);
    }
    UMB__TRY(umbb_faces_check(&obj->faces, error));
    UMB__TRY(add_run(obj, NONE, error));
    return end_meshes(obj, error);
}

enum umb_status umbb_obj_read(struct umbb_import *job, struct umb_error *error)
{
    static const char *const others[] = {"glTF", "ply\n", "ply\r", "{", "<"};
    int is_obj = umbb_is_text(&job->file);
    for (size_t i = 0; i < sizeof others / sizeof others[0]; i++) {
        is_obj &= !umbb_starts_with(umbb_text_of(&job->file), others[i]);
    }
    if (!is_obj) {
        return UMBB_REFUSE(error, "the file is not OBJ text");
    }
    struct obj obj = {.job = job, .faces = {.scene = &job->scene}, .textures = {.job = job}};
    enum umb_status status = read_text(&obj, error);
    if (status == UMB_OK) {
        /* Without textures the numbers of the vertices' texture coordinates (`made`) are not
         * needed; freeing them makes room for the sort. */
        if (obj.job->scene.textures.count == 0) {
            free(obj.made.data);
            obj.made.data = NULL;
        }
        status = finish_scene(&obj, error);
    }
    free(obj.points.data);
    free(obj.uvs.data);
    free(obj.normals.data);
    free(obj.made.data);
    free(obj.runs.data);
    umbb_faces_finish(&obj.faces);
    tdestroy(obj.names, free);
    umbb_texture_table_finish(&obj.textures);
    return status;
}

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Wavefront OBJ in doubles: v, vt, f, usemtl, mtllib; all other statements are skipped.
 *
 * The reader makes one pass over the mapped text. A vertex of the scene is a pair (v, vt), numbered
 * at its first use. The pairs of one v form a chain, so only seams of the texture split a vertex.
 * At the end triangles are grouped by material. Each group is a mesh with one instance, and all
 * meshes share one range of vertices.
 *
 * An unreadable `v` line still adds a vertex, which is not finite; without it the numbers of all
 * later vertices would shift. A face may only refer to statements before it.
 * Source: Alias/Wavefront, "Object Files (.obj)", Advanced Visualizer appendix B1, 1995.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "bake/import/face_builder.h"
#include "bake/import/import_job.h"
#include "bake/import/mtl_reader.h"
#include "base/try.h"

#define LINE_BYTES_MAX (4U << 20) /* a face of 65536 corners of three numbers fits */
#define LIBRARIES_MAX  64U        /* limit of mtllib names; each may be as large as the scene */
#define CHAIN_MAX      64         /* limit of steps along a chain, against quadratic time */
#define NONE           UMBS_NO_INDEX

/* Position of a v line, and the first scene vertex made of it. */
struct corner_point {
    double position[3];
    uint32_t first; /* scene vertex or NONE */
};

/* The pair of a scene vertex. */
struct made_of {
    uint32_t uv;   /* vt number or NONE */
    uint32_t next; /* scene vertex of the same v, or NONE */
};

/* Run of triangles of one material: from `first` up to the next run. */
struct run {
    uint32_t first;
    uint32_t material;
};

struct obj {
    struct umbb_import *job;
    struct umbs_array points; /* struct corner_point */
    struct umbs_array uvs;    /* float[2] */
    struct umbs_array made;   /* struct made_of, one a scene vertex */
    struct umbs_array runs;   /* struct run */
    struct umbb_faces faces;
    struct umbb_material_table materials;
    struct umbb_texture_table textures;
    uint32_t library_count;
    uint64_t line_number;
};

static enum umb_status no_memory(struct umb_error *error)
{
    return umb_fail(error, UMB_E_NO_MEMORY, "out of memory");
}

static enum umb_status read_vertex(struct obj *obj, struct umbb_cursor line,
                                   struct umb_error *error)
{
    struct corner_point *point = umbs_array_reserve(&obj->points, 1, sizeof(*point));
    if (point == NULL) {
        return no_memory(error);
    }
    point->first = NONE;
    for (int k = 0; k < 3; k++) {
        if (!umbb_take_double(&line, &point->position[k])) {
            point->position[k] = (double)NAN;
        }
    }
    obj->points.count++;
    return UMB_OK;
}

static enum umb_status read_uv(struct obj *obj, struct umbb_cursor line, struct umb_error *error)
{
    float *uv = umbs_array_reserve(&obj->uvs, 1, 2 * sizeof(*uv));
    if (uv == NULL) {
        return no_memory(error);
    }
    for (int k = 0; k < 2; k++) {
        double value;
        int good = umbb_take_double(&line, &value) && fabs(value) <= 1e30;
        uv[k] = good ? (float)value : 0.0F;
    }
    obj->uvs.count++;
    return UMB_OK;
}

/* The scene vertex of a pair; a new pair gets a new vertex. */
static enum umb_status find_vertex(struct obj *obj, struct corner_point *point, uint32_t uv,
                                   uint64_t *vertex, struct umb_error *error)
{
    struct made_of *made = obj->made.data;
    uint32_t at = point->first;
    for (int steps = 0; at != NONE && steps < CHAIN_MAX; steps++, at = made[at].next) {
        if (made[at].uv == uv) {
            *vertex = at;
            return UMB_OK;
        }
    }
    struct umbs_scene_builder *scene = &obj->job->scene;
    struct made_of *fresh = umbs_array_reserve(&obj->made, 1, sizeof(*fresh));
    if (fresh == NULL) {
        return no_memory(error);
    }
    const float *uvs = obj->uvs.data;
    UMB__TRY(umbs_scene_add_vertex(scene, point->position, uv != NONE ? uvs + 2 * (size_t)uv : NULL,
                                   error));
    fresh->uv = uv;
    fresh->next = point->first;
    point->first = (uint32_t)obj->made.count;
    *vertex = obj->made.count++;
    return UMB_OK;
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
    uint32_t uv = NONE;
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
    while (!umbb_at_blank(line)) {
        line->at++; /* the normal is not used */
    }
    uint64_t vertex = UMBB_BAD_CORNER;
    if (point != NONE) {
        struct corner_point *points = obj->points.data;
        UMB__TRY(find_vertex(obj, &points[point], uv, &vertex, error));
    }
    return umbb_face_corner(&obj->faces, vertex, error);
}

static enum umb_status read_face(struct obj *obj, struct umbb_cursor line, struct umb_error *error)
{
    while (umbb_skip_blanks(&line) && *line.at != '#') {
        UMB__TRY(read_corner(obj, &line, error));
    }
    return umbb_face_end(&obj->faces, error);
}

/* Starts a run at the next triangle. */
static enum umb_status add_run(struct obj *obj, uint32_t material, struct umb_error *error)
{
    struct run *run = umbs_array_reserve(&obj->runs, 1, sizeof(*run));
    if (run == NULL) {
        return no_memory(error);
    }
    *run = (struct run){(uint32_t)obj->job->scene.triangles.count, material};
    obj->runs.count++;
    return UMB_OK;
}

static enum umb_status use_material(struct obj *obj, struct umbb_cursor line,
                                    struct umb_error *error)
{
    struct umbb_cursor name = umbb_trim(line);
    uint32_t material;
    UMB__TRY(umbb_material_get(&obj->materials, name.at, (size_t)(name.end - name.at), &material,
                               error));
    struct run *last = (struct run *)obj->runs.data + obj->runs.count - 1;
    if (last->material == material || last->first == obj->job->scene.triangles.count) {
        last->material = material;
        return UMB_OK;
    }
    return add_run(obj, material, error);
}

/* Reads one library, or warns: a scene without its materials still casts shadows. */
static enum umb_status read_library(struct obj *obj, const char *name, size_t length, int *found,
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
    enum umb_status status = umbb_file_map_named(&obj->job->folder, name, length,
                                                 obj->job->max_input_bytes, &file, &why);
    *found = status == UMB_OK;
    if (status != UMB_OK) {
        if (length <= 100) {
            umbs_scene_warn(&obj->job->scene, "mtllib: %s", why.message);
        }
        return status == UMB_E_NO_MEMORY ? no_memory(error) : UMB_OK;
    }
    status = umbb_mtl_read(&file, &obj->materials, &obj->textures, error);
    umbb_file_unmap(&file);
    return status;
}

/* Reads the libraries of a line: its rest is one name, or each word is one. */
static enum umb_status read_libraries(struct obj *obj, struct umbb_cursor line,
                                      struct umb_error *error)
{
    struct umbb_cursor names = umbb_trim(line);
    int found = 0;
    size_t length = (size_t)(names.end - names.at);
    int several = length > 0 && memchr(names.at, ' ', length) != NULL;
    enum umb_status status = UMB_OK;
    if (length > 0) {
        status = read_library(obj, names.at, length, &found, error);
    }
    while (status == UMB_OK && several && !found && umbb_skip_blanks(&names)) {
        const char *name;
        int ignored;
        length = umbb_take_token(&names, &name);
        status = read_library(obj, name, length, &ignored, error);
    }
    return status;
}

static enum umb_status read_line(struct obj *obj, struct umbb_cursor line, struct umb_error *error)
{
    static const struct {
        const char *word;
        enum umb_status (*read)(struct obj *, struct umbb_cursor, struct umb_error *);
    } statements[] = {
        {"v", read_vertex},         {"vt", read_uv}, {"f", read_face}, {"usemtl", use_material},
        {"mtllib", read_libraries},
    };
    const char *word;
    const size_t length = umbb_take_token(&line, &word);
    for (size_t i = 0; line.at < line.end && i < sizeof statements / sizeof statements[0]; i++) {
        if (umbb_is_word(word, length, statements[i].word)) {
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
    const struct umbb_file *file = &obj->job->file;
    struct umbb_cursor text = {file->bytes, file->bytes + file->size};
    struct umbb_cursor line;
    text.at += umbb_starts_with(file, "\xef\xbb\xbf") ? 3 : 0;
    UMB__TRY(add_run(obj, NONE, error));
    while (umbb_take_line(&text, &line)) {
        obj->line_number++;
        if (line.end > line.at && (line.end[-1] == '\\' || line.end[-1] == '\r')) {
            join_lines(&text, &line);
        }
        if ((size_t)(line.end - line.at) > LINE_BYTES_MAX) {
            return umb_fail(error, UMB_E_LIMIT, "statement %llu has %zu bytes, limit %u",
                            (unsigned long long)obj->line_number, (size_t)(line.end - line.at),
                            LINE_BYTES_MAX);
        }
        UMB__TRY(read_line(obj, line, error));
    }
    return UMB_OK;
}

/* The group of a triangle: 0 for none, else its material's. A triangle without coordinates for its
 * material's texture counts as without material: it is opaque. */
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
        status = no_memory(error);
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
        return obj->points.count == 0 ? umb_fail(error, UMB_E_BAD_SCENE, "no faces")
                                      : umb_fail(error, UMB_E_BAD_SCENE,
                                                 "%zu vertices and no faces", obj->points.count);
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
        is_obj &= !umbb_starts_with(&job->file, others[i]);
    }
    if (!is_obj) {
        return umb_fail(error, UMB_E_BAD_SCENE, "the file is not OBJ text");
    }
    struct obj obj = {.job = job,
                      .faces = {.scene = &job->scene},
                      .materials = {.scene = &job->scene},
                      .textures = {.job = job}};
    enum umb_status status = read_text(&obj, error);
    if (status == UMB_OK) {
        /* Without textures the pairs are not needed; freeing them makes room for the sort. */
        if (obj.job->scene.textures.count == 0) {
            free(obj.made.data);
            obj.made.data = NULL;
        }
        status = finish_scene(&obj, error);
    }
    free(obj.points.data);
    free(obj.uvs.data);
    free(obj.made.data);
    free(obj.runs.data);
    umbb_faces_finish(&obj.faces);
    umbb_material_table_finish(&obj.materials);
    umbb_texture_table_finish(&obj.textures);
    return status;
}

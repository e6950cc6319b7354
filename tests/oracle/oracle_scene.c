/* SPDX-License-Identifier: Apache-2.0 */
/* The oracle's scene readers: see oracle_scene.h. */
#include "oracle_scene.h"

#include <errno.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <math.h>

enum {
    PLY_VERTEX_SIZE = 24,
    PLY_FACE_SIZE = 13,
    LINE_SIZE = 512,
};

static const size_t count_limit = (size_t)1 << 28;

static int refuse(char error[ORACLE_SCENE_ERROR_SIZE], const char *path, const char *reason)
{
    (void)snprintf(error, ORACLE_SCENE_ERROR_SIZE, "%s: %s", path, reason);
    return 0;
}

uint8_t *oracle_file_read(const char *path, size_t *size, char error[ORACLE_SCENE_ERROR_SIZE])
{
    FILE *file = fopen(path, "rb");
    uint8_t *bytes = NULL;
    long length = -1;
    *size = 0;
    if (file != NULL && fseek(file, 0, SEEK_END) == 0) {
        length = ftell(file);
    }
    if (length >= 0 && fseek(file, 0, SEEK_SET) == 0) {
        bytes = malloc((size_t)length + 1);
    }
    if (bytes != NULL && fread(bytes, 1, (size_t)length, file) != (size_t)length) {
        free(bytes);
        bytes = NULL;
    }
    if (bytes == NULL) {
        (void)refuse(error, path, errno != 0 ? strerror(errno) : "cannot be read");
    } else {
        bytes[length] = '\0'; /* so that text can be scanned as a string */
        *size = (size_t)length;
    }
    if (file != NULL) {
        (void)fclose(file);
    }
    return bytes;
}

static uint32_t u32_at(const uint8_t *bytes)
{
    return (uint32_t)bytes[0] | (uint32_t)bytes[1] << 8 | (uint32_t)bytes[2] << 16 |
           (uint32_t)bytes[3] << 24;
}

static double f64_at(const uint8_t *bytes)
{
    uint64_t bits = (uint64_t)u32_at(bytes) | (uint64_t)u32_at(bytes + 4) << 32;
    double value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

static int make_room(struct oracle_scene *scene, size_t vertices, size_t triangles)
{
    if (vertices > count_limit || triangles > count_limit) {
        return 0;
    }
    scene->vertices = calloc(vertices + 1, sizeof *scene->vertices);
    scene->triangles = calloc(triangles + 1, sizeof *scene->triangles);
    scene->closed = calloc(triangles + 1, 1);
    return scene->vertices != NULL && scene->triangles != NULL && scene->closed != NULL;
}

/* Every index in range, every coordinate a number. */
static int is_sound(const struct oracle_scene *scene)
{
    for (size_t i = 0; i < scene->vertex_count; i++) {
        for (int k = 0; k < 3; k++) {
            if (!isfinite(scene->vertices[i][k])) {
                return 0;
            }
        }
    }
    for (size_t i = 0; i < scene->triangle_count; i++) {
        for (int k = 0; k < 3; k++) {
            if (scene->triangles[i][k] >= scene->vertex_count) {
                return 0;
            }
        }
    }
    return scene->triangle_count > 0;
}

/*
 * Checks that a header is one that scenegen writes, apart from comments. Returns its length, or 0.
 * The properties must be those of scenegen in their order, since this reader was made for such
 * scenes only.
 */
static size_t ply_header(const char *text, size_t size, size_t *vertices, size_t *triangles)
{
    static const char *const expected[] = {"ply",
                                           "format binary_little_endian 1.0",
                                           "element vertex ",
                                           "property double x",
                                           "property double y",
                                           "property double z",
                                           "element face ",
                                           "property list uchar uint vertex_indices",
                                           "end_header"};
    size_t at = 0, step = 0;
    while (step < sizeof expected / sizeof expected[0]) {
        const char *end = memchr(text + at, '\n', size - at);
        if (end == NULL) {
            return 0;
        }
        const char *line = text + at;
        size_t length = (size_t)(end - line), wanted = strlen(expected[step]);
        at += length + 1;
        if (length >= 7 && memcmp(line, "comment", 7) == 0) {
            continue;
        }
        int takes_count = expected[step][wanted - 1] == ' ';
        if (length < wanted || memcmp(line, expected[step], wanted) != 0 ||
            (!takes_count && length != wanted)) {
            return 0;
        }
        if (takes_count) {
            *(step == 2 ? vertices : triangles) = (size_t)strtoull(line + wanted, NULL, 10);
        }
        step++;
    }
    return at;
}

static int read_ply(struct oracle_scene *scene, const uint8_t *bytes, size_t size)
{
    size_t vertices = 0, triangles = 0;
    size_t at = ply_header((const char *)bytes, size, &vertices, &triangles);
    if (at == 0 || !make_room(scene, vertices, triangles) ||
        size - at != vertices * PLY_VERTEX_SIZE + triangles * PLY_FACE_SIZE) {
        return 0;
    }
    scene->vertex_count = vertices;
    scene->triangle_count = triangles;
    for (size_t i = 0; i < vertices * 3; i++) {
        scene->vertices[i / 3][i % 3] = f64_at(bytes + at + i * 8);
    }
    at += vertices * PLY_VERTEX_SIZE;
    for (size_t i = 0; i < triangles; i++, at += PLY_FACE_SIZE) {
        if (bytes[at] != 3) {
            return 0;
        }
        for (size_t k = 0; k < 3; k++) {
            scene->triangles[i][k] = u32_at(bytes + at + 1 + 4 * k);
        }
    }
    return 1;
}

static int obj_vertex(struct oracle_scene *scene, const char *text)
{
    double *vertex = scene->vertices[scene->vertex_count];
    for (int k = 0; k < 3; k++) {
        char *end;
        vertex[k] = strtod(text, &end);
        if (end == text) {
            return 0;
        }
        text = end;
    }
    scene->vertex_count++;
    return 1;
}

/* `i`, `i/t`, `i/t/n` or `i//n`, three times; negative numbers count back. */
static int obj_face(struct oracle_scene *scene, const char *text)
{
    uint32_t *triangle = scene->triangles[scene->triangle_count];
    for (int k = 0; k < 3; k++) {
        char *end;
        long long number = strtoll(text, &end, 10);
        long long index = number < 0 ? (long long)scene->vertex_count + number : number - 1;
        if (end == text || index < 0 || index >= UINT32_MAX) {
            return 0;
        }
        triangle[k] = (uint32_t)index;
        text = end + strcspn(end, " \t\r\n");
    }
    text += strspn(text, " \t\r");
    scene->triangle_count++;
    return *text == '\0';
}

/* Copies the line that begins at `text`; returns where the next one begins, or NULL. */
static const char *take_line(const char *text, char line[LINE_SIZE])
{
    const char *end = strchr(text, '\n');
    size_t length = end != NULL ? (size_t)(end - text) : strlen(text);
    if (length >= LINE_SIZE) {
        length = LINE_SIZE - 1;
    }
    memcpy(line, text, length);
    line[length] = '\0';
    return end != NULL ? end + 1 : NULL;
}

static int read_obj(struct oracle_scene *scene, const char *text)
{
    char line[LINE_SIZE];
    size_t vertices = 0, triangles = 0;
    for (const char *at = text; at != NULL; at = take_line(at, line)) {
        vertices += at[0] == 'v' && at[1] == ' ';
        triangles += at[0] == 'f' && at[1] == ' ';
    }
    if (!make_room(scene, vertices, triangles)) {
        return 0;
    }
    for (const char *at = text; at != NULL;) {
        at = take_line(at, line);
        if (line[0] == 'v' && line[1] == ' ' && !obj_vertex(scene, line + 2)) {
            return 0;
        }
        if (line[0] == 'f' && line[1] == ' ' && !obj_face(scene, line + 2)) {
            return 0;
        }
    }
    return 1;
}

int oracle_scene_read(struct oracle_scene *scene, const char *path,
                      char error[ORACLE_SCENE_ERROR_SIZE])
{
    *scene = (struct oracle_scene){0};
    size_t size;
    uint8_t *bytes = oracle_file_read(path, &size, error);
    if (bytes == NULL) {
        return 0;
    }
    const char *ending = strrchr(path, '.');
    int good;
    if (ending != NULL && strcmp(ending, ".ply") == 0) {
        good = read_ply(scene, bytes, size);
    } else if (ending != NULL && strcmp(ending, ".obj") == 0) {
        good = read_obj(scene, (const char *)bytes);
    } else {
        free(bytes);
        return refuse(error, path, "the name ends neither in .ply nor in .obj");
    }
    free(bytes);
    if (!good || !is_sound(scene)) {
        return refuse(error, path, "not a scene of triangles as scenegen writes them");
    }
    return 1;
}

void oracle_scene_finish(struct oracle_scene *scene)
{
    free(scene->vertices);
    free(scene->triangles);
    free(scene->closed);
    *scene = (struct oracle_scene){0};
}

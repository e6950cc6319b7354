/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_ORACLE_SCENE_H
#define UMBRAGE_TESTS_ORACLE_SCENE_H
/*
 * Scenes for the oracle, read without umbrage's importers: PLY as tests/scenes/scenegen writes it
 * (binary little-endian, double x y z, lists of uchar and uint) and OBJ (v and f). Triangles only.
 */
#include <stddef.h>
#include <stdint.h>

enum {
    ORACLE_SCENE_ERROR_SIZE = 256,
};

struct oracle_scene {
    double (*vertices)[3];
    uint32_t (*triangles)[3];
    uint8_t *closed; /* a triangle: part of a closed outward solid */
    size_t vertex_count, triangle_count;
};

/* Fails: 0 with a sentence in `error`; finish the scene all the same. */
int oracle_scene_read(struct oracle_scene *scene, const char *path,
                      char error[ORACLE_SCENE_ERROR_SIZE]);

/*
 * Finds which parts are closed solids whose faces look outward. A part is what shared edges
 * connect, vertices compared by exact position; triangles without area belong to none. It is closed
 * if every edge is used twice, once in each direction (umb-format.md, section 1), and outward if it
 * encloses a positive volume. 0 if there is no memory.
 */
int oracle_scene_find_closed(struct oracle_scene *scene);

void oracle_scene_finish(struct oracle_scene *scene);

/* A whole file in memory, to free; NULL with a sentence in `error`. */
uint8_t *oracle_file_read(const char *path, size_t *size, char error[ORACLE_SCENE_ERROR_SIZE]);

#endif

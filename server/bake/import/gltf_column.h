/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_IMPORT_GLTF_COLUMN_H
#define UMBRAGE_SERVER_BAKE_IMPORT_GLTF_COLUMN_H
/*
 * Numbers of glTF accessors. Assimp does not give access to accessors of extensions.
 *
 *     struct umbb_gltf_columns columns = {0};
 *     umbb_gltf_columns_find(&columns, job, kind, &error);
 *     umbb_gltf_column_open(&columns, accessor, 3, &column, &error);
 *     umbb_gltf_column_get(&column, i, numbers)        i below column.count
 *     umbb_gltf_columns_finish(&columns);              closes all columns
 *
 * Source: glTF 2.0 specification, sections 3.6 and 4.4.
 */
#include "bake/import/import_job.h"

struct umbb_gltf_columns {
    const struct umbb_import *job;
    struct umbs_array accessors, views, buffers;
};

/* An accessor's elements, in place. */
struct umbb_gltf_column {
    const char *bytes;
    size_t stride;
    uint32_t count;
    uint32_t width; /* numbers an element, 1..4 */
    int32_t component;
};

/* Lists accessors, views and buffers. Fails: E_NO_MEMORY. Trust: safe on hostile bytes. */
UMB_CHECKED enum umb_status umbb_gltf_columns_find(struct umbb_gltf_columns *columns,
                                                   const struct umbb_import *job,
                                                   enum umbb_kind kind, struct umb_error *error);
void umbb_gltf_columns_finish(struct umbb_gltf_columns *columns);

/*
 * Finds an accessor's bytes; opens the file that contains them.
 *
 * In:    width: expected numbers an element, 3 or 4.
 * Fails: E_BAD_SCENE naming the accessor (missing, of another type, sparse, outside of its view's
 *        or buffer's bytes, in an unsupported form), E_NO_MEMORY.
 * Trust: safe on hostile bytes.
 */
UMB_CHECKED enum umb_status umbb_gltf_column_open(struct umbb_gltf_columns *columns,
                                                  int64_t accessor, uint32_t width,
                                                  struct umbb_gltf_column *column,
                                                  struct umb_error *error);

/* Reads an element: floats unchanged, integers normalised to -1..1.
 * Out: numbers: double[column->width]. */
void umbb_gltf_column_get(const struct umbb_gltf_column *column, size_t index, double *numbers);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_SCENE_PARTS_WELD_H
#define UMBRAGE_SERVER_SCENE_PARTS_WELD_H
/* Welding: corners of a triangle soup at bit-equal positions (-0 being 0) are one vertex. */
#include <stddef.h>
#include <stdint.h>
#include "umbrage/status.h"

/* Most triangles that corners numbered in 32 bits allow. */
#define UMBS_WELD_TRIANGLES_MAX ((size_t)((UINT32_MAX - 1) / 3))

/*
 * Numbers the vertices of a soup in order of their first corner.
 *
 * In:    corners: double[count][3][3], any bits; count: 0..UMBS_WELD_TRIANGLES_MAX.
 * Out:   vertex_of: uint32[3 * count], the vertex of corner 3 * triangle + k; free with umb__free.
 *        vertex_count: number of vertices.
 * Fails: E_NO_MEMORY.
 * Cost:  O(count) expected; 12 bytes a triangle stay, up to 64 more while it runs.
 * Guaranteed: the result does not depend on the hash's seed, which differs from run to run so that
 *        no file can be made to collide.
 */
UMB_CHECKED enum umb_status umbs_weld(const double (*corners)[3][3], size_t count,
                                      uint32_t **vertex_of, uint32_t *vertex_count,
                                      struct umb_error *error);

#endif

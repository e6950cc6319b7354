/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_BAKE_TRANSMITTANCE_H
#define UMBRAGE_SERVER_BAKE_BAKE_TRANSMITTANCE_H
/*
 * The maps of translucent casters of all frusta (depth/transmittance_make.h), as an asset's head
 * stores them.
 *
 * Every reader of an asset loads its head, so the maps are kept small. A map has at most 2048
 * texels a side, and no more than the frustum has voxels. If the maps of all frusta take more than
 * 16 MiB together, all are made again with half the texels a side. Coarse maps suffice, because the
 * shadows of such casters have soft edges: hair, glass and smoke fade in depth and by their
 * textures.
 */
#include "bake/analysis/analysis.h"
#include "bake/options/bake_options.h"
#include "format/transmittance.h"

#define UMBB_TRANSMITTANCE_BYTES_MAX ((size_t)16 << 20)

/*
 * Makes the entry of the asset's head that holds the maps of all frusta.
 *
 * In:    analysis: read for its translucent triangles. working_bytes: limit of lists of triangles
 *        and fragments.
 * Out:   bytes: the entry, or empty if nothing is translucent; to be finished after any result.
 *        level: log2 of the texels a side of the largest maps; 0: there are no maps.
 * Fails: E_LIMIT (no map is small enough, --memory), E_NO_MEMORY, E_CANCELLED.
 */
UMB_CHECKED enum umb_status umbb_transmittance_bake(const struct umbb_analysis *analysis,
                                                    const struct umbb_options *options,
                                                    size_t working_bytes,
                                                    struct umb__transmittance_bytes *bytes,
                                                    uint32_t *level, struct umb_error *error);

#endif

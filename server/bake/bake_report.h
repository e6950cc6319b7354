/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_BAKE_REPORT_H
#define UMBRAGE_SERVER_BAKE_BAKE_REPORT_H
/* The report of a finished bake: as text, or as one JSON object. */
#include <stdio.h>
#include "bake/analysis/analysis.h"
#include "bake/build/tile_loop.h"
#include "bake/write/publish.h"

struct umbb_report {
    const struct umbb_options *options;
    const struct umbb_analysis *analysis;
    const struct umbb_publish *publish;
    struct umbb_bake_figures figures;
    uint32_t tile_log2;
    uint32_t transmittance_level; /* 2^level texels a side of maps of translucent casters, or 0 */
    uint64_t damaged_tiles;       /* tiles found damaged in the cache, removed and baked again */
    uint64_t base_tiles;          /* tiles of the octree of an earlier bake */
    const char *depth_path;
    double seconds_import, seconds_analysis, seconds_bake, seconds_write, seconds_verify;
    double seconds_total;
};

void umbb_report_print(FILE *to, const struct umbb_report *report);
void umbb_report_print_json(FILE *to, const struct umbb_report *report);

/* Prints the report of task tile, in either form. */
void umbb_report_print_tiles(FILE *to, const struct umbb_report *report);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_IMPORT_MTL_READER_H
#define UMBRAGE_SERVER_BAKE_IMPORT_MTL_READER_H
/* The statements of Wavefront MTL that affect shadows: d, Tr, map_d. */
#include "bake/import/import_files.h"
#include "bake/import/material_table.h"
#include "bake/import/texture_table.h"
#include "bake/import/text_number.h"

/* Takes one line off the cursor, without its end; returns 0 at the end of the text. */
int umbb_take_line(struct umbb_cursor *text, struct umbb_cursor *line);

/* The rest of a line without blanks around it; names may contain blanks. */
struct umbb_cursor umbb_trim(struct umbb_cursor line);

/*
 * Reads a material library.
 *
 * d (or 1 - Tr if there is no d) below 1 makes a material BLEND with that alpha. map_d makes it
 * MASK at 0.5, by the alpha of its PNG or else by its grey. Of map_d's options -clamp is supported;
 * a map that is moved, scaled or perturbed (-o, -s, -t, -mm, -imfchan) is left out with a warning.
 * All other statements are skipped.
 * Fails: E_LIMIT, E_NO_MEMORY. Trust: safe on hostile bytes.
 */
UMB_CHECKED enum umb_status umbb_mtl_read(const struct umbb_file *file,
                                          struct umbb_material_table *table,
                                          struct umbb_texture_table *textures,
                                          struct umb_error *error);

#endif

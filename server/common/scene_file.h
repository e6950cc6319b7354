/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_COMMON_SCENE_FILE_H
#define UMBRAGE_SERVER_COMMON_SCENE_FILE_H
/*
 * A validated scene in a file: imported once, baked in parts by many processes.
 *
 * File: magic "UMBSCF1\n", XXH3-64 of what follows (uint64, little-endian), the scene buffer
 * (scene_buffer.h). A scratch file between programs of one version, not an exchange format. The
 * reader trusts nothing in it: it is copied before it is checked, by the same validator that checks
 * what the importer leaves.
 */
#include "common/scene.h"

/* Writes a scene to a file that appears whole or not at all. Fails: E_CANNOT_CREATE, E_IO. */
UMB_CHECKED enum umb_status umbs_scene_save(const struct umbs_scene *scene, const char *path,
                                            struct umb_error *error);

/*
 * Reads a scene of either kind: a file of umbs_scene_save by its first bytes, anything else by
 * umbs_scene_import.
 *
 * Fails: as umbs_scene_import; E_BAD_SCENE also for a damaged file.
 * Trust: safe on hostile bytes, also if they change meanwhile.
 */
UMB_CHECKED enum umb_status umbs_scene_open(const char *path,
                                            const struct umbs_import_options *options,
                                            struct umbs_scene **out, struct umb_error *error);

#endif

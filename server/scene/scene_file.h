/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_SCENE_SCENE_FILE_H
#define UMBRAGE_SERVER_SCENE_SCENE_FILE_H
/*
 * A validated scene in a file: imported once, baked in parts by many processes of one user.
 *
 * Layout: magic "UMBSCF1\n", XXH3-64 of what follows (uint64, little-endian), the scene buffer
 * (scene_buffer.h). It is a scratch file between programs of one version, not an exchange format.
 *
 * The checksum protects against damage only: anyone can make such a file. So no program recognises
 * the form by its bytes. A caller asks for it by an option, and only files that its own user wrote
 * are read (private_folder.h). The reader copies the bytes and checks them with the validator of
 * the importer's output.
 */
#include "scene/scene.h"

#define UMBS_SCENE_FILE_MAGIC       "UMBSCF1\n"
#define UMBS_SCENE_FILE_MAGIC_BYTES 8

/* Writes a scene to a file that appears whole or not at all, with mode 0600. Fails:
 * E_CANNOT_CREATE, E_IO. */
UMB_CHECKED enum umb_status umbs_scene_save(const struct umbs_scene *scene, const char *path,
                                            struct umb_error *error);

/*
 * Reads a file of umbs_scene_save. options: max_memory_bytes, max_triangles and shut_in are used.
 *
 * In:    what: the option that named the file, for messages.
 * Fails: E_NO_INPUT and E_PERMISSION as umbs_private_open; E_BAD_SCENE (not such a file, cut,
 *        damaged, or with a number that the validator refuses); E_LIMIT; a failure of shut_in.
 * Trust: safe on hostile bytes, also if they change meanwhile.
 */
UMB_CHECKED enum umb_status umbs_scene_load(const char *what, const char *path,
                                            const struct umbs_import_options *options,
                                            struct umbs_scene **out, struct umb_error *error);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_IMPORT_IMPORT_JOB_H
#define UMBRAGE_SERVER_BAKE_IMPORT_IMPORT_JOB_H
/*
 * The importer's process: all parsing of foreign scene bytes, and nothing else, runs here.
 *
 *     umbrage-bake import-child NAME MAX_MEMORY MAX_INPUT MAX_TRIANGLES
 *
 * Started by umbs_scene_import only, never by hand. Descriptors (scene_contract.h):
 *     0, 1  /dev/null
 *     2     gets at most one line: the message that says why the scene is refused
 *     3     the scene file
 *     4     a socket to ask for the files that the scene names (.mtl, .bin): the parent opens them
 *           beneath the scene's folder by relative names; absolute names, "..", and symbolic links
 *           that leave it are refused (scene/scene_broker.h)
 *     5     an empty memfd; gets the scene buffer (scene_buffer.h)
 *
 * Exit codes: 0 the buffer is complete; 65 the scene cannot be used; 74 reading or writing failed;
 * 75 over a limit of memory, size or triangles; 69 no sandbox, so nothing was read; 2 called
 * wrongly. Signal SIGSYS: the sandbox forbids a call that was made (bake/sandbox/sandbox.h).
 *
 * Formats, by extension: .gltf .glb .obj .ply .stl. The readers are our own and keep
 * doubles; JSON goes through Jansson, images through libpng. World space: metres; y up for glTF, z
 * up for the others. Texture coordinates: v grows upwards, for all formats.
 */
#include "bake/import/import_files.h"
#include "scene/scene_builder.h"

/*
 * One import inside the importer's process, and its readers. Each reader appends meshes, materials,
 * lights and instances to job->scene.
 *
 * Status of readers: E_BAD_SCENE with a message without the file's name (umbb_import_child puts it
 * in front), E_NO_MEMORY, E_LIMIT. An unusable face (a corner that is not finite, a bad index,
 * fewer than 3 corners) is dropped and counted, never an error by itself.
 * Trust: readers are safe on hostile bytes.
 */
struct umbb_import {
    struct umbb_file file;     /* the scene file */
    struct umbb_folder folder; /* folder of the files that the scene names */
    uint64_t max_input_bytes;  /* limit of every file */
    struct umbs_scene_builder scene;
};

/* Readers: of Wavefront OBJ; PLY; STL; glTF and GLB. */
UMB_CHECKED enum umb_status umbb_obj_read(struct umbb_import *job, struct umb_error *error);
UMB_CHECKED enum umb_status umbb_ply_read(struct umbb_import *job, struct umb_error *error);
UMB_CHECKED enum umb_status umbb_stl_read(struct umbb_import *job, struct umb_error *error);
UMB_CHECKED enum umb_status umbb_gltf_read(struct umbb_import *job, struct umb_error *error);

/*
 * Runs the importer; argv as the process got it, argv[1] is "import-child".
 *
 * Out:   returns the exit code. End the process after it: limits stay set.
 * Trust: safe on hostile scene files. The sandbox holds if a reader or a library fails.
 */
int umbb_import_child(int argc, char **argv);

#endif

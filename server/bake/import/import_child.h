/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_IMPORT_IMPORT_CHILD_H
#define UMBRAGE_SERVER_BAKE_IMPORT_IMPORT_CHILD_H
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
 * Formats, by extension and content: .gltf .glb .obj .ply .stl. The readers are our own and keep
 * doubles; JSON goes through Jansson, images through libpng. World space: metres; y up for glTF, z
 * up for the others. Texture coordinates: v grows upwards, for all formats.
 */

/*
 * Runs the importer; argv as the process got it, argv[1] is "import-child".
 *
 * Out:   returns the exit code. End the process after it: limits stay set.
 * Trust: safe on hostile scene files. The sandbox holds if a reader or a library fails.
 */
int umbb_import_child(int argc, char **argv);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_IMPORT_IMPORT_JOB_H
#define UMBRAGE_SERVER_BAKE_IMPORT_IMPORT_JOB_H
/*
 * The importer's process: all parsing of foreign scene bytes, and nothing else, runs here.
 *
 *     umbrage-bake import-child NAME MAX_MEMORY MAX_INPUT MAX_TRIANGLES LOOK
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
 * Formats, by extension: .gltf .glb .obj .ply .stl. The readers are our own and keep doubles; JSON
 * goes through Jansson, images through libpng. World space: metres; y up for glTF, z up for the
 * others. Texture coordinates: v grows upwards, for all formats.
 */
#include "bake/import/text_number.h"
#include "scene/scene_builder.h"

/* A file, mapped read only. A file that shrinks while it is mapped kills the importer's process,
 * and only that. */
struct umbb_file {
    const char *bytes; /* content, not NUL-terminated; never NULL once mapped */
    size_t size;
    void *map; /* memory to unmap; NULL if size is 0 */
};

/*
 * Source of the files that a scene names: a folder (umbs_open_beneath), or the parent process,
 * which opens them for an importer that may open nothing (umbs_broker_open).
 */
struct umbb_folder {
    int handle;
    int (*open)(int handle, const char *name); /* a regular file's descriptor, or -1 and errno */
};

/* One import inside the importer's process. */
struct umbb_import {
    struct umbb_file file;     /* the scene file */
    struct umbb_folder folder; /* folder of the files that the scene names */
    uint64_t max_input_bytes;  /* limit of every file */
    int look;                  /* 1: reads normals, too */
    struct umbs_scene_builder scene;
};

/* Maps the regular file behind a descriptor. Fails: E_LIMIT (more than max_bytes), E_IO,
 * E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbb_file_map(int fd, uint64_t max_bytes, struct umbb_file *file,
                                          struct umb_error *error);

/*
 * Opens and maps a file that the scene names.
 *
 * In:    name: as in the scene; '\' counts as '/'.
 * Fails: E_PERMISSION (absolute, "..", leaves the folder, a symbolic link out of it), E_NOT_FOUND
 *        (missing, or not a regular file), E_LIMIT, E_IO, E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbb_file_map_named(const struct umbb_import *job,
                                                struct umbb_cursor name, struct umbb_file *file,
                                                struct umb_error *error);

/* Does umbb_file_map_named for a name that may be percent-encoded, as URIs of glTF are (RFC 3986).
 * The literal name is tried first, then the decoded one. */
UMB_CHECKED enum umb_status umbb_file_map_uri(const struct umbb_import *job, struct umbb_cursor uri,
                                              struct umbb_file *file, struct umb_error *error);

/* Unmaps the file. No effect on a zeroed struct. */
void umbb_file_unmap(struct umbb_file *file);

/* The file's bytes as text. */
struct umbb_cursor umbb_text_of(const struct umbb_file *file);

/* 1 if the file begins without a NUL, as text does. */
int umbb_is_text(const struct umbb_file *file);

/* Fails because the scene cannot be used, with a message. */
#define UMBB_REFUSE(error, ...) umb_fail(error, UMB_E_BAD_SCENE, __VA_ARGS__)

/*
 * Readers of scene files: Wavefront OBJ; PLY; STL; glTF and GLB. Each appends meshes, materials,
 * lights and instances to job->scene.
 *
 * Fails: E_BAD_SCENE with a message without the file's name (umbb_import_child puts it in front),
 *        E_NO_MEMORY, E_LIMIT. An unusable face (a corner that is not finite, a bad index, fewer
 *        than 3 corners) is dropped and counted, never an error by itself.
 * Trust: safe on hostile bytes.
 */
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

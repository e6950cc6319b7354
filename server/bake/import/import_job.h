/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_IMPORT_IMPORT_JOB_H
#define UMBRAGE_SERVER_BAKE_IMPORT_IMPORT_JOB_H
/*
 * One import inside the importer's process, and its readers. Each reader appends meshes, materials,
 * lights and instances to job->scene.
 *
 * Status of readers: E_BAD_SCENE with a message without the file's name (umbb_import_child puts it
 * in front), E_NO_MEMORY, E_LIMIT. An unusable face (a corner that is not finite, a bad index,
 * fewer than 3 corners) is dropped and counted, never an error by itself.
 * Trust: readers are safe on hostile bytes.
 */
#include "bake/import/import_files.h"
#include "scene/scene_builder.h"

struct umbb_import {
    struct umbb_file file;     /* the scene file */
    struct umbb_folder folder; /* folder of the files that it names */
    uint64_t max_input_bytes;  /* limit of every file */
    struct umbs_scene_builder scene;
};

/* Readers: of Wavefront OBJ; PLY; STL; glTF and GLB. */
UMB_CHECKED enum umb_status umbb_obj_read(struct umbb_import *job, struct umb_error *error);
UMB_CHECKED enum umb_status umbb_ply_read(struct umbb_import *job, struct umb_error *error);
UMB_CHECKED enum umb_status umbb_stl_read(struct umbb_import *job, struct umb_error *error);
UMB_CHECKED enum umb_status umbb_gltf_read(struct umbb_import *job, struct umb_error *error);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Hostile OBJ and PLY files through our own readers, and the instances of glTF (Assimp is not ours
 * to fuzz here: it lives in the sandbox). The first byte picks the format. What a reader accepts
 * must survive being written as a scene buffer and validated.
 */
#include <fcntl.h>
#include <string.h>
#include <unistd.h>

#include "bake/import/gltf_instances.h"
#include "bake/import/import_job.h"
#include "common/open_beneath.h"
#include "scene/scene.h"
#include "fuzz.h"
#include "make_asset.h"

#define PLACES_MAX 1000U /* of a node that are looked at, beside the last */

/* Every place of every node that can be opened. */
static enum umb_status read_instances(const struct umbb_import *job, enum umbb_kind kind)
{
    struct umbb_gltf_instances instances = {0};
    enum umb_status status = umbb_gltf_instances_find(&instances, job, kind, NULL);
    const size_t nodes = status == UMB_OK ? instances.nodes.count : 0;
    (void)umbb_gltf_child(&instances, umbb_gltf_root(&instances), 0);
    for (uint32_t node = 0; node < nodes; node++) {
        struct umbb_gltf_places places;
        double local[3][4];
        const size_t children = umbb_gltf_child_count(&instances, node);
        (void)umbb_gltf_child(&instances, node, children > 0 ? children - 1 : 0);
        if (umbb_gltf_places_open(&instances, node, &places, NULL) != UMB_OK) {
            continue;
        }
        for (uint32_t i = 0; i < places.count && i < PLACES_MAX; i++) {
            (void)umbb_gltf_place(&places, i, local);
        }
        if (places.count > 0) {
            (void)umbb_gltf_place(&places, places.count - 1, local);
        }
    }
    umbb_gltf_instances_finish(&instances);
    return UMB_E_BAD_SCENE; /* nothing was added to the scene */
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    if (size < 1) {
        return 0;
    }
    char *text = malloc(size); /* exactly as long as the file, for the sanitizer */
    int folder = open("/nonexistent", O_RDONLY);
    if (!text) {
        return 0;
    }
    memcpy(text, data + 1, size - 1);
    int is_ply = data[0] & 1;
    struct umbb_import job = {.file = {.bytes = text, .size = size - 1},
                              .folder = {folder, umbs_open_beneath},
                              .max_input_bytes = 1 << 20};
    umbs_scene_builder_init(&job.scene, is_ply ? UMBS_FORMAT_PLY : UMBS_FORMAT_OBJ, 1, 1 << 20);
    enum umb_status status = (data[0] & 2) != 0
                                 ? read_instances(&job, is_ply ? UMBB_KIND_GLB : UMBB_KIND_GLTF)
                             : is_ply ? umbb_ply_read(&job, NULL)
                                      : umbb_obj_read(&job, NULL);
    struct bytes buffer = {0};
    struct umb_sink sink = bytes_sink(&buffer);
    if (status == UMB_OK && umbs_scene_builder_write(&job.scene, &sink, NULL) == UMB_OK) {
        struct umbs_scene_view view;
        struct umb_error error = {0};
        status = umbs_scene_view(buffer.data, buffer.size, &view, &error);
        FUZZ_DEMAND(status == UMB_OK || view.triangle_count == 0);
    }
    bytes_finish(&buffer);
    umbs_scene_builder_finish(&job.scene);
    free(text);
    return 0;
}

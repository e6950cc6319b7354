/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Hostile scene files of all formats. The first byte picks the reader. What a reader accepts must
 * survive being written as a scene buffer and validated.
 */
#include <fcntl.h>
#include <string.h>
#include <unistd.h>

#include "bake/import/import_job.h"
#include "common/open_beneath.h"
#include "scene/scene.h"
#include "fuzz.h"
#include "make_asset.h"

static enum umb_status read_scene(struct umbb_import *job, unsigned format)
{
    switch (format) {
    case 0:
        return umbb_obj_read(job, NULL);
    case 1:
        return umbb_ply_read(job, NULL);
    case 2:
    case 3:
        return umbb_gltf_read(job, NULL);
    default:
        return umbb_stl_read(job, NULL);
    }
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
    struct umbb_import job = {.file = {.bytes = text, .size = size - 1},
                              .folder = {folder, umbs_open_beneath},
                              .max_input_bytes = 1 << 20,
                              .look = 1};
    umbs_scene_builder_init(&job.scene, UMBS_FORMAT_OBJ, 1, 1 << 20);
    enum umb_status status = read_scene(&job, data[0] & 7U);
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

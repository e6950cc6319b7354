/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Hostile images, from the importer's decoder to the samples that a bake takes. 28 bytes say how
 * the image is shown (channel, wraps, filter, cut-off, factor, six texture coordinates as floats);
 * the rest is a PNG, whose checksums are set right first: they keep only a fuzzer out. What
 * is decoded must survive being written as a scene buffer, validated, and sampled anywhere.
 */
#include <fcntl.h>
#include <math.h>
#include <string.h>
#include <unistd.h>

#include "bake/import/import_job.h"
#include "bake/import/texture_table.h"
#include "bake/import/texture_table.h"
#include "common/open_beneath.h"
#include "scene/scene_alpha.h"
#include "fuzz.h"
#include "make_asset.h"

enum {
    HOW_BYTES = 28,
    TEXELS_MAX = 1 << 20
};

static uint32_t crc_of(const uint8_t *bytes, size_t size)
{
    uint32_t crc = UINT32_MAX;
    for (size_t i = 0; i < size; i++) {
        crc ^= bytes[i];
        for (int bit = 0; bit < 8; bit++) {
            crc = crc >> 1 ^ (crc & 1 ? 0xedb88320U : 0);
        }
    }
    return ~crc;
}

/* Chunks are a length, a kind, so many bytes, and a checksum of the last two. */
static void set_checksums(uint8_t *png, size_t size)
{
    for (size_t at = 8; size > at && size - at >= 12;) {
        const size_t length = (size_t)png[at] << 24 | (size_t)png[at + 1] << 16 |
                              (size_t)png[at + 2] << 8 | png[at + 3];
        if (length > size - at - 12) {
            return;
        }
        const uint32_t crc = crc_of(png + at + 4, length + 4);
        for (size_t k = 0; k < 4; k++) {
            png[at + 8 + length + k] = (uint8_t)(crc >> (24 - 8 * k));
        }
        at += 12 + length;
    }
}

/* A coordinate as a reader would let it through. */
static float coordinate(const uint8_t *bytes)
{
    float value;
    memcpy(&value, bytes, sizeof value);
    return isfinite(value) && fabsf(value) <= 1e30F ? value : 0.5F;
}

/* One triangle that shows the texture. */
static enum umb_status add_triangle(struct umbs_scene_builder *scene, const uint8_t *how,
                                    uint32_t texture)
{
    static const double corners[3][3] = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
    static const uint32_t order[3] = {0, 1, 2};
    struct umbs_material material = umbs_material_opaque();
    material.alpha_mode = UMBS_ALPHA_MASK;
    material.alpha_cutoff = (float)how[1] / 255.0F;
    material.base_alpha = (float)how[2] / 255.0F;
    material.texture = texture;
    enum umb_status status = umbs_scene_add_material(scene, &material, NULL);
    for (int k = 0; k < 3 && status == UMB_OK; k++) {
        const float uv[2] = {coordinate(how + 4 + 8 * k), coordinate(how + 8 + 8 * k)};
        status = umbs_scene_add_vertex(scene, corners[k], uv, NULL);
    }
    status = status == UMB_OK ? umbs_scene_add_triangle(scene, order, NULL) : status;
    status = status == UMB_OK ? umbs_scene_end_mesh(scene, 0, 3, 1, 0, NULL) : status;
    return status == UMB_OK ? umbs_scene_add_instance(scene, 0, NULL, NULL) : status;
}

static void sample(const struct umbs_scene_view *view, const uint8_t *how)
{
    static const double far[] = {0.0, -0.0, 0.5, 1.0, -1.0, 1e30, -1e30, 4.9e-324};
    struct umbs_cuts cuts;
    FUZZ_DEMAND(view->texture_count == 1);
    for (size_t i = 0; i < 64; i++) {
        const double alpha = umbs_alpha_at(view, view->textures, far[i % 8], far[i / 8]);
        FUZZ_DEMAND(alpha >= 0.0 && alpha <= 255.0);
    }
    FUZZ_DEMAND(umbs_cuts_find(view, &cuts, NULL) == UMB_OK);
    for (int k = 0; k < 3 && cuts.count > 0; k++) {
        const int keeps = umbs_cut_keeps(&cuts, 0, (double)coordinate(how + 4 + 8 * k),
                                         (double)coordinate(how + 8 + 8 * k));
        FUZZ_DEMAND(keeps == 0 || keeps == 1);
    }
    umbs_cuts_finish(&cuts);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    if (size < HOW_BYTES) {
        return 0;
    }
    const size_t png_size = size - HOW_BYTES;
    uint8_t *png = malloc(png_size > 0 ? png_size : 1); /* as long as the file, for the sanitizer */
    if (png == NULL) {
        return 0;
    }
    memcpy(png, data + HOW_BYTES, png_size);
    set_checksums(png, png_size);
    struct umbb_import job = {.folder = {open("/nonexistent", O_RDONLY), umbs_open_beneath},
                              .max_input_bytes = 1 << 20};
    struct umbb_texture_table table = {.job = &job};
    const struct umbb_image image = {.name = "*0",
                                     .name_length = 2,
                                     .bytes = png,
                                     .size = png_size,
                                     .luminance = data[0] & 1,
                                     .wrap_s = (uint32_t)(data[0] >> 1 & 3) % 3,
                                     .wrap_t = (uint32_t)(data[0] >> 3 & 3) % 3,
                                     .nearest = data[0] >> 5 & 1};
    uint32_t index;
    umbs_scene_builder_init(&job.scene, UMBS_FORMAT_GLTF, 0, 1 << 20);
    table.texels = UMBB_IMAGES_TEXELS_MAX - TEXELS_MAX;
    enum umb_status status = umbb_texture_get(&table, &image, &index, NULL);
    struct bytes buffer = {0};
    struct umb_sink sink = bytes_sink(&buffer);
    if (status == UMB_OK && index != UMBS_NO_INDEX &&
        add_triangle(&job.scene, data, index) == UMB_OK &&
        umbs_scene_builder_write(&job.scene, &sink, NULL) == UMB_OK) {
        struct umbs_scene_view view;
        FUZZ_DEMAND(umbs_scene_view(buffer.data, buffer.size, &view, NULL) == UMB_OK);
        sample(&view, data);
    }
    bytes_finish(&buffer);
    umbb_texture_table_finish(&table);
    umbs_scene_builder_finish(&job.scene);
    free(png);
    return 0;
}

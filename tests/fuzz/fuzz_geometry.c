/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Hostile scene buffers: those that the validator accepts must be safe to analyse, cut and bake.
 *
 * An input is two bytes that choose lights and effects, then a scene buffer (scene_buffer.h). The
 * bake has 64 voxels a side, one thread and one tile, so that an execution stays short.
 */
#include <string.h>

#include "bake/analysis/analysis.h"
#include "bake/analysis/plan.h"
#include "bake/analysis/voxel_casters.h"
#include "bake/bake_frusta.h"
#include "bake/bake_transmittance.h"
#include "bake/memory_plan.h"
#include "scene/scene.h"
#include "format/receiver_mask.h"
#include "fuzz.h"

#define OPTION_BYTES         2U
#define COUNTS_AT            40U /* in a scene buffer: each section's number of items and offset */
#define OFFSETS_AT           120U
#define HEAD_BYTES           200U
#define SECTIONS             10U
#define TRIANGLES_MAX        400U
#define FRUSTA_MAX           24U
#define OCCLUDER_DEPTH_BYTES ((size_t)1 << 20)
#define WORKING_BYTES        ((size_t)16 << 20)

static const char *const lights[][4] = {
    {"--sun", "135,45", NULL},
    {"--sun", "0,90", NULL},
    {"--point", "1,2,3", NULL},
    {"--spot", "0,5,0,0,-1,0,40", NULL},
    {"--spot", "0,0,0,1,0,0,90", NULL},
    {"--sun", "10,1", "--point", "0,0,0"},
    {NULL},
    {"--sun", "359.9,0.01", NULL},
};

static const char *const effects[][4] = {
    {NULL},
    {"--closed", "on", NULL},
    {"--closed", "off", NULL},
    {"--static", NULL},
    {"--effect", "front=on", NULL},
    {"--effect", "penumbra=on", NULL},
    {"--depth", "plain", NULL},
    {"--depth", "embree", NULL},
};

/* Out: 1, or 0 where the two do not go together. */
static int choose_options(const uint8_t *bytes, struct umbb_options *options)
{
    char *words[20] = {"umbrage-bake", "scene", "-o",        "out", "--resolution", "64",
                       "--tile",       "64",    "--threads", "1",   "--memory",     "512MiB"};
    int count = 12;
    const char *const *all[2] = {lights[bytes[0] % 8], effects[bytes[1] % 8]};
    struct umb_error error;
    for (int k = 0; k < 2; k++) {
        for (int i = 0; i < 4 && all[k][i] != NULL; i++) {
            words[count++] = (char *)(uintptr_t)all[k][i];
        }
    }
    return umbb_options_parse(count, words, options, &error) == UMB_OK;
}

static enum umb_status divide(const struct umbb_analysis *analysis,
                              const struct umbb_options *options,
                              const struct umbs_scene_view *view, struct umbb_memory_plan *memory)
{
    const struct umbb_memory_input input = {
        .memory_bytes = options->memory_bytes,
        .scene_bytes = view->alpha_bytes + umbb_cut_bytes(analysis),
        .triangles = analysis->count,
        .log2_size = options->resolution_log2,
        .tile_log2 = options->tile_log2,
        .threads = options->threads,
        .closed_rule = analysis->closed_rule || options->static_rule,
        .ruled_frusta = options->static_rule ? analysis->frustum_count : 0,
        .traced = options->depth == UMBB_DEPTH_EMBREE,
        .projected = 1,
    };
    return umbb_memory_divide(&input, memory, NULL);
}

static void bake(struct umbb_analysis *analysis, const struct umbb_options *options,
                 const struct umbs_scene_view *view)
{
    struct umbb_memory_plan memory;
    struct umb__octree octree = {0};
    struct umbb_bake_figures figures = {0};
    struct umbb_occluder_depth_words occluder_depth = {0};
    struct umb__transmittance_bytes transmittance = {0};
    uint32_t level = 0;
    uint64_t *receiver_mask_cells =
        calloc(analysis->frustum_count * UMB__RECEIVER_MASK_WORDS, sizeof *receiver_mask_cells);
    if (receiver_mask_cells != NULL && divide(analysis, options, view, &memory) == UMB_OK) {
        const struct umbb_frusta_job job = {
            .analysis = analysis,
            .view = view,
            .options = options,
            .memory = &memory,
            .occluder_depth =
                options->occluder_depth && analysis->closed_rule ? &occluder_depth : NULL,
            .occluder_depth_max_bytes = OCCLUDER_DEPTH_BYTES,
            .receiver_mask_cells = options->static_rule ? receiver_mask_cells : NULL,
        };
        if (umbb_bake_frusta(&job, &octree, &figures, NULL) == UMB_OK &&
            umbb_transmittance_bake(analysis, options, WORKING_BYTES, &transmittance, &level,
                                    NULL) == UMB_OK &&
            umbb_analysis_need_corners(analysis, view, NULL) == UMB_OK) {
            free(umbb_analysis_take_turned(analysis));
        }
    }
    umb__octree_finish(&octree);
    umb__occluder_depth_words_free(NULL, occluder_depth.words);
    umb__transmittance_bytes_finish(&transmittance);
    free(receiver_mask_cells);
}

/* Refuses here what umbrage-bake refuses after the analysis: --static with lamps or translucent
 * casters. */
static int is_baked(const struct umbb_analysis *analysis, const struct umbb_options *options)
{
    int lamps = 0;
    for (uint32_t i = 0; i < analysis->choice.count; i++) {
        lamps |= analysis->choice.lights[i].kind != UMB_LIGHT_DIRECTIONAL;
    }
    return analysis->frustum_count <= FRUSTA_MAX &&
           !(options->static_rule && (lamps || analysis->cuts.translucent.triangles > 0));
}

size_t LLVMFuzzerMutate(uint8_t *data, size_t size, size_t max_size) __attribute__((weak));
size_t LLVMFuzzerCustomMutator(uint8_t *data, size_t size, size_t max_size, unsigned seed);

/* Numbers on which geometry code tends to fail. */
static const double numbers[] = {0.0,    -0.0,     1.0,        -1.0,     0.5,  1e15, -1e15,
                                 1e-300, 4.9e-324, 1e9,        1e-9,     1e7,  2.0,  1e-15,
                                 3e14,   1.5708,   3.14159265, 0x1p53,   1e-7, 5.0,  -0.5,
                                 40.0,   1e-12,    1e308,      1e15 - 1, 1e-3};

/* Returns a section's length in bytes: from its offset to the next section's, or to the end. 0: the
 * section is empty. */
static size_t pick_section(const uint8_t *scene, size_t size, unsigned number, uint64_t *at)
{
    uint64_t count, end = size;
    memcpy(&count, scene + COUNTS_AT + 8 * (size_t)number, 8);
    memcpy(at, scene + OFFSETS_AT + 8 * (size_t)number, 8);
    for (unsigned i = 0; i < SECTIONS; i++) {
        uint64_t other;
        memcpy(&other, scene + OFFSETS_AT + 8 * (size_t)i, 8);
        end = other > *at && other < end ? other : end;
    }
    return count > 0 && *at >= HEAD_BYTES && *at < end && end <= size ? (size_t)(end - *at) : 0;
}

/* In half of the mutations only a number in a section is replaced. Most results then pass the
 * validator, which is strict about everything else. */
size_t LLVMFuzzerCustomMutator(uint8_t *data, size_t size, size_t max_size, unsigned seed)
{
    uint64_t at = 0;
    uint8_t *scene = data + OPTION_BYTES;
    const size_t bytes = size > OPTION_BYTES + HEAD_BYTES
                             ? pick_section(scene, size - OPTION_BYTES, seed / 8 % SECTIONS, &at)
                             : 0;
    const unsigned draw = seed / 128;
    if (seed % 8 == 0 && size >= OPTION_BYTES) {
        data[0] = (uint8_t)draw;
        data[1] = (uint8_t)(draw >> 8);
    } else if (seed % 8 < 4 && bytes >= 8) {
        const double number = numbers[draw % (sizeof numbers / sizeof numbers[0])];
        memcpy(scene + at + draw / 32 % (bytes / 8) * 8, &number, 8);
    } else if (seed % 8 == 4 && bytes >= 4) {
        const float number = (float)numbers[draw % 10];
        memcpy(scene + at + draw / 32 % (bytes / 4) * 4, &number, 4);
    } else if (seed % 8 == 5 && bytes >= 16) { /* one item's number for another's */
        memmove(scene + at + draw % (bytes / 8) * 8, scene + at + draw / 64 % (bytes / 8) * 8, 8);
    } else if (seed % 8 == 6 && bytes >= 4) {
        const uint32_t small = draw % 5;
        memcpy(scene + at + draw / 8 % (bytes / 4) * 4, &small, 4);
    } else if (LLVMFuzzerMutate != NULL) {
        return LLVMFuzzerMutate(data, size, max_size);
    }
    return size;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct umbs_scene_view view;
    struct umbb_options options;
    if (size < 2 || !choose_options(data, &options)) {
        return 0;
    }
    uint8_t *exact = malloc(size - 2 + (size == 2)); /* aligned; the block ends where the data do */
    if (exact == NULL) {
        return 0;
    }
    memcpy(exact, data + 2, size - 2);
    if (umbs_scene_view(exact, size - 2, &view, NULL) == UMB_OK &&
        view.world_triangle_count <= TRIANGLES_MAX) {
        struct umbb_analysis analysis = {0};
        char *plan = NULL;
        if (umbb_analysis_run(&view, &options, &analysis, NULL) == UMB_OK &&
            umbb_plan_text(&analysis, &view, &options, &plan, NULL) == UMB_OK &&
            is_baked(&analysis, &options)) {
            bake(&analysis, &options, &view);
        }
        free(plan);
        umbb_analysis_finish(&analysis);
    }
    free(exact);
    return 0;
}

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Views of assets of few nodes that represent huge trees. The nodes held bound the steps of a want;
 * listed pages are missing ones; a view with no missing page is answered exactly.
 * Ten bytes make the asset (deep_asset.h) and choose the pages that are here at first; each further
 * eight make a view.
 */
#include <string.h>

#include "base/bytes.h"
#include "deep_asset.h"
#include "fuzz.h"
#include "partial/partial_parts.h"
#include "umbrage/query.h"

enum {
    SHAPE_BYTES = 10,
    VIEW_BYTES = 8,
    VIEWS_MAX = 2,
    PAGES_A_ROUND = 256,
    POINTS = 32,
};

#define SIDE_M 256.0

/* A coordinate in and around the frustum. */
static double place(uint8_t byte)
{
    return (byte - 8) * SIDE_M / 240;
}

/* Half of the views are boxes, the others cameras; some are coarse. */
static struct umb_partial_view view_of(const uint8_t bytes[VIEW_BYTES])
{
    struct umb_partial_view view = {.light = bytes[0] & 2 ? UINT32_MAX : 0,
                                    .taps = bytes[0] & 4 ? 1 : 0,
                                    .max_error_m = bytes[0] & 8 ? 0.5 : 0,
                                    .max_error_rad = bytes[0] & 16 ? 0.001 : 0};
    for (unsigned i = 0; i < 3; i++) {
        const double a = place(bytes[1 + i]), b = place(bytes[4 + i]);
        view.box.min[i] = a < b ? a : b;
        view.box.max[i] = a < b ? b : a;
        view.camera.eye[i] = a;
        view.camera.forward[i] = b - a;
        view.camera.up[i] = i == bytes[7] % 3;
    }
    view.has_box = bytes[0] & 1;
    view.has_camera = !view.has_box;
    view.camera.fov_y = 0.1 + bytes[7] / 100.0;
    view.camera.aspect = 1.5;
    view.camera.far_m = bytes[0] & 32 ? 40 : 0;
    return view;
}

static void add_page(struct umb_partial *partial, const struct bytes *file, uint32_t page)
{
    uint64_t offset;
    uint32_t length;
    (void)umb_partial_locate(partial, page, &offset, &length);
    FUZZ_DEMAND(umb_partial_add(partial, page, file->data + offset, length, NULL) == UMB_OK);
}

static struct umb_partial *open_some(const struct bytes *file, uint8_t step)
{
    const struct umb_partial_options options = {.sha256 = &test_digest};
    struct umb_partial *partial;
    FUZZ_DEMAND(umb_partial_open(file->data, file->size, &options, &partial, NULL) == UMB_OK);
    for (uint32_t block = 1; block < partial->head.directory_count; block++) {
        uint64_t offset;
        uint32_t length;
        umb_partial_locate_block(partial, block, &offset, &length);
        FUZZ_DEMAND(umb_partial_add_block(partial, block, file->data + offset, length, NULL) ==
                    UMB_OK);
    }
    for (uint32_t page = 0; step > 0 && page < partial->head.page_count; page += step) {
        add_page(partial, file, page);
    }
    return partial;
}

/* Wants the view until no page is missing. Returns false if the view is refused. */
static int fetch(struct umb_partial *partial, const struct bytes *file,
                 const struct umb_partial_view *view)
{
    for (uint32_t round = 0;; round++) {
        uint32_t list[PAGES_A_ROUND];
        FUZZ_DEMAND(round <= partial->head.page_count);
        FUZZ_DEMAND(umb_partial_build(partial, NULL) == UMB_OK);
        if (umb_partial_want(partial, view, 0, NULL) != UMB_OK) {
            return 0;
        }
        FUZZ_DEMAND(partial->want_steps <= 1024 + 17 * partial->node_count);
        const size_t count = umb_partial_missing(partial, list, PAGES_A_ROUND, 0);
        for (size_t i = 0; i < count; i++) {
            FUZZ_DEMAND(!umb_partial_has(partial, list[i]));
            add_page(partial, file, list[i]);
        }
        if (count == 0) {
            return 1;
        }
    }
}

/* Every point of the box must be known: the bound must not have left out a page that the points
 * need. */
static void expect_exact(struct umb_partial *partial, const struct umb_box *box)
{
    double positions[POINTS][3];
    float values[POINTS];
    uint64_t seed = 31;
    for (size_t i = 0; i < POINTS * (size_t)3; i++) {
        positions[i / 3][i % 3] =
            box->min[i % 3] + random_unit(&seed) * (box->max[i % 3] - box->min[i % 3]);
    }
    const struct umb_points points = {
        .positions = positions, .format = UMB_POINT_F64, .count = POINTS};
    const struct umb_query_settings one = {.taps = 1};
    struct umb_partial_answers answers = {.values = values};
    FUZZ_DEMAND(umb_partial_query(partial, &one, &points, 0, &answers, NULL) == UMB_OK);
    FUZZ_DEMAND(answers.exact == POINTS);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    if (size < SHAPE_BYTES + VIEW_BYTES) {
        return 0;
    }
    const struct deep deep = {.log2_size = 6 + data[0] % 15,
                              .width = 1 + umb__load16(data + 1) % 6,
                              .mixed = 1 + data[3] % 8,
                              .seed = umb__load32(data + 4) + (uint64_t)1};
    struct bytes file = deep_asset(&deep, SIDE_M);
    const size_t views = (size - SHAPE_BYTES) / VIEW_BYTES;
    for (size_t i = 0; i < views && i < VIEWS_MAX; i++) {
        const struct umb_partial_view view = view_of(data + SHAPE_BYTES + VIEW_BYTES * i);
        struct umb_partial *partial = open_some(&file, data[8] % 5);
        if (fetch(partial, &file, &view) && view.has_box && view.max_error_m <= 0 &&
            view.max_error_rad <= 0) {
            expect_exact(partial, &view.box);
        }
        umb_partial_close(partial);
    }
    bytes_finish(&file);
    return 0;
}

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * From the mapped layout back to the exchange form. Wide nodes are split into two octree levels and
 * equal halves merged again; cells of the grid are joined upwards the same way. The result is the
 * canonical tree, so packing it gives the bytes it came from.
 */
#include <string.h>

#include "base/memory.h"
#include "format/asset_parts.h"
#include "format/content.h"
#include "format/intern.h"

struct exporter {
    const struct umb_asset *asset;
    struct umb_intern intern;
    struct umb_error *error;
    uint32_t *brick_of;  /* interned number + 1 of each brick of the view; 0 = not yet */
    uint32_t *node_of;   /* the same for each word where a wide node starts */
};

/* Interns brick `number` of the view. */
static enum umb_status export_brick(struct exporter *e, uint32_t number,
                                    struct umb_node_value *value)
{
    if (e->brick_of[number]) {
        *value = (struct umb_node_value){UMB_NODE_MIXED, e->brick_of[number] - 1};
        return UMB_OK;
    }
    enum umb_status status =
        umb_intern_brick(&e->intern, e->asset->view.bricks[number], value, e->error);
    if (status == UMB_OK && value->state == UMB_NODE_MIXED) {
        e->brick_of[number] = value->index + 1;
    }
    return status;
}

static enum umb_status export_node(struct exporter *e, uint32_t level, uint32_t word,
                                   struct umb_node_value *value);

static enum umb_status export_number(struct exporter *e, uint32_t level, uint32_t number,
                                     struct umb_node_value *value)
{
    return level == UMB_LEVEL_BRICK ? export_brick(e, number, value)
                                    : export_node(e, level, number, value);
}

/* Interns a wide node: eight octree nodes of eight children each, then the node above them. */
static enum umb_status export_node(struct exporter *e, uint32_t level, uint32_t word,
                                   struct umb_node_value *value)
{
    if (e->node_of[word]) {
        *value = (struct umb_node_value){UMB_NODE_MIXED, e->node_of[word] - 1};
        return UMB_OK;
    }
    const uint64_t *node = e->asset->view.nodes + word;
    struct umb_node_value children[8];
    enum umb_status status = UMB_OK;
    for (unsigned c = 0; c < 8 && status == UMB_OK; c++) {
        struct umb_node_value inner[8];
        for (unsigned g = 0; g < 8 && status == UMB_OK; g++) {
            unsigned x = (c & 1) * 2 + (g & 1), y = (c >> 1 & 1) * 2 + (g >> 1 & 1);
            unsigned bit = x + 4 * y + 16 * ((c >> 2) * 2 + (g >> 2));
            if (node[0] >> bit & 1) {
                status = export_number(e, level - 2, umb__wide_child(node, bit), &inner[g]);
            } else {
                inner[g] = (struct umb_node_value){
                    node[1] >> bit & 1 ? UMB_NODE_LIT : UMB_NODE_SHADOWED, 0};
            }
        }
        if (status == UMB_OK) {
            status = umb_intern_node(&e->intern, level - 1, inner, &children[c], e->error);
        }
    }
    if (status == UMB_OK) {
        status = umb_intern_node(&e->intern, level, children, value, e->error);
    }
    if (status == UMB_OK && value->state == UMB_NODE_MIXED) {
        e->node_of[word] = value->index + 1;
    }
    return status;
}

struct part {
    uint32_t level;
    uint32_t x, y, z; /* in cells */
};

/* Joins grid cells upwards into the node of `part`. */
static enum umb_status export_part(struct exporter *e, uint32_t frustum, struct part part,
                                   struct umb_node_value *value)
{
    const struct umb__top *top = &e->asset->view.tops[frustum];
    uint32_t g = top->grid_log2;
    uint32_t cell_level = e->asset->canonical.content.frusta[frustum].log2_size - g;
    if (part.level == cell_level) {
        uint32_t cell = e->asset->view.grid[top->first_cell + part.x + ((size_t)part.y << g) +
                                            ((size_t)part.z << (2 * g))];
        if (cell < UMB__CELL_FIRST) {
            *value = (struct umb_node_value){(enum umb_node_state)cell, 0};
            return UMB_OK;
        }
        return export_number(e, cell_level, cell - UMB__CELL_FIRST, value);
    }
    uint32_t half = 1U << (part.level - 1 - cell_level);
    struct umb_node_value children[8];
    for (unsigned c = 0; c < 8; c++) {
        struct part child = {part.level - 1, part.x + (c & 1) * half,
                             part.y + (c >> 1 & 1) * half, part.z + (c >> 2) * half};
        enum umb_status status = export_part(e, frustum, child, &children[c]);
        if (status != UMB_OK) {
            return status;
        }
    }
    return umb_intern_node(&e->intern, part.level, children, value, e->error);
}

static enum umb_status export_roots(struct exporter *e, struct umb_octree *octree)
{
    const struct umb_content *content = &e->asset->canonical.content;
    struct umb_octree_root *roots =
        umb__alloc_zeroed(e->asset->alloc, content->frustum_count, sizeof *roots);
    if (!roots) {
        return umb_fail(e->error, UMB_E_NO_MEMORY, "exporting: out of memory");
    }
    enum umb_status status = UMB_OK;
    for (uint32_t i = 0; i < content->frustum_count && status == UMB_OK; i++) {
        struct part whole = {content->frusta[i].log2_size, 0, 0, 0};
        struct umb_node_value value;
        status = export_part(e, i, whole, &value);
        if (status == UMB_OK) {
            roots[i].state = value.state;
            roots[i].level = whole.level;
            roots[i].index = value.state == UMB_NODE_MIXED ? value.index : 0;
        }
    }
    if (status != UMB_OK) {
        umb__free(e->asset->alloc, roots);
        return status;
    }
    umb_intern_take(&e->intern, octree);
    octree->roots = roots;
    octree->root_count = content->frustum_count;
    return UMB_OK;
}

enum umb_status umb_asset_export(const struct umb_asset *asset, struct umb_octree *octree,
                                 struct umb_content *content, struct umb_error *error)
{
    const struct umb_alloc *alloc = asset->alloc;
    struct exporter e = {.asset = asset, .error = error};
    memset(octree, 0, sizeof *octree);
    umb_intern_init(&e.intern, alloc);
    e.brick_of = umb__alloc_zeroed(alloc, (size_t)asset->view.brick_count, sizeof *e.brick_of);
    e.node_of = umb__alloc_zeroed(alloc, (size_t)asset->view.node_words, sizeof *e.node_of);
    enum umb_status status = e.brick_of && e.node_of
                                 ? export_roots(&e, octree)
                                 : umb_fail(error, UMB_E_NO_MEMORY, "exporting: out of memory");
    umb__free(alloc, e.brick_of);
    umb__free(alloc, e.node_of);
    umb_intern_finish(&e.intern);
    *content = asset->canonical.content;
    content->notes = asset->notes;
    return status;
}

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Exports the mapped layout as an octree. Each wide node becomes nodes of two octree levels, and
 * equal nodes are merged again; grid cells are joined upwards in the same way. The result is the
 * canonical tree, so packing it gives the bytes that the asset was made from.
 */
#include <string.h>

#include "base/memory.h"
#include "base/try.h"
#include "format/asset_parts.h"
#include "format/content.h"
#include "format/node_pool.h"

struct exporter {
    const struct umb_asset *asset;
    struct umb__pool pool;
    struct umb_error *error;
    /* Reference in the pool of each brick of the view, plus MADE; 0: not made yet */
    uint32_t *brick_of;
    /* For each word of the view at which a wide node begins: the pool's reference to the node, plus
     * MADE; 0: not made yet */
    uint32_t *node_of;
};

/*
 * Number added, modulo 2^32, to each reference in brick_of and node_of, so that 0 can mean "not
 * made yet". The two highest references, shadowed and lit, thus become 1 and 2. Uniform results are
 * stored too: a hostile file may share a uniform subtree 64 times a level, and it would be walked
 * 64^8 times.
 */
#define MADE 3U

static uint32_t uniform(int lit)
{
    return lit ? UMB__REF_LIT : UMB__REF_SHADOWED;
}

static enum umb_status export_node(struct exporter *e, uint32_t level, uint32_t word,
                                   uint32_t *ref);

/* Returns the pool's reference to a brick or wide node of the view; adds it if necessary. */
static enum umb_status export_number(struct exporter *e, uint32_t level, uint32_t number,
                                     uint32_t *ref)
{
    uint32_t *made = level == UMB_LEVEL_BRICK ? &e->brick_of[number] : &e->node_of[number];
    if (*made) {
        *ref = *made - MADE;
        return UMB_OK;
    }
    UMB__TRY(level == UMB_LEVEL_BRICK
                 ? umb__pool_brick(&e->pool, e->asset->view.bricks[number], ref, e->error)
                 : export_node(e, level, number, ref));
    *made = *ref + MADE;
    return UMB_OK;
}

/* Turns a wide node into eight octree nodes of eight children each, and the node above them. */
static enum umb_status export_node(struct exporter *e, uint32_t level, uint32_t word, uint32_t *ref)
{
    const uint64_t *node = e->asset->view.nodes + word;
    uint32_t children[8];
    for (unsigned c = 0; c < 8; c++) {
        uint32_t inner[8];
        for (unsigned g = 0; g < 8; g++) {
            const unsigned bit = umb__wide_bit(c, g);
            inner[g] = uniform(node[1] >> bit & 1);
            if (node[0] >> bit & 1) {
                UMB__TRY(export_number(e, level - 2, umb__wide_child(node, bit), &inner[g]));
            }
        }
        UMB__TRY(umb__pool_node(&e->pool, level - 1, inner, &children[c], e->error));
    }
    return umb__pool_node(&e->pool, level, children, ref, e->error);
}

/* A cube of grid cells. */
struct part {
    uint32_t level;
    uint32_t x, y, z; /* First cell */
};

/* Joins grid cells upwards into the node of `part`. */
static enum umb_status export_part(struct exporter *e, uint32_t frustum, struct part part,
                                   uint32_t *ref)
{
    const struct umb__top *top = &e->asset->view.tops[frustum];
    uint32_t g = top->grid_log2;
    uint32_t cell_level = e->asset->canonical.content.frusta[frustum].log2_size - g;
    if (part.level == cell_level) {
        uint32_t cell = e->asset->view.grid[top->first_cell + part.x + ((size_t)part.y << g) +
                                            ((size_t)part.z << (2 * g))];
        *ref = uniform(cell == UMB__CELL_LIT);
        return cell < UMB__CELL_FIRST ? UMB_OK
                                      : export_number(e, cell_level, cell - UMB__CELL_FIRST, ref);
    }
    uint32_t half = 1U << (part.level - 1 - cell_level);
    uint32_t children[8];
    for (unsigned c = 0; c < 8; c++) {
        struct part child = {part.level - 1, part.x + (c & 1) * half, part.y + (c >> 1 & 1) * half,
                             part.z + (c >> 2) * half};
        UMB__TRY(export_part(e, frustum, child, &children[c]));
    }
    return umb__pool_node(&e->pool, part.level, children, ref, e->error);
}

static enum umb_status export_roots(struct exporter *e, struct umb__octree *octree)
{
    const struct umb__content *content = &e->asset->canonical.content;
    const struct umb_alloc *alloc = e->asset->alloc;
    uint32_t *refs = umb__alloc(alloc, content->frustum_count, sizeof *refs);
    uint32_t *levels = umb__alloc(alloc, content->frustum_count, sizeof *levels);
    enum umb_status status =
        refs && levels ? UMB_OK : umb_fail(e->error, UMB_E_NO_MEMORY, "exporting: out of memory");
    for (uint32_t i = 0; i < content->frustum_count && status == UMB_OK; i++) {
        struct part whole = {content->frusta[i].log2_size, 0, 0, 0};
        levels[i] = whole.level;
        status = export_part(e, i, whole, &refs[i]);
    }
    if (status == UMB_OK) {
        status = umb__pool_take(&e->pool, refs, levels, content->frustum_count, octree, e->error);
    }
    umb__free(alloc, refs);
    umb__free(alloc, levels);
    return status;
}

enum umb_status umb__asset_export(const struct umb_asset *asset, struct umb__octree *octree,
                                  struct umb__content *content, struct umb_error *error)
{
    const struct umb_alloc *alloc = asset->alloc;
    struct exporter e = {.asset = asset, .error = error};
    memset(octree, 0, sizeof *octree);
    memset(content, 0, sizeof *content);
    umb__pool_init(&e.pool, alloc, SIZE_MAX);
    e.brick_of = umb__alloc_zeroed(alloc, (size_t)asset->view.brick_count, sizeof *e.brick_of);
    e.node_of = umb__alloc_zeroed(alloc, (size_t)asset->view.node_words, sizeof *e.node_of);
    enum umb_status status = e.brick_of && e.node_of
                                 ? export_roots(&e, octree)
                                 : umb_fail(error, UMB_E_NO_MEMORY, "exporting: out of memory");
    umb__free(alloc, e.brick_of);
    umb__free(alloc, e.node_of);
    umb__pool_finish(&e.pool);
    if (status == UMB_OK) {
        *content = asset->canonical.content;
        content->notes = asset->notes;
    }
    return status;
}

/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_FORMAT_CANONICAL_H
#define UMBRAGE_CORE_FORMAT_CANONICAL_H
/*
 * The canonical block: all content of an asset besides its voxels, as the bytes that its identity
 * covers. One encoder, one decoder.
 */
#include "format/content.h"
#include "format/transmittance.h"

/* Place of a frustum's root in a packed file. */
struct umb__packed_root {
    uint32_t state;    /* enum umb__node_state */
    uint32_t page;     /* if mixed */
    uint32_t position; /* Position among the page's nodes of the root's level, if mixed */
};

/* A decoded canonical block: the content, and the parts that only a reader needs. Owns
 * everything. */
struct umb__canonical {
    struct umb__content content;        /* notes stay NULL here */
    uint64_t counts[UMB_LEVEL_MAX + 1]; /* Node counts; after decoding each is below UINT32_MAX */
    struct umb__packed_root *roots;     /* [frustum_count] */
    struct umb__trans trans;            /* The content's transmittance, expanded by decoding */
};

/*
 * Encodes; *bytes is allocated with malloc semantics of alloc.
 * Fails: E_ARGUMENT (a count, level, name or number out of its range, named; more bytes than
 * readers take), E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umb__canonical_encode(const struct umb__canonical *canonical,
                                                  const struct umb_alloc *alloc, uint8_t **bytes,
                                                  uint64_t *length, struct umb_error *error);

/* Decodes and checks every field. Trust: safe on hostile bytes. */
UMB_CHECKED enum umb_status umb__canonical_decode(const uint8_t *bytes, uint64_t length,
                                                  const struct umb_alloc *alloc,
                                                  struct umb__canonical *canonical,
                                                  struct umb_error *error);

void umb__canonical_finish(struct umb__canonical *canonical, const struct umb_alloc *alloc);

/*
 * Checks lights and frusta; shared by both directions.
 *
 * In:    content: only read, since threads share the content of an open asset.
 * Fails: E_CORRUPT, E_VERSION (a kind of light this version does not know).
 */
UMB_CHECKED enum umb_status umb__content_check(const struct umb__content *content,
                                               struct umb_error *error);

/* Fills voxel_step of every frustum of a checked content. */
void umb__content_derive(struct umb__content *content);

#endif

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
    uint32_t state; /* State, enum umb__node_state */
    uint32_t page;  /* Page of a mixed root, else 0 */
    /* Position of a mixed root among the nodes of its level in its page, else 0 */
    uint32_t position;
};

/* A decoded canonical block: the content, and the parts that only a reader needs. Owns both. */
struct umb__canonical {
    struct umb__content content;        /* Content; its notes stay NULL */
    uint64_t counts[UMB_LEVEL_MAX + 1]; /* Numbers of nodes; a decoded one is below UINT32_MAX */
    struct umb__packed_root *roots;     /* [frustum_count] */
    struct umb__trans trans;            /* The content's transmittance, expanded by decoding */
};

/*
 * Encodes a canonical block.
 *
 * Out:   bytes: uint8[*length], which the caller frees with umb__free.
 * Fails: E_ARGUMENT (a text that is missing, too long or not UTF-8; more bytes than readers
 *        accept), E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umb__canonical_encode(const struct umb__canonical *canonical,
                                                  const struct umb_alloc *alloc, uint8_t **bytes,
                                                  uint64_t *length, struct umb_error *error);

/* Decodes a canonical block and checks every field. Trust: safe on hostile bytes. */
UMB_CHECKED enum umb_status umb__canonical_decode(const uint8_t *bytes, uint64_t length,
                                                  const struct umb_alloc *alloc,
                                                  struct umb__canonical *canonical,
                                                  struct umb_error *error);

void umb__canonical_finish(struct umb__canonical *canonical, const struct umb_alloc *alloc);

/*
 * Checks lights, frusta and effects, for the writer and the reader.
 *
 * In:    content: only read; threads share the content of an open asset.
 * Fails: E_CORRUPT, E_VERSION (a kind of light this version does not know).
 */
UMB_CHECKED enum umb_status umb__content_check(const struct umb__content *content,
                                               struct umb_error *error);

/* Fills voxel_step of every frustum of a checked content. */
void umb__content_derive(struct umb__content *content);

#endif

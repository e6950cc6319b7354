/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_HEAD_ROOM_H
#define UMBRAGE_SERVER_BAKE_HEAD_ROOM_H
/*
 * Space in an asset's head besides lights and texts, divided before the work. Readers accept
 * canonical blocks of up to 64 MiB (docs/reference/umb-format.md). A bake that exceeded that would
 * find out only at its end.
 */
#include "format/content.h"

/*
 * Computes the limit of first occluders: 48 MiB, or the space that everything else leaves in the
 * head.
 *
 * In:    content: counts of lights and frusta and both texts are read; receiver_mask_cells only for
 *        NULL or not; the curve counts in full. translucent: 1 if maps of translucent casters
 *        follow.
 * Fails: E_BAD_SCENE: so many lights and frusta do not fit even without an occluder depth map.
 */
UMB_CHECKED enum umb_status umbb_head_occluder_depth_bytes(const struct umb__content *content,
                                                           int translucent, size_t *bytes,
                                                           struct umb_error *error);

#endif

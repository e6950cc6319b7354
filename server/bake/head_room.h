/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_HEAD_ROOM_H
#define UMBRAGE_SERVER_BAKE_HEAD_ROOM_H
/*
 * What an asset's head holds beside lights and texts, divided before the work: readers take
 * canonical blocks of 64 MiB (docs/reference/umb-format.md), and a bake that finds out at its end
 * that its own is longer has worked for nothing.
 */
#include "format/content.h"

/*
 * Finds what first occluders may take: 48 MiB, or what all else can leave of the head.
 *
 * In:    content: counts of lights and frusta and both texts are read, receiver_mask_cells for
 *        being there; the curve counts as whole. translucent: 1 if maps of translucent casters are
 *        to come.
 * Fails: E_BAD_SCENE: so many lights and frusta do not even fit without an occluder depth map.
 */
UMB_CHECKED enum umb_status umbb_head_occluder_depth_bytes(const struct umb_content *content,
                                                           int translucent, size_t *bytes,
                                                           struct umb_error *error);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_RECEIVER_MASK_STAGE_H
#define UMBRAGE_CORE_QUERY_RECEIVER_MASK_STAGE_H
/*
 * The stage of assets baked under the static rule. The answers of the other stages stay as they
 * are. Points whose look-up lies in no cell that holds receivers (format/receiver_mask.h) are
 * counted as undefined. Not counted are points shadowed by their normal, points before the first
 * voxel, and points beyond the frustum in x or y: the last count as outside, though a window may
 * reach into it.
 */
#include "format/content.h"
#include "query/query_parts.h"

/* Puts the stage in front of the query's other stages. In: content: with receiver_mask_cells. */
void umb__receiver_mask_set(struct umb__query *query, const struct umb__content *content);

/* Returns whether point i is undefined. In: query: with receiver_mask_cells. */
bool umb__receiver_mask_is_undefined(const struct umb__query *query,
                                     const struct umb_points *points, size_t i);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_WIRE_ASSET_CODEC_H
#define UMBRAGE_WIRE_ASSET_CODEC_H
/* umbrage.v1.AssetSummary, which Describe and List share. */
#include "umbrage/v1/shadows.pb-c.h"
#include "wire/messages.h"

/* Reads a summary (NULL = absent). Fails: E_ARGUMENT, naming the field. */
UMB_CHECKED enum umb_status umbw_summary_take(const Umbrage__V1__AssetSummary *message,
                                              struct umbw_asset_summary *summary,
                                              struct umb_error *error);

/* Fills a message that borrows the summary's name and id. */
void umbw_summary_put(struct umbw_asset_summary *summary, Umbrage__V1__AssetSummary *message);

#endif

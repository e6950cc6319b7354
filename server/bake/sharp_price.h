/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_SHARP_PRICE_H
#define UMBRAGE_SERVER_BAKE_SHARP_PRICE_H
/* What sharp BLEND materials (scene_alpha.h) take as they are and as cut-outs, for a printed plan. */
#include "bake/small_bake.h"

/*
 * Finds the price, if the scene has translucent triangles of sharp materials and the options leave
 * open what becomes of them. Sets job->analysis->sharp_price.
 *
 * In:    job: packed is 1. working_bytes: limit of the memory for transmittance maps.
 * Fails: the errors of umbb_analysis_run, umbb_small_bake and umbb_transmittance_bake.
 * Cost:  a second analysis, forecasts of both, and the maps.
 */
UMB_CHECKED enum umb_status umbb_sharp_price_find(const struct umbb_small_job *job,
                                                  size_t working_bytes, struct umb_error *error);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_CLOSED_CHOICE_H
#define UMBRAGE_SERVER_BAKE_CLOSED_CHOICE_H
/*
 * Closed or open: the rule with fewer bytes, by small bakes of the scene under both.
 *
 * Where a bake at the wanted resolution is cheap, both are baked at it, and the bytes are exact.
 * Otherwise both are baked at three lower resolutions. The nodes of each level grow from one to the
 * next, and the growth, which changes slowly, is continued (byte_growth.h).
 *
 * The choice depends on scene, lights and resolution alone: on no clock, thread count, memory or
 * compression, because the asset's id depends on it.
 * docs/explained/effects.md has its accuracy.
 */
#include "bake/small_bake.h"

/* Least share of the nodes' bytes that the closed rule must save. Below it the asset keeps
 * penumbras, columns and derived maps instead. The share of the file's bytes may be a few per cent
 * higher or lower, so this limit keeps the rule on wherever it saves a tenth of the file. */
#define UMBB_CLOSED_SAVES 0.03

/*
 * Decides the closed rule of a scene with closed parts, unless the options decide it. Sets the
 * analysis's rule and closed_price.
 *
 * In:    job: its analysis is left fitted to the options' resolution. With job->packed the price has
 *        packed bytes.
 * Fails: the errors of umbb_small_bake.
 * Cost:  by a model of its work, at most 0.3 s of a thread or a tenth of the bake.
 */
UMB_CHECKED enum umb_status umbb_closed_choose(const struct umbb_small_job *job,
                                               struct umb_error *error);

/* Forecasts the packed bytes of a scene's voxels under the rule of its analysis. In: job: packed is
 * 1. Fails: the errors of umbb_small_bake. Cost: half of umbb_closed_choose's. */
UMB_CHECKED enum umb_status umbb_packed_forecast(const struct umbb_small_job *job, double *bytes,
                                                 struct umb_error *error);

#endif

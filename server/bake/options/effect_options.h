/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_OPTIONS_EFFECT_OPTIONS_H
#define UMBRAGE_SERVER_BAKE_OPTIONS_EFFECT_OPTIONS_H
/*
 * --effect NAME=on|off: overruling what the analysis decides.
 *
 * Only effects that a caller can decide are accepted. For an effect that follows from the lights or
 * the coordinates, the refusal names the place to change it. An effect that this version lacks may
 * be off, never on.
 */
#include <stdint.h>
#include "tool/options.h"

struct umbb_options;

/* Setting of half shadows (penumbras). */
enum umbb_penumbra_mode {
    UMBB_PENUMBRA_AUTO = 0, /* on if a light's extent calls for it and occluders are known */
    UMBB_PENUMBRA_ON,       /* keeps first occluders for it (`front`) */
    UMBB_PENUMBRA_OFF,      /* the asset's lights get no extent: queries have no penumbras */
};

/* Reads --effect NAME=on|off into a struct umbb_options. Fails: E_ARGUMENT. */
enum umb_status umbb_effect_set(const struct umbu_option *option, const char *value, void *options,
                                struct umb_error *error);

/* Completes the effects once all options are read: penumbras keep first occluders. Fails:
 * E_ARGUMENT. */
UMB_CHECKED enum umb_status umbb_effects_settle(struct umbb_options *options,
                                                struct umb_error *error);

#endif

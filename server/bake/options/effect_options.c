/* SPDX-License-Identifier: Apache-2.0 */
/* A table of effects, with the decider of each and where to change it. */

#include <string.h>

#include "bake/options/bake_options.h"

/* Decider of an effect: which --effect settings are allowed. */
enum decider {
    BY_CALLER,  /* on or off */
    BY_SCENE,   /* none: it follows from another setting */
    BY_VERSION, /* off only: this version lacks the effect */
};

static const struct {
    const char *name;
    enum decider decider;
    const char *where; /* BY_SCENE: the setting it follows from */
} effects[] = {
    {"closed", BY_CALLER, NULL},
    {"front", BY_CALLER, NULL},
    {"origin", BY_SCENE, "the coordinates and the size of a voxel (--resolution)"},
    {"suns", BY_SCENE, "the lights (--sun, --sun-path, --light)"},
    {"faces", BY_SCENE, "the lights (--point, --spot, --light)"},
    {"penumbra", BY_CALLER, NULL},
    {"cut-out", BY_CALLER, NULL},
    {"transmittance", BY_CALLER, NULL},
    {"static", BY_CALLER, NULL},
    {"blend-cut-out", BY_CALLER, NULL},
    {"mraa", BY_VERSION, NULL},
    {"voaa", BY_VERSION, NULL},
};

/* Sets an effect that the caller may decide. */
static void decide(struct umbb_options *options, const char *name, int on)
{
    if (strcmp(name, "front") == 0) {
        options->occluder_depth = on;
        options->occluder_depth_refused = !on;
    } else if (strcmp(name, "cut-out") == 0) {
        options->opaque_cut_outs = !on;
    } else if (strcmp(name, "transmittance") == 0) {
        options->opaque_translucents = !on;
    } else if (strcmp(name, "blend-cut-out") == 0) {
        options->sharp_cut_outs = on;
    } else if (strcmp(name, "static") == 0) {
        options->static_rule = on;
    } else if (strcmp(name, "penumbra") == 0) {
        options->penumbra = on ? UMBB_PENUMBRA_ON : UMBB_PENUMBRA_OFF;
    } else {
        options->closed = on ? UMBB_CLOSED_ON : UMBB_CLOSED_OFF;
    }
}

enum umb_status umbb_effect_set(const struct umbu_option *option, const char *value, void *options,
                                struct umb_error *error)
{
    const size_t length = strcspn(value, "=");
    const int on = strcmp(value + length, "=on") == 0;
    if (!on && strcmp(value + length, "=off") != 0) {
        return umbu_refuse(option, value, error);
    }
    size_t i = 0;
    const size_t count = sizeof effects / sizeof effects[0];
    while (i < count &&
           (strlen(effects[i].name) != length || memcmp(effects[i].name, value, length) != 0)) {
        i++;
    }
    if (i == count) {
        return umbu_refuse(option, value, error);
    }
    if (effects[i].decider == BY_SCENE) {
        return umb_fail(error, UMB_E_ARGUMENT, "--%s: '%.64s': the effect follows from %s",
                        option->name, value, effects[i].where);
    }
    if (effects[i].decider == BY_VERSION && on) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "--%s: '%.64s': this version does not have the effect", option->name,
                        value);
    }
    if (effects[i].decider == BY_CALLER) {
        decide(options, effects[i].name, on);
    }
    return UMB_OK;
}

enum umb_status umbb_effects_settle(struct umbb_options *options, struct umb_error *error)
{
    const int for_penumbra = options->penumbra == UMBB_PENUMBRA_ON;
    if (for_penumbra && options->occluder_depth_refused && options->closed != UMBB_CLOSED_OFF) {
        return umb_fail(
            error, UMB_E_ARGUMENT,
            "--effect: 'front=off' leaves out what 'penumbra=on' needs of closed solids");
    }
    options->occluder_depth |= for_penumbra && !options->occluder_depth_refused;
    if (options->static_rule && (options->occluder_depth || for_penumbra)) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "--effect: '%s' beside static: what it needs lies off the surfaces",
                        for_penumbra ? "penumbra=on" : "front=on");
    }
    if (options->static_rule && options->task != UMBB_TASK_BAKE) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "--static: the rule needs the whole map: tile and merge do not take it");
    }
    return UMB_OK;
}

/* SPDX-License-Identifier: Apache-2.0 */
/* The rows of `umbrage-study techniques`. */
#include "study/techniques.h"

/* The parameter of each family grows down the table. */
#define MAP(kind) .settings.technique = UMB_MAP_##kind
#define WARPS     .settings.exponent = 42, .settings.negative_exponent = 5.4, .settings.linear = 1
/* Settings of percentage-closer soft shadows (PCSS): the penumbra's width comes from a search of
 * the map's depths, the filtered answer from its channels. */
#define SOFT(way)                                                                                  \
    .settings.access = UMB_MAP_##way, .settings.keep_depth = 1, .filter.light_size = 1.0
#define SLICES(many) .cascades = (many), .fit = UMB_CASCADE_SCENE

const struct umbt_technique_row umbt_technique_rows[] = {
    {"map-f32", UMBT_POINT, MAP(PCF)},
    {"pcf-2x2", UMBT_POINT, MAP(PCF), .filter.kernel = UMB_MAP_BILINEAR},
    {"pcf-u16", UMBT_BOX, MAP(PCF), .settings.format = UMB_MAP_U16},
    {"pcf-u24", UMBT_BOX, MAP(PCF), .settings.format = UMB_MAP_U24},
    {"pcf-f32", UMBT_BOX, MAP(PCF)},
    {"pcf-bilinear", UMBT_BOX, MAP(PCF), .filter.kernel = UMB_MAP_BILINEAR},
    {"pcf-poisson16", UMBT_BOX, MAP(PCF), .filter = {.kernel = UMB_MAP_POISSON, .samples = 16}},
    {"pcf-poisson64", UMBT_BOX, MAP(PCF), .filter = {.kernel = UMB_MAP_POISSON, .samples = 64}},
    {"pcss", UMBT_PENUMBRA, MAP(PCF), .filter.light_size = 1.0},
    {"vsm-soft", UMBT_PENUMBRA, MAP(VSM), .settings.access = UMB_MAP_SAT,
     .filter = {.light_size = 1.0}},
    {"pcss-vsm", UMBT_PENUMBRA, MAP(VSM), SOFT(SAT)},
    {"pcss-lvsm-4", UMBT_PENUMBRA, MAP(LVSM), .settings.terms = 4, SOFT(SAT)},
    {"pcss-msm", UMBT_PENUMBRA, MAP(MSM), SOFT(SAT)},
    {"pcss-msm-mips", UMBT_PENUMBRA, MAP(MSM), SOFT(MIPS)},
    {"pcss-esm-80", UMBT_PENUMBRA, MAP(ESM), .settings.exponent = 80, SOFT(MIPS)},
    {"pcss-evsm", UMBT_PENUMBRA, MAP(EVSM), WARPS, SOFT(MIPS)},
    {"vsm-u16", UMBT_BOX, MAP(VSM), .settings.format = UMB_MAP_U16},
    {"vsm", UMBT_BOX, MAP(VSM)},
    {"vsm-plane", UMBT_BOX, MAP(VSM), .settings.depth_plane = 1},
    {"vsm-ms4", UMBT_BOX, MAP(VSM), .samples = 2},
    {"vsm-mips", UMBT_BOX, MAP(VSM), .settings.access = UMB_MAP_MIPS},
    {"vsm-sat", UMBT_BOX, MAP(VSM), .settings.access = UMB_MAP_SAT},
    {"vsm-reduced", UMBT_BOX, MAP(VSM), .filter.reduction = 0.3},
    {"lvsm-2", UMBT_BOX, MAP(LVSM), .settings.terms = 2},
    {"lvsm-4", UMBT_BOX, MAP(LVSM), .settings.terms = 4},
    {"lvsm-16", UMBT_BOX, MAP(LVSM), .settings.terms = 16},
    {"convolution-4", UMBT_BOX, MAP(CONVOLUTION), .settings.terms = 4},
    {"convolution-8", UMBT_BOX, MAP(CONVOLUTION), .settings.terms = 8},
    {"convolution-16", UMBT_BOX, MAP(CONVOLUTION), .settings.terms = 16},
    {"convolution-16-damped", UMBT_BOX, MAP(CONVOLUTION), .settings.terms = 16,
     .settings.damping = 2.0},
    {"esm-20", UMBT_BOX, MAP(ESM), .settings.exponent = 20},
    {"esm-80", UMBT_BOX, MAP(ESM), .settings.exponent = 80},
    {"esm-300", UMBT_BOX, MAP(ESM), .settings.exponent = 300},
    {"esm-80-ms4", UMBT_BOX, MAP(ESM), .settings.exponent = 80, .samples = 2},
    {"evsm-f16", UMBT_BOX, MAP(EVSM), .settings.exponent = 5.4, .settings.negative_exponent = 5.4,
     .settings.linear = 1, .settings.format = UMB_MAP_F16},
    {"evsm-f32", UMBT_BOX, MAP(EVSM), WARPS},
    {"evsm-f32-ms4", UMBT_BOX, MAP(EVSM), WARPS, .samples = 2},
    {"evsm-log", UMBT_BOX, MAP(EVSM), .settings.exponent = 100, .settings.negative_exponent = 100},
    {"msm-u16", UMBT_BOX, MAP(MSM), .settings.format = UMB_MAP_U16},
    {"msm-f32", UMBT_BOX, MAP(MSM)},
    {"msm-f32-ms4", UMBT_BOX, MAP(MSM), .samples = 2},
    {"msm-sat", UMBT_BOX, MAP(MSM), .settings.access = UMB_MAP_SAT},
    {"pssm-map-2", UMBT_POINT, MAP(PCF), SLICES(2)},
    {"pssm-map-4", UMBT_POINT, MAP(PCF), SLICES(4)},
    {"pssm-map-8", UMBT_POINT, MAP(PCF), SLICES(8)},
    {"pssm-lispsm-4", UMBT_POINT, MAP(PCF), .cascades = 4, .fit = UMB_CASCADE_LISPSM},
    {"pssm-vsm-2", UMBT_BOX, MAP(VSM), SLICES(2), .match = 1},
    {"pssm-vsm-4", UMBT_BOX, MAP(VSM), SLICES(4), .match = 1},
    {"pssm-vsm-4-c1", UMBT_BOX, MAP(VSM), SLICES(4)},
    {"pssm-vsm-4-blend", UMBT_BOX, MAP(VSM), SLICES(4), .match = 1, .blend = 0.2},
    {"pssm-evsm-4", UMBT_BOX, MAP(EVSM), WARPS, SLICES(4), .match = 1},
    {"pssm-evsm-4-c1", UMBT_BOX, MAP(EVSM), WARPS, SLICES(4)},
};

const size_t umbt_technique_row_count = sizeof umbt_technique_rows / sizeof umbt_technique_rows[0];

/* SPDX-License-Identifier: Apache-2.0 */
/* The techniques that the study compares; the parameter of each family grows down the table. */
#include "study/technique_run.h"

#define MAP(kind) .settings.technique = UMB_MAP_##kind

const struct umbt_technique_row umbt_technique_rows[] = {
    {"map-f32", UMBT_POINT, MAP(PCF)},
    {"pcf-u16", UMBT_BOX, MAP(PCF), .settings.format = UMB_MAP_U16},
    {"pcf-u24", UMBT_BOX, MAP(PCF), .settings.format = UMB_MAP_U24},
    {"pcf-f32", UMBT_BOX, MAP(PCF)},
    {"pcf-poisson16", UMBT_BOX, MAP(PCF), .filter = {.kernel = UMB_MAP_POISSON, .samples = 16}},
    {"pcf-poisson64", UMBT_BOX, MAP(PCF), .filter = {.kernel = UMB_MAP_POISSON, .samples = 64}},
    {"pcss", UMBT_PENUMBRA, MAP(PCF), .filter.light_size = 1.0},
    {"vsm-soft", UMBT_PENUMBRA, MAP(VSM), .settings.access = UMB_MAP_SAT,
     .filter = {.light_size = 1.0}},
    {"vsm-u16", UMBT_BOX, MAP(VSM), .settings.format = UMB_MAP_U16},
    {"vsm", UMBT_BOX, MAP(VSM)},
    {"vsm-plane", UMBT_BOX, MAP(VSM), .settings.depth_plane = 1},
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
    {"evsm-f16", UMBT_BOX, MAP(EVSM), .settings.exponent = 5.4, .settings.negative_exponent = 5.4,
     .settings.linear = 1, .settings.format = UMB_MAP_F16},
    {"evsm-f32", UMBT_BOX, MAP(EVSM), .settings.exponent = 42, .settings.negative_exponent = 5.4,
     .settings.linear = 1},
    {"evsm-log", UMBT_BOX, MAP(EVSM), .settings.exponent = 100, .settings.negative_exponent = 100},
    {"msm-u16", UMBT_BOX, MAP(MSM), .settings.format = UMB_MAP_U16},
    {"msm-f32", UMBT_BOX, MAP(MSM)},
    {"msm-sat", UMBT_BOX, MAP(MSM), .settings.access = UMB_MAP_SAT},
    {"pssm-map-2", UMBT_POINT, MAP(PCF), .cascades = 2, .fit = UMB_CASCADE_SCENE},
    {"pssm-map-4", UMBT_POINT, MAP(PCF), .cascades = 4, .fit = UMB_CASCADE_SCENE},
    {"pssm-map-8", UMBT_POINT, MAP(PCF), .cascades = 8, .fit = UMB_CASCADE_SCENE},
    {"pssm-lispsm-4", UMBT_POINT, MAP(PCF), .cascades = 4, .fit = UMB_CASCADE_LISPSM},
    {"pssm-vsm-2", UMBT_BOX, MAP(VSM), .cascades = 2, .fit = UMB_CASCADE_SCENE},
    {"pssm-vsm-4", UMBT_BOX, MAP(VSM), .cascades = 4, .fit = UMB_CASCADE_SCENE},
    {"pssm-evsm-4", UMBT_BOX, MAP(EVSM), .settings.exponent = 42, .settings.negative_exponent = 5.4,
     .settings.linear = 1, .cascades = 4, .fit = UMB_CASCADE_SCENE},
};

const size_t umbt_technique_row_count = sizeof umbt_technique_rows / sizeof umbt_technique_rows[0];

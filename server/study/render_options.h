/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_RENDER_OPTIONS_H
#define UMBRAGE_SERVER_STUDY_RENDER_OPTIONS_H
/* The command line of `render`, parsed and checked; texts are borrowed from argv. */
#include "study/camera.h"
#include "study/shadow_source.h"
#include "study/traced_shadow.h"
#include "umbrage/query.h"

struct umbt_render_options {
    const char *scene, *asset;
    struct umbt_daemon daemon;
    const char *output, *reference, *difference; /* PNG files or NULL */
    struct umbt_camera_request camera;
    struct umb_query_settings settings; /* format UMB_ANSWER_F32 */
    uint32_t width, height;
    uint32_t aa;
    unsigned threads;
    int traced, compare;
    enum umbt_truth_kind truth;
    uint32_t samples;
    double fog; /* extinction, 1/m; 0: clear air */
    int up_given, z_up;
    int force, json, quiet, help;
    int to_stdout; /* 1: one of the pictures goes to stdout */
};

/* Parses and checks. With help set nothing else is set. Fails: E_ARGUMENT. */
UMB_CHECKED enum umb_status umbt_render_options_parse(int argc, char **argv,
                                                      struct umbt_render_options *options,
                                                      struct umb_error *error);

/* The help text of `render`. */
extern const char umbt_render_help[];

#endif

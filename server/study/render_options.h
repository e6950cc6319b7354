/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_RENDER_OPTIONS_H
#define UMBRAGE_SERVER_STUDY_RENDER_OPTIONS_H
/* The command line of `render`, parsed and checked; texts are borrowed from argv. */
#include "study/camera.h"
#include "study/shadow_source.h"
#include "study/traced_shadow.h"
#include "tool/session.h"

struct umbt_render_options {
    const char *scene, *asset;
    struct umbu_session daemon;
    const char *output, *reference, *difference; /* PNG files or NULL */
    struct umbt_camera_request camera;
    struct umb_query_settings settings; /* format UMB_ANSWER_F32 */
    uint32_t size[2];                   /* Pixels */
    uint32_t aa;                        /* 0 only while options are read */
    unsigned threads;
    int traced, compare;
    enum umbt_truth_kind truth;
    uint32_t samples;
    double fog;  /* extinction, 1/m; 0: clear air */
    unsigned up; /* 0 by the scene's format, 1 y, 2 z */
    int z_up;
    int force, json, quiet;
    int to_stdout; /* 1: one of the pictures goes to stdout */
};

/* Reads and checks. Returns -1 to go on, else the exit code, after the help or a message. */
int umbt_render_options_parse(int argc, char **argv, struct umbt_render_options *options);

#endif

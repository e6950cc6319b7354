/* SPDX-License-Identifier: Apache-2.0 */
/* See cli_paging_options.h. */
#include "cli_paging_options.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cli_common.h"

enum stream_option {
    OPTION_FROM_FILE,
    OPTION_FROM_URL,
    OPTION_BOX,
    OPTION_CAMERA,
    OPTION_PATH,
    OPTION_POINTS,
    OPTION_FORMAT,
    OPTION_NORMALS,
    OPTION_ONLY_POINTS,
    OPTION_SIZE,
    OPTION_UP,
    OPTION_LIGHT,
    OPTION_TAPS,
    OPTION_MAX_ERROR,
    OPTION_MAX_PIXELS,
    OPTION_LIMIT,
    OPTION_TIMEOUT,
    OPTION_ROUND,
    OPTION_MEMORY,
    OPTION_ID,
    OPTION_RESUME,
    OPTION_OUTPUT,
    OPTION_FRAMES,
    OPTION_JSON,
    OPTION_QUIET,
    OPTION_COUNT,
};

static const struct umbc_option OPTIONS[OPTION_COUNT] = {
    [OPTION_FROM_FILE] = {"from-file", "FILE", "the packed asset (.umb)", 0},
    [OPTION_FROM_URL] = {"from-url", "URL", "the same on any web server that serves ranges", 0},
    [OPTION_BOX] = {"box", "X0,Y0,Z0,X1,Y1,Z1", "what answers points in this box, metres", 0},
    [OPTION_CAMERA] = {"camera", "WHERE", "eye=X,Y,Z,target=X,Y,Z[,fov=DEG][,far=M]", 0},
    [OPTION_PATH] = {"path", "FILE", "a camera a line, one after the other", 0},
    [OPTION_POINTS] = {"points", "FILE", "points to ask while it sharpens; for the figures", 0},
    [OPTION_FORMAT] = {"format", "FORMAT", "of the points: text, f32 or f64 (default f32)", 0},
    [OPTION_NORMALS] = {"normals", NULL, "raw points have normals: six numbers each", 0},
    [OPTION_ONLY_POINTS] = {"only-points", NULL, "fetch just what the points need", 0},
    [OPTION_SIZE] = {"size", "WxH", "pixels of the camera's picture (default 1280x720)", 0},
    [OPTION_UP] = {"up", "y|z", "the scene's up axis (default y)", 0},
    [OPTION_LIGHT] = {"light", "N", "the asset's light (default 0)", 0},
    [OPTION_TAPS] = {"taps", "N", "widest filter that will be asked, odd (default 9)", 0},
    [OPTION_MAX_ERROR] = {"max-error", "M", "cells of this many metres are fine enough", 0},
    [OPTION_MAX_PIXELS] = {"max-pixels", "N", "so are cells of this many pixels", 0},
    [OPTION_LIMIT] = {"limit", "BYTES", "stop after receiving so many (64K, 2M)", 0},
    [OPTION_TIMEOUT] = {"timeout", "SECONDS", "stop after so many, with what came (no limit)", 0},
    [OPTION_ROUND] = {"round", "BYTES", "ask for so many at once (default: chosen)", 0},
    [OPTION_MEMORY] = {"memory", "BYTES", "what the client may use in all (default 1G)", 0},
    [OPTION_ID] = {"id", "ID", "insist on this asset, 64 hexadecimal digits", 0},
    [OPTION_RESUME] = {"resume", "PART", "go on from a file that -o wrote", 0},
    [OPTION_OUTPUT] = {"output", "PART", "keep what is here as a partial file; - is stdout", 'o'},
    [OPTION_FRAMES] = {"frames", "DIR", "a picture (PPM) of the points at each step", 0},
    [OPTION_JSON] = {"json", NULL, "print one JSON object, with every step", 0},
    [OPTION_QUIET] = {"quiet", NULL, "print nothing but errors", 'q'},
};

static const struct umbc_command STREAM = {
    .usage = "umbrage stream (FILE | ASSET | --from-file FILE | --from-url URL) [options]",
    .summary =
        "Fetches the part of an asset that is needed, coarse first, and shows how it sharpens.\n"
        "Without --box, --camera, --path or --points it fetches everything.",
    .options = OPTIONS,
    .option_count = OPTION_COUNT,
    .min_words = 0,
    .max_words = 1,
    .connects = true,
};

bool umbc_parse_size(const char *text, size_t size[2])
{
    unsigned width, height;
    int end = 0;
    if (sscanf(text, "%5ux%5u%n", &width, &height, &end) != 2 || text[end] != '\0' || width == 0 ||
        height == 0 || width > 16384 || height > 16384) {
        return false;
    }
    size[0] = width;
    size[1] = height;
    return true;
}

/* Numbers and words of the command line. Returns -1 to go on, else the exit code. */
static int read_numbers(const struct umbc_parsed *parsed, struct umbc_paging_options *o)
{
    const char *const *v = parsed->values;
    unsigned long long light = 0, taps = 9, seconds = 0;
    double metres = 0, pixels = 0;
    o->size[0] = 1280;
    o->size[1] = 720;
    o->up = 'y';
    if (v[OPTION_SIZE] && !umbc_parse_size(v[OPTION_SIZE], o->size)) {
        return umbc_usage_error("stream: --size '%s', must be WxH", v[OPTION_SIZE]);
    }
    if (v[OPTION_UP]) {
        if (strcmp(v[OPTION_UP], "y") != 0 && strcmp(v[OPTION_UP], "z") != 0) {
            return umbc_usage_error("stream: --up '%s', must be y or z", v[OPTION_UP]);
        }
        o->up = v[OPTION_UP][0];
    }
    if (v[OPTION_LIGHT] && !umbc_parse_count(v[OPTION_LIGHT], UMB_LIGHTS_MAX - 1, &light)) {
        return umbc_usage_error("stream: --light '%s', no number of a light", v[OPTION_LIGHT]);
    }
    if (v[OPTION_TAPS] &&
        (!umbc_parse_count(v[OPTION_TAPS], UMB_TAPS_MAX, &taps) || taps % 2 == 0)) {
        return umbc_usage_error("stream: --taps '%s', must be odd and at most %d", v[OPTION_TAPS],
                                UMB_TAPS_MAX);
    }
    if (v[OPTION_MAX_ERROR] && !(umbc_parse_number(v[OPTION_MAX_ERROR], &metres) && metres >= 0)) {
        return umbc_usage_error("stream: --max-error '%s', no length", v[OPTION_MAX_ERROR]);
    }
    if (v[OPTION_MAX_PIXELS] &&
        !(umbc_parse_number(v[OPTION_MAX_PIXELS], &pixels) && pixels >= 0)) {
        return umbc_usage_error("stream: --max-pixels '%s', no number", v[OPTION_MAX_PIXELS]);
    }
    if (v[OPTION_LIMIT] && !umbc_parse_bytes(v[OPTION_LIMIT], &o->limit)) {
        return umbc_usage_error("stream: --limit '%s', no number of bytes", v[OPTION_LIMIT]);
    }
    if (v[OPTION_TIMEOUT] &&
        (!umbc_parse_count(v[OPTION_TIMEOUT], UINT32_MAX / 1000, &seconds) || seconds == 0)) {
        return umbc_usage_error("stream: --timeout '%s', no whole number of seconds",
                                v[OPTION_TIMEOUT]);
    }
    o->timeout_s = (uint32_t)seconds;
    if (v[OPTION_ROUND] && !umbc_parse_bytes(v[OPTION_ROUND], &o->round)) {
        return umbc_usage_error("stream: --round '%s', no number of bytes", v[OPTION_ROUND]);
    }
    if (v[OPTION_MEMORY] && !umbc_parse_bytes(v[OPTION_MEMORY], &o->region.max_memory_bytes)) {
        return umbc_usage_error("stream: --memory '%s', no number of bytes", v[OPTION_MEMORY]);
    }
    if (v[OPTION_ID]) {
        if (umb_id_from_text(v[OPTION_ID], o->id) != UMB_OK) {
            return umbc_usage_error("stream: --id '%s', must be 64 hexadecimal digits",
                                    v[OPTION_ID]);
        }
        o->region.id = o->id;
    }
    o->settings = (struct umb_query_settings){.light = (uint32_t)light, .taps = (uint32_t)taps};
    o->base = (struct umb_partial_view){
        .light = (uint32_t)light, .taps = (uint32_t)taps, .max_error_m = metres};
    o->base.max_error_rad = pixels; /* times a pixel's angle once the camera is known */
    return -1;
}

static void set_pixels(struct umb_partial_view *view, size_t height)
{
    view->max_error_rad *= view->camera.fov_y / (double)height;
}

/* Boxes and cameras. Returns -1 to go on, else the exit code. */
static int read_views(const struct umbc_parsed *parsed, struct umbc_paging_options *o)
{
    const char *const *v = parsed->values;
    const double aspect = (double)o->size[0] / (double)o->size[1];
    struct umb_error error;
    if (v[OPTION_BOX] && !umbc_parse_box(v[OPTION_BOX], &o->base)) {
        return umbc_usage_error("stream: --box '%s', must be X0,Y0,Z0,X1,Y1,Z1", v[OPTION_BOX]);
    }
    if (v[OPTION_MAX_PIXELS] && !v[OPTION_CAMERA] && !v[OPTION_PATH]) {
        return umbc_usage_error("stream: --max-pixels needs --camera or --path");
    }
    if (v[OPTION_PATH]) {
        if (umbc_read_path(v[OPTION_PATH], aspect, o->up, &o->base, &o->views, &error) != UMB_OK) {
            return umbc_complain(&error);
        }
        for (size_t i = 0; i < o->views.count; i++) {
            set_pixels(&o->views.list[i], o->size[1]);
        }
        return -1;
    }
    if (v[OPTION_CAMERA]) {
        if (!umbc_parse_camera(v[OPTION_CAMERA], aspect, o->up, &o->base)) {
            return umbc_usage_error(
                "stream: --camera '%s', must be eye=X,Y,Z,target=X,Y,Z[,fov=DEG][,far=M]",
                v[OPTION_CAMERA]);
        }
        set_pixels(&o->base, o->size[1]);
    }
    o->views.list = malloc(sizeof *o->views.list);
    if (!o->views.list) {
        return umbc_complain_as(UMB_E_NO_MEMORY, "out of memory");
    }
    o->views.list[0] = o->base;
    o->views.count = 1;
    return -1;
}

static int read_points(const struct umbc_parsed *parsed, struct umbc_paging_options *o)
{
    const char *const *v = parsed->values;
    enum umbc_points_format format = UMBC_POINTS_F32;
    struct umb_error error;
    if (!v[OPTION_POINTS]) {
        return v[OPTION_ONLY_POINTS] || v[OPTION_FRAMES]
                   ? umbc_usage_error("stream: --only-points and --frames need --points")
                   : -1;
    }
    if (v[OPTION_FRAMES] && !o->views.list[0].has_camera) {
        return umbc_usage_error("stream: --frames needs --camera or --path");
    }
    if (v[OPTION_FORMAT]) {
        if (strcmp(v[OPTION_FORMAT], "text") == 0) {
            format = UMBC_POINTS_TEXT;
        } else if (strcmp(v[OPTION_FORMAT], "f64") == 0) {
            format = UMBC_POINTS_F64;
        } else if (strcmp(v[OPTION_FORMAT], "f32") != 0) {
            return umbc_usage_error("stream: --format '%s', must be text, f32 or f64",
                                    v[OPTION_FORMAT]);
        }
    }
    return umbc_paging_points_load(v[OPTION_POINTS], format, v[OPTION_NORMALS] != NULL, &o->points,
                                   &error) == UMB_OK
               ? -1
               : umbc_complain_file(v[OPTION_POINTS], &error);
}

/* Where the asset is, and the words that are only handed on. */
static int read_words(const struct umbc_parsed *parsed, struct umbc_paging_options *o)
{
    o->file = parsed->values[OPTION_FROM_FILE];
    o->url = parsed->values[OPTION_FROM_URL];
    if (parsed->word_count + (o->file != NULL) + (o->url != NULL) != 1) {
        return umbc_usage_error("stream: give one of FILE, ASSET, --from-file and --from-url");
    }
    if (parsed->word_count && umbc_is_file(parsed->words[0])) {
        o->file = parsed->words[0];
    } else if (parsed->word_count) {
        o->asset = parsed->words[0];
    }
    memcpy(o->session, parsed->session, sizeof o->session);
    o->resume = parsed->values[OPTION_RESUME];
    o->output = parsed->values[OPTION_OUTPUT];
    o->frames = parsed->values[OPTION_FRAMES];
    o->only_points = parsed->values[OPTION_ONLY_POINTS] != NULL;
    o->json = parsed->values[OPTION_JSON] != NULL;
    o->quiet = parsed->values[OPTION_QUIET] != NULL;
    return umbc_check_stdout("stream", o->output, o->json);
}

int umbc_paging_options_parse(struct umbc_paging_options *o, int argc, char **argv)
{
    struct umbc_parsed parsed;
    memset(o, 0, sizeof *o);
    int code = umbc_parse(&STREAM, argc, argv, &parsed);
    code = code >= 0 ? code : read_words(&parsed, o);
    code = code >= 0 ? code : read_numbers(&parsed, o);
    code = code >= 0 ? code : read_views(&parsed, o);
    return code >= 0 ? code : read_points(&parsed, o);
}

void umbc_paging_options_finish(struct umbc_paging_options *o)
{
    umbc_paging_points_finish(&o->points);
    umbc_views_finish(&o->views);
}

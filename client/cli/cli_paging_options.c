/* SPDX-License-Identifier: Apache-2.0 */
/* See cli_paging_options.h. */
#include "cli_paging_options.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define AT(field) UMBU_AT(struct umbc_paging_options, field)
#define BYTES     UMBU_BYTES(1, (uint64_t)1 << 62)

static enum umb_status read_box(const struct umbu_option *option, const char *text, void *field,
                                struct umb_error *error)
{
    return umbc_parse_box(text, field) ? UMB_OK : umbu_refuse(option, text, error);
}

static const struct umbu_option OPTIONS[] = {
    {"FILE|ASSET", NULL, "the packed asset (.umb), or an asset of the daemon", UMBU_TEXT,
     AT(target)},
    {"from-file", "FILE", "the packed asset (.umb)", UMBU_TEXT, AT(file), .excludes = "from-url"},
    {"from-url", "URL", "the same on any web server that serves ranges", UMBU_TEXT, AT(url)},
    {"box", "X0,Y0,Z0,X1,Y1,Z1", "what answers points in this box, metres",
     UMBU_READ(read_box, "X0,Y0,Z0,X1,Y1,Z1"), AT(base)},
    {"camera", "WHERE", "eye=X,Y,Z,target=X,Y,Z[,fov=DEG][,far=M]", UMBU_TEXT, AT(camera)},
    {"path", "FILE", "a camera a line, one after the other", UMBU_TEXT, AT(path)},
    {"points", "FILE", "points to ask while it sharpens; for the figures", UMBU_TEXT,
     AT(points_file)},
    {"format", NULL, "of the points", UMBU_CHOICE("text|f32|f64"), AT(format), .standard = "f32"},
    {"normals", NULL, "raw points have normals: six numbers each", UMBU_FLAG, AT(with_normals)},
    {"only-points", NULL, "fetch just what the points need", UMBU_FLAG, AT(only_points),
     .needs = "points"},
    {"size", "WxH", "pixels of the camera's picture", UMBU_SIDES(16384), AT(size),
     .standard = "1280x720"},
    {"up", NULL, "the scene's up axis", UMBU_CHOICE("y|z"), AT(up), .standard = "y"},
    {"light", "N", "the asset's light", UMBU_COUNT(0, UMB_LIGHTS_MAX - 1), AT(base.light),
     .standard = "0"},
    {"taps", "N", "widest filter that will be asked", UMBU_ODD(1, UMB_TAPS_MAX), AT(base.taps),
     .standard = "9"},
    {"max-error", "M", "cells of this many metres are fine enough", UMBU_NUMBER(0, HUGE_VAL),
     AT(base.max_error_m)},
    {"max-pixels", "N", "so are cells of this many pixels", UMBU_NUMBER(0, HUGE_VAL),
     AT(base.max_error_rad), .needs = "camera|path"},
    {"limit", "BYTES", "stop after receiving so many (64K, 2M)", BYTES, AT(limit)},
    {"timeout", "SECONDS", "stop after so many, with what came", UMBU_COUNT(1, UINT32_MAX / 1000),
     AT(timeout_s), .otherwise = "no limit"},
    {"round", "BYTES", "ask for so many at once", BYTES, AT(round), .otherwise = "chosen"},
    {"memory", "BYTES", "what the client may use in all", BYTES, AT(region.max_memory_bytes),
     .otherwise = "1G"},
    {"id", "ID", "insist on this asset, 64 hexadecimal digits", UMBC_ID, AT(id)},
    {"resume", "PART", "go on from a file that -o wrote", UMBU_TEXT, AT(resume)},
    {"output", "PART", "keep what is here as a partial file; - is stdout", UMBU_TEXT, AT(output),
     .letter = 'o'},
    {"frames", "DIR", "a picture (PPM) of the points at each step", UMBU_TEXT, AT(frames),
     .needs = "points camera|path"},
    {"json", NULL, "print one JSON object, with every step", UMBU_FLAG, AT(json),
     .excludes = "output=-"},
    {UMBU_QUIET_ROW(struct umbc_paging_options, "print nothing but errors")},
};

static const struct umbu_command COMMAND = {
    .name = "umbrage stream",
    .usage = "umbrage stream (FILE | ASSET | --from-file FILE | --from-url URL) [options]",
    .summary = "Fetches the part of an asset that is needed, coarse first, and shows how it\n"
               "sharpens. Without --box, --camera, --path or --points it fetches everything.",
    .sections = {{"options", UMBU_ROWS(OPTIONS)},
                 UMBU_SESSION(struct umbc_paging_options, session)},
};

static void set_pixels(struct umb_partial_view *view, size_t height)
{
    view->max_error_rad *= view->camera.fov_y / (double)height;
}

/* Boxes and cameras. Returns -1 to go on, else the exit code. */
static int read_views(struct umbc_paging_options *o)
{
    const double aspect = (double)o->size[0] / (double)o->size[1];
    struct umb_error error;
    if (o->path) {
        if (umbc_read_path(o->path, aspect, "yz"[o->up], &o -> base, &o -> views, &error) !=
            UMB_OK) {
            return umbc_complain(&error);
        }
        for (size_t i = 0; i < o->views.count; i++) {
            set_pixels(&o->views.list[i], o->size[1]);
        }
        return -1;
    }
    if (o->camera) {
        if (!umbc_parse_camera(o->camera, aspect, "yz"[o->up], &o -> base)) {
            return umbc_usage_error("stream",
                                    "--camera: '%.80s' is not valid; give "
                                    "eye=X,Y,Z,target=X,Y,Z[,fov=DEG][,far=M]",
                                    o->camera);
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

static int read_points(struct umbc_paging_options *o)
{
    struct umb_error error;
    return o->points_file == NULL ||
                   umbc_paging_points_load(o->points_file, o->format, o->with_normals, &o->points,
                                           &error) == UMB_OK
               ? -1
               : umbc_complain_file(o->points_file, &error);
}

int umbc_paging_options_parse(struct umbc_paging_options *o, int argc, char **argv)
{
    struct umbu_parsed parsed;
    memset(o, 0, sizeof *o);
    int code = umbu_start(&parsed, &COMMAND, argc, argv, o);
    if (code >= 0) {
        return code;
    }
    if ((o->target != NULL) + (o->file != NULL) + (o->url != NULL) != 1) {
        return umbc_usage_error("stream", "give one of FILE, ASSET, --from-file and --from-url");
    }
    if (o->target != NULL) {
        *(umbc_is_file(o->target) ? &o->file : &o->asset) = o->target;
    }
    o->region.id = umbu_given(&parsed, "id") ? o->id : NULL;
    o->settings = (struct umb_query_settings){.light = o->base.light, .taps = o->base.taps};
    code = read_views(o);
    return code >= 0 ? code : read_points(o);
}

void umbc_paging_options_finish(struct umbc_paging_options *o)
{
    umbc_paging_points_finish(&o->points);
    umbc_views_finish(&o->views);
}

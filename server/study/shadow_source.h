/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_SHADOW_SOURCE_H
#define UMBRAGE_SERVER_STUDY_SHADOW_SOURCE_H
/*
 * Sources of shadows: an asset file queried in process, or an asset of a daemon queried through
 * libumbrage. The answers are the same bits.
 *
 * An argument is a file if a file of that name exists, if it holds a '/', or if it ends in .umb or
 * .umbm. Else it names an asset of a daemon: at the given address, or UMBRAGE_ADDRESS, or
 * tcp:127.0.0.1:7420; with the token in the given file, or UMBRAGE_TOKEN, or none.
 * Threads: after init, umbt_shadow_source_answer may be called from any number of threads.
 */
#include "tool/session.h"
#include "umbrage/query.h"

struct umbt_shadow_source {
    const char *name;          /* file or asset as given, borrowed */
    struct umb_asset *asset;   /* the file's asset; NULL: a daemon's */
    struct umb_client *client; /* connection to the daemon; NULL: a file */
    size_t call_max;           /* daemon: most points of a call */
    struct umb_query_settings settings;
    struct umb_query query;     /* file: the prepared query */
    struct umb_asset_info info; /* daemon: id and scene_hash only */
    struct umb_light_info light;
    struct umb_frustum_info frustum; /* file: the light's first; daemon: zeroed */
    struct umb_frustum_info *frusta; /* file: all of the light's; daemon: NULL */
    uint32_t light_count;            /* lights of the asset */
    unsigned scene_flags;            /* of enum umbt_scene_flags, as the asset takes casters */
    int is_borrowed;                 /* 1: asset and client are another source's */
};

/* 1 if the argument names a file by the rule above. */
int umbt_shadow_source_is_file(const char *argument);

/*
 * Opens the source and checks the settings against it.
 *
 * In:    settings: format must be UMB_ANSWER_F32.
 * Fails: E_NO_MEMORY, and the errors of umb_asset_open_file, umb_query_prepare and
 *        umb_client_describe; E_NO_INPUT, E_PERMISSION, E_IO or E_ARGUMENT (token file).
 */
UMB_CHECKED enum umb_status umbt_shadow_source_open(struct umbt_shadow_source *source,
                                                    const char *argument,
                                                    const struct umbu_session *daemon,
                                                    const struct umb_query_settings *settings,
                                                    struct umb_error *error);

/* Opens the source of another light of the same asset. It borrows from `first`, which must last
 * longer. Fails: E_NO_MEMORY, E_NOT_FOUND, and the errors of umb_query_prepare. */
UMB_CHECKED enum umb_status umbt_shadow_source_of_light(struct umbt_shadow_source *source,
                                                        const struct umbt_shadow_source *first,
                                                        uint32_t light, struct umb_error *error);
void umbt_shadow_source_close(struct umbt_shadow_source *source); /* a zeroed struct is allowed */

/* Sets the footprint filter for pixels that subtend pixel_rad radians at an eye. Fails: the errors
 * of umb_query_prepare. */
UMB_CHECKED enum umb_status umbt_shadow_source_look(struct umbt_shadow_source *source,
                                                    const double eye[3], double pixel_rad,
                                                    struct umb_error *error);

/*
 * Answers points in world space, double[3 * count], with normals.
 *
 * Out:   values: float[count]. stats: added to.
 * Fails: file: E_ARGUMENT (not finite); daemon: the errors of umb_client_query.
 */
UMB_CHECKED enum umb_status umbt_shadow_source_answer(const struct umbt_shadow_source *source,
                                                      const struct umb_points *points,
                                                      float *values, struct umb_query_stats *stats,
                                                      struct umb_error *error);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CLI_CLI_VIEW_SITE_H
#define UMBRAGE_CLI_CLI_VIEW_SITE_H
/*
 * The files of the viewer: a fixed list of paths and what each stands for. The server answers the
 * paths of the list and no other, so a request never becomes a path of the file system.
 *
 * Threads: after it is made, any number of threads may read a site.
 */
#include <pthread.h>
#include <stdbool.h>
#include "umbrage/file.h"
#include "umbrage/region.h"

#define UMBC_VIEW_FILES_MAX 8192

struct umbc_view_file {
    char *path;   /* Path in the site, without the first slash; "" is not used */
    char *source; /* Path of the file; NULL: `bytes` or the asset */
    char *bytes;  /* [size]; NULL: `source` or the asset */
    size_t size;
};

struct umbc_view_site {
    struct umbc_view_file *files; /* [count] */
    size_t count;
    struct umb_region_source asset;   /* Borrowed */
    struct umb_file_head head;        /* Of the asset */
    uint8_t scene_hash[UMB_ID_BYTES]; /* Hash of the scene that the asset was baked from */
    bool z_up;                        /* Up axis of that scene */
    pthread_mutex_t lock;             /* One thread at a time reads the asset's source */
};

/* An open file of the site. */
struct umbc_view_body {
    struct umbc_view_site *site;
    const struct umbc_view_file *file;
    int fd; /* -1: bytes, or the asset */
    uint64_t size;
};

/* Begins a site with an asset, and reads the asset's head. Fails: E_UNSUPPORTED (not a packed
 * file), or as the source. Call umbc_view_site_finish also after a failure. */
UMB_CHECKED enum umb_status umbc_view_site_begin(struct umbc_view_site *site,
                                                 const struct umb_region_source *asset,
                                                 struct umb_error *error);

/* Adds a file. Its content is a file on disk (`source`), or bytes (owned by the site from then on,
 * also after a failure), or, with neither, the asset. Fails: E_LIMIT, E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbc_view_site_add(struct umbc_view_site *site, const char *path,
                                               const char *source, char *bytes, size_t size,
                                               struct umb_error *error);
/* Checks that the asset was baked from a scene, as far as umbrage-bake is installed; otherwise prints
 * a notice unless quiet. In: asset: its name, for the message. Fails: E_BAD_SCENE. */
UMB_CHECKED enum umb_status umbc_view_scene_match(const struct umbc_view_site *site,
                                                  const char *asset, const char *scene, bool quiet,
                                                  struct umb_error *error);

void umbc_view_site_finish(struct umbc_view_site *site);

/* Returns the file of a path, or NULL. */
const struct umbc_view_file *umbc_view_site_find(const struct umbc_view_site *site,
                                                 const char *path);

/* Returns the media type of a file, from the ending of its path. */
const char *umbc_view_type(const struct umbc_view_file *file);

/* Opens a file. Fails: E_NO_INPUT. */
UMB_CHECKED enum umb_status umbc_view_body_open(struct umbc_view_site *site,
                                                const struct umbc_view_file *file,
                                                struct umbc_view_body *body,
                                                struct umb_error *error);

/* Reads exactly `size` bytes of a body. Fails: E_IO, E_TRUNCATED, or as the asset's source. */
UMB_CHECKED enum umb_status umbc_view_body_read(struct umbc_view_body *body, uint64_t offset,
                                                uint8_t *bytes, size_t size,
                                                struct umb_error *error);
void umbc_view_body_close(struct umbc_view_body *body);

#endif

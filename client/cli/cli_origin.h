/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CLI_CLI_ORIGIN_H
#define UMBRAGE_CLI_CLI_ORIGIN_H
/* Where `umbrage stream` reads an asset: a file, a web server or a daemon; and how it learns that
 * there is a new version. */
#include "cli/shared/cli_common.h"
#include "umbrage/region.h"

struct umbc_origin {
    const char *file, *url, *asset; /* One is set; an asset is a daemon's */
    struct umbu_session session;
    uint32_t
        timeout_s;     /* Seconds after the first open at which reads and waits end with E_DEADLINE;
                           0: never */
    double interval_s; /* Seconds between two looks at a file or a URL */
    double stop_s;     /* Time of umbu_clock_s at which timeout_s is over; 0: never */
    struct umb_client *client; /* NULL for a file and a URL */
};

/* Opens a source of the version that is there now. Owns: the caller closes it with
 * umbc_origin_close. Fails: as umb_region_file_open, umbc_http_open and umbu_connect. */
UMB_CHECKED enum umb_status umbc_origin_open(struct umbc_origin *origin,
                                             struct umb_region_source *source,
                                             struct umb_error *error);
void umbc_origin_close(const struct umbc_origin *origin, struct umb_region_source *source);

/*
 * Waits until the origin has another version than `id`. A daemon tells (Regions.Watch); of a file
 * or a URL the first 128 bytes are read each interval. While there is no asset, or a damaged one,
 * the wait goes on.
 *
 * Fails: E_DEADLINE; any other refusal, such as of a token.
 */
UMB_CHECKED enum umb_status umbc_origin_wait(struct umbc_origin *origin,
                                             const uint8_t id[UMB_ID_BYTES],
                                             struct umb_error *error);

/* Closes the connection to the daemon. */
void umbc_origin_finish(struct umbc_origin *origin);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CLI_CLI_HTTP_H
#define UMBRAGE_CLI_CLI_HTTP_H
/*
 * A region's source over HTTP: byte ranges of one URL from a static file server or object store, by
 * libcurl. It speaks http and https; libcurl takes proxies and certificates from the environment.
 */
#include "umbrage/region.h"

/* Opens a source; connects at the first read. In: stop_s: time of umbu_clock_s at which open
 * requests end and new ones fail with E_DEADLINE; 0: never. Fails: E_ARGUMENT (no http or https
 * URL), E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbc_http_open(const char *url, double stop_s,
                                           struct umb_region_source *source,
                                           struct umb_error *error);

void umbc_http_close(struct umb_region_source *source);

#endif

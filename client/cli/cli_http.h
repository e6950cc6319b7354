/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CLI_CLI_HTTP_H
#define UMBRAGE_CLI_CLI_HTTP_H
/*
 * A region's source over HTTP: ranges of one URL from any static file server or object store, by
 * libcurl. http and https, proxies and certificates as libcurl finds them in the environment.
 */
#include "umbrage/region.h"

/* Opens a source; connects at the first read. Fails: E_ARGUMENT (no http or https URL),
 * E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbc_http_open(const char *url, struct umb_region_source *source,
                                           struct umb_error *error);
/* Sets the time (umbu_clock_s) at which open requests end and new ones fail, with E_DEADLINE. */
void umbc_http_stop_at(struct umb_region_source *source, double clock_s);

void umbc_http_close(struct umb_region_source *source);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CLI_CLI_HTTP_H
#define UMBRAGE_CLI_CLI_HTTP_H
/*
 * A region's source over HTTP: byte ranges of one URL from umbraged, a static file server or an
 * object store, by libcurl. It speaks http and https; libcurl takes proxies from the environment.
 */
#include "umbrage/client.h"
#include "umbrage/region.h"

/*
 * Opens a source; connects at the first read.
 *
 * In:    stop_s: time of umbu_clock_s at which open requests end and new ones fail with E_DEADLINE;
 *        0: never. identity: token_file, ca_file, certificate_file and key_file are used; only a
 *        token that the user names for this command is sent, because a URL may be any server's.
 *        curl drops it when a redirect leads to another host.
 * Fails: E_ARGUMENT (no http or https URL, no token in the file), E_NO_INPUT, E_IO, E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbc_http_open(const char *url, double stop_s,
                                           const struct umb_client_options *identity,
                                           struct umb_region_source *source,
                                           struct umb_error *error);

void umbc_http_close(struct umb_region_source *source);

#endif

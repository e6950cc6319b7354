/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_COMMON_STANDARD_STREAMS_H
#define UMBRAGE_SERVER_COMMON_STANDARD_STREAMS_H

/*
 * Opens /dev/null in place of each closed standard descriptor. Without this the next file or socket
 * would get that number and all printed text; libuv ends the process when it closes one of them.
 * Without a /dev/null nothing changes. Call it before anything else is opened.
 */
void umbs_standard_streams_open(void);

#endif

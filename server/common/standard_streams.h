/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_COMMON_STANDARD_STREAMS_H
#define UMBRAGE_SERVER_COMMON_STANDARD_STREAMS_H

/*
 * Opens /dev/null in place of each standard descriptor that is closed. Without it the next file or
 * socket gets that number, and with it all that is printed; libuv ends the process when it closes
 * one. Where there is no /dev/null nothing changes. To be called before anything else is opened.
 */
void umbs_standard_streams_open(void);

#endif

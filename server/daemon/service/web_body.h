/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_SERVICE_WEB_BODY_H
#define UMBRAGE_SERVER_DAEMON_SERVICE_WEB_BODY_H
/*
 * Bodies of replies that have the bytes of a packed file: the whole file, one range, or several
 * ranges as multipart/byteranges. A worker reads a piece at a time, the next one while the client
 * takes the one before. A reply therefore holds two pieces, whatever the size of the file.
 */
#include "daemon/call/call.h"
#include "umbrage/region.h"

/* Room for the fields that describe an asset. */
#define UMBD_WEB_ASSET_BYTES 400

#define UMBD_WEB_TYPE "Content-Type: application/octet-stream\r\n"

/*
 * Begins the body of a reply; the head follows with the first piece.
 *
 * In:    entry: taken over and then NULL, unless memory is short. fields: the head's fields for the
 *        asset. ranges: [count], without common bytes; count 0 = the whole file.
 * Returns the number of bytes of the body; 0 after failing the call.
 */
uint64_t umbd_web_body_begin(struct umbd_call *call, struct umbs_entry **entry, const char *fields,
                             const struct umb_range *ranges, size_t count);

/* Sends a head without a body. */
void umbd_web_send(struct umbd_call *call, const char *head, size_t size);

/* Functions for the table of methods. _more is called when the client has taken a piece, and ten
 * times a second; _close when the call ends. */
void umbd_web_body_more(struct umbd_call *call);
void umbd_web_body_close(struct umbd_call *call);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_SCENE_SCENE_BROKER_H
#define UMBRAGE_SERVER_SCENE_SCENE_BROKER_H
/*
 * The broker gives the importer's process the files that a scene names. The importer may open no
 * file. It sends a name over a socket; its parent opens the file beneath the scene's folder and
 * passes the descriptor back.
 *
 * A request is one datagram with the name. The answer is one datagram with an int32_t errno; if
 * errno is 0, the descriptor accompanies it.
 */
#include <stdint.h>

/* Makes a pair of connected sockets, close-on-exec: [0] the parent's, [1] the importer's. Out: 0,
 * or -1 and errno. */
int umbs_broker_pair(int ends[2]);

/*
 * The parent's side: answers one waiting request; never blocks.
 *
 * In:    left: number of requests that may still be answered; decreases with each.
 * Out:   1; 0 if the other side has hung up; -1 if a request came when none was left.
 * Trust: the importer may be hostile: it gets regular files beneath the folder and nothing else.
 */
int umbs_broker_serve(int end, int folder, uint32_t *left);

/*
 * The importer's side: like umbs_open_beneath, but through the parent. Out: a descriptor, or -1 and
 * errno (EPIPE if the parent has hung up). Blocks until the parent answers.
 */
int umbs_broker_open(int end, const char *name);

#endif

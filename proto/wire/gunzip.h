/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_WIRE_GUNZIP_H
#define UMBRAGE_WIRE_GUNZIP_H
/* Compressed messages (grpc-encoding: gzip; each message is a gzip stream of its own). */
#include <stddef.h>
#include <stdint.h>
#include "umbrage/status.h"

/* Largest decompressed message. A server decompresses between other work, at some 200 MB a second,
 * and points hardly compress. Clients with more data send it uncompressed. */
#define UMBW_GUNZIP_MAX ((size_t)4 << 20)

/*
 * Inflates a message. In: max: bytes of the result at most, UMBW_GUNZIP_MAX if that is less.
 * Out:   out: malloc, free() it. Fails: E_TOO_LARGE, E_ARGUMENT (not one whole gzip stream),
 *        E_NO_MEMORY; out is then NULL.
 * Trust: safe on hostile bytes; memory grows with what comes out, at most doubling.
 */
UMB_CHECKED enum umb_status umbw_gunzip(const uint8_t *bytes, size_t size, size_t max,
                                        uint8_t **out, size_t *out_size, struct umb_error *error);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_FILE_H
#define UMBRAGE_FILE_H
/*
 * Asset files as bytes: conversion between the two encodings, and proof that a file's content is
 * the one that its id names.
 *
 *     // static enum umb_status append(void *user, const void *bytes, size_t count)
 *     const struct umb_sink sink = {append, file};
 *     if (umb_asset_write(asset, UMB_ENCODING_MAPPED, umb_sha256_openssl(), &sink, &error)) {
 *         return error.status;
 *     }
 *
 * The core has no SHA-256 and writes no files: both are interfaces that the caller fills in.
 * libumbrage has a ready hash, umb_sha256_openssl() of umbrage/region.h. A program that links
 * libumbrage-core alone wraps the hash of its own crypto library in one function.
 *
 * Trust: safe on hostile bytes.
 * Threads: any number at once, each call with a sink and a hash of its own or thread-safe ones.
 * Stability: stable; umbrage/version.h says what that means.
 */
#include <stddef.h>
#include <stdint.h>
#include "umbrage/asset.h"
#include "umbrage/status.h"

#ifdef __cplusplus
extern "C" {
#endif

#define UMB_FILE_HEAD_BYTES 128 /* First bytes of a file that umb_file_read_head needs */

/* Destination of bytes, which come in order: a file, a socket, a buffer. */
struct umb_sink {
    /* Takes the next bytes. Returns UMB_OK, or the status that stops the writer. */
    enum umb_status (*write)(void *user, const void *bytes, size_t count);
    void *user; /* First argument of `write` */
};

/* A SHA-256 implementation. */
struct umb_sha256 {
    /* Writes the digest of the concatenation of part_count parts. Writes zeros if the digest could
     * not be made (out of memory), which counts as E_NO_MEMORY: no input is known to have that
     * digest. */
    void (*digest)(void *user, const void *const *parts, const size_t *sizes, size_t part_count,
                   uint8_t out[UMB_ID_BYTES]);
    void *user; /* First argument of both functions */
    /* Writes digests[i] of message i for `count` messages at once, equal to the results of
     * `digest`. NULL: messages are hashed one by one. */
    void (*digest_many)(void *user, const uint8_t *const *messages, const size_t *sizes,
                        size_t count, uint8_t (*digests)[UMB_ID_BYTES]);
};

/* What the first bytes of an asset file claim; nothing of it is proven. */
struct umb_file_head {
    enum umb_encoding encoding;
    uint8_t id[UMB_ID_BYTES]; /* Identity that the file claims */
    uint64_t file_bytes;      /* Length of the whole file */
    uint64_t open_bytes;  /* Length of the file's head and, of a packed file, the first block of its
                             directory: the bytes that umb_partial_open needs */
    uint64_t reserved[4]; /* Zero: room for later versions (umbrage/version.h) */
};

/* A file's bytes, mapped for reading. */
struct umb_file {
    const void *bytes; /* uint8[size] */
    size_t size;       /* Length in bytes, above 0 */
};

/*
 * Maps a regular file.
 *
 * Out:   file: zeroed on failure.
 * Owns:  the caller closes it with umb_file_close.
 * Fails: E_NO_INPUT (missing, no regular file), E_PERMISSION, E_LIMIT (no descriptor left),
 *        E_TRUNCATED (empty), E_TOO_LARGE (larger than the address space), E_IO.
 * Caveat: a process that truncates the file meanwhile makes reads of its bytes raise SIGBUS.
 */
UMB_API UMB_CHECKED enum umb_status umb_file_open(const char *path, struct umb_file *file,
                                                  struct umb_error *error);

/* Unmaps a file and zeroes the struct. A zeroed struct is allowed. */
UMB_API void umb_file_close(struct umb_file *file);

/*
 * Reads the encoding, id and lengths of an asset file from its first bytes.
 *
 * In:    bytes: uint8[size], the file's first UMB_FILE_HEAD_BYTES or more.
 * Out:   head: unspecified on failure.
 * Fails: E_FORMAT, E_VERSION, E_TRUNCATED (too few bytes), E_UNSUPPORTED (a partial file),
 *        E_CORRUPT (numbers that contradict each other).
 * Cost:  O(1).
 */
UMB_API UMB_CHECKED enum umb_status umb_file_read_head(const void *bytes, size_t size,
                                                       struct umb_file_head *head,
                                                       struct umb_error *error);

/*
 * Writes an open asset in either encoding.
 *
 * In:    sha256: makes the id of a packed file; may be NULL for a mapped one.
 * Out:   sink: gets the file's bytes in order; after a failure it may have got some of them.
 * Fails: E_ARGUMENT (unknown encoding, no sha256), E_CORRUPT (packed: as umb_asset_prove; the id
 *        is known only behind the last byte, so discard the output), E_NO_MEMORY, or what the sink
 *        returns.
 * Cost:  mapped: one pass over the asset. Packed: linear in its nodes, memory about the packed size
 *        and 8 bytes a node; tens of seconds for assets of 100 MB.
 */
UMB_API UMB_CHECKED enum umb_status umb_asset_write(const struct umb_asset *asset,
                                                    enum umb_encoding encoding,
                                                    const struct umb_sha256 *sha256,
                                                    const struct umb_sink *sink,
                                                    struct umb_error *error);

/*
 * Proves that an open asset has the content that its id names, by packing the asset again. This is
 * the only proof of a mapped file, which carries no hashes.
 *
 * Fails: E_ARGUMENT (no sha256), E_CORRUPT (another id: damaged, or of a version that packs
 *        otherwise), E_NO_MEMORY.
 * Cost:  as umb_asset_write of a packed file.
 */
UMB_API UMB_CHECKED enum umb_status umb_asset_prove(const struct umb_asset *asset,
                                                    const struct umb_sha256 *sha256,
                                                    struct umb_error *error);

/*
 * Proves the bytes of a packed file without expanding it: the head, the directory and every page
 * hash to the id in its header.
 *
 * In:    bytes: uint8[size]. id: uint8[UMB_ID_BYTES], the id to require, or NULL: any.
 * Fails: E_ARGUMENT (no sha256), E_FORMAT, E_VERSION, E_TRUNCATED, E_CORRUPT (damaged, or not the
 *        required id), E_UNSUPPORTED (a mapped file), E_NO_MEMORY.
 * Not guaranteed: that the octree is sound. Opening the bytes checks it, and nothing else does.
 * Cost:  one pass of zstd and SHA-256 over the file.
 */
UMB_API UMB_CHECKED enum umb_status umb_packed_prove(const void *bytes, size_t size,
                                                     const uint8_t *id,
                                                     const struct umb_sha256 *sha256,
                                                     struct umb_error *error);

#ifdef __cplusplus
}
#endif
#endif

/* SPDX-License-Identifier: Apache-2.0 */
/* See proofs.h. A record is one file of the cache, so it is written, checked, counted and removed
 * as a tile's result is. */
#include "bake/tiles/proofs.h"

#include <stdlib.h>
#include <string.h>

#include "bake/analysis/plan.h"
#include "bake/tiles/caster_bytes.h"
#include "base/bytes.h"
#include "base/try.h"
#include "common/sha256.h"
#include "umbrage/version.h"

#define MAGIC        "UMBPRF1\n"
#define HEAD_BYTES   ((size_t)16)
#define TILE_BYTES   ((size_t)2 * UMB_ID_BYTES)
#define SQUARE_BYTES ((size_t)32)

/* Log2 of the most squares across a frustum: 262144 squares are 8 MiB of record. */
#define SQUARES_ACROSS_LOG2 9U

static const char place_domain[16] = "umbrage proof";

static void add_doubles(struct umbs_sha256_run *run, const double *values, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        uint8_t bytes[8];
        umb__store_f64(bytes, values[i]);
        umbs_sha256_add(run, bytes, sizeof bytes);
    }
}

/* Names a frustum's record: light, matrix, origin, sizes and versions. */
static void name_place(const struct umbb_proofs_job *job, uint32_t number,
                       struct umbb_frustum_proofs *proofs)
{
    const struct umb_frustum_info *frustum = &job->analysis->frusta[number];
    const struct umb_light_info *light = &job->analysis->choice.lights[frustum->light];
    const uint32_t numbers[] = {UMBB_BAKE_VERSION,         number,
                                (uint32_t)light->kind,     proofs->log2_size,
                                proofs->tile_log2,         proofs->square_log2,
                                (uint32_t)frustum->closed, (uint32_t)job->occluder_depth};
    struct umbs_sha256_run run;
    umbs_sha256_begin(&run);
    umbs_sha256_add(&run, place_domain, sizeof place_domain);
    umbs_sha256_add(&run, UMB_VERSION_TEXT, sizeof UMB_VERSION_TEXT);
    for (size_t i = 0; i < sizeof numbers / sizeof numbers[0]; i++) {
        uint8_t bytes[4];
        umb__store32(bytes, numbers[i]);
        umbs_sha256_add(&run, bytes, sizeof bytes);
    }
    add_doubles(&run, light->direction, 3);
    add_doubles(&run, light->position, 3);
    add_doubles(&run, frustum->world_to_voxel[0], 16);
    add_doubles(&run, job->analysis->origin, 3);
    umbs_sha256_end(&run, proofs->place);
}

static size_t record_bytes(const struct umbb_frustum_proofs *proofs)
{
    return HEAD_BYTES + proofs->tile_count * (TILE_BYTES + proofs->square_count * SQUARE_BYTES) +
           UMB_ID_BYTES;
}

/* Reads a square's record. */
static const uint8_t *get_square(const uint8_t *at, struct umbb_square_proof *square)
{
    memcpy(square->digest, at, UMBB_SQUARE_DIGEST);
    square->time_s = umb__load64(at + UMBB_SQUARE_DIGEST);
    square->columns = umb__load32(at + UMBB_SQUARE_DIGEST + 8);
    square->points = umb__load32(at + UMBB_SQUARE_DIGEST + 12);
    return at + SQUARE_BYTES;
}

static uint8_t *put_square(uint8_t *at, const struct umbb_square_proof *square)
{
    memcpy(at, square->digest, UMBB_SQUARE_DIGEST);
    umb__store64(at + UMBB_SQUARE_DIGEST, square->time_s);
    umb__store32(at + UMBB_SQUARE_DIGEST + 8, square->columns);
    umb__store32(at + UMBB_SQUARE_DIGEST + 12, square->points);
    return at + SQUARE_BYTES;
}

/* Decodes a record. Returns 0, and leaves all squares without a record, if the bytes are not a
 * whole record. */
static int decode(struct umbb_frustum_proofs *proofs, const uint8_t *bytes, size_t size)
{
    uint8_t digest[UMB_ID_BYTES];
    if (size != record_bytes(proofs) || memcmp(bytes, MAGIC, 8) != 0 ||
        umb__load32(bytes + 8) != proofs->tile_count ||
        umb__load32(bytes + 12) != proofs->square_count) {
        return 0;
    }
    umbs_sha256_bytes(bytes, size - UMB_ID_BYTES, digest);
    if (memcmp(digest, bytes + size - UMB_ID_BYTES, UMB_ID_BYTES) != 0) {
        return 0;
    }
    const uint8_t *at = bytes + HEAD_BYTES;
    for (size_t i = 0; i < proofs->tile_count; i++, at += TILE_BYTES) {
        memcpy(proofs->before[i].key, at, UMB_ID_BYTES);
        memcpy(proofs->before[i].result, at + UMB_ID_BYTES, UMB_ID_BYTES);
    }
    for (size_t i = 0; i < proofs->tile_count * proofs->square_count; i++) {
        at = get_square(at, &proofs->squares[i]);
    }
    return 1;
}

/* Reads the frustum's record, if the cache has a whole one. */
static void read_record(struct umbb_frustum_proofs *proofs, struct umbb_tile_cache *cache)
{
    uint8_t *bytes;
    size_t size;
    struct umb_error cause;
    if (umbb_tile_cache_read(cache, proofs->place, 4 * record_bytes(proofs), &bytes, &size,
                             &cause) == UMB_OK &&
        bytes != NULL && !decode(proofs, bytes, size)) {
        umbb_tile_cache_drop(cache, proofs->place);
    }
    free(bytes);
}

static enum umb_status open_frustum(const struct umbb_proofs_job *job, uint32_t number,
                                    struct umbb_frustum_proofs *proofs, struct umb_error *error)
{
    const uint32_t log2_size = job->analysis->frusta[number].log2_size;
    proofs->log2_size = log2_size;
    proofs->tile_log2 = job->tile_log2;
    proofs->points = job->points;
    proofs->square_log2 = log2_size > UMBB_SQUARE_LOG2 + SQUARES_ACROSS_LOG2
                              ? log2_size - SQUARES_ACROSS_LOG2
                              : UMBB_SQUARE_LOG2;
    proofs->tile_count = (size_t)1 << (2 * (log2_size - job->tile_log2));
    proofs->square_count = (size_t)1 << (2 * (job->tile_log2 - proofs->square_log2));
    const size_t squares = proofs->tile_count * proofs->square_count;
    name_place(job, number, proofs);
    proofs->before = calloc(proofs->tile_count, sizeof *proofs->before);
    proofs->now = calloc(proofs->tile_count, sizeof *proofs->now);
    proofs->squares = calloc(squares, sizeof *proofs->squares);
    proofs->squares_now = calloc(squares, sizeof *proofs->squares_now);
    proofs->inherited = calloc(proofs->tile_count, 1);
    proofs->casters = calloc(proofs->tile_count, sizeof *proofs->casters);
    if (proofs->before == NULL || proofs->now == NULL || proofs->squares == NULL ||
        proofs->squares_now == NULL || proofs->inherited == NULL || proofs->casters == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "proofs: memory for %zu squares refused", squares);
    }
    read_record(proofs, job->cache);
    return UMB_OK;
}

/* Bytes of the records of a bake in memory, while they are read; SIZE_MAX if its tiles are smaller
 * than squares. */
static size_t memory_bytes(const struct umbb_proofs_job *job)
{
    uint64_t bytes = 0;
    for (uint32_t i = 0; i < job->analysis->frustum_count; i++) {
        const uint32_t log2_size = job->analysis->frusta[i].log2_size;
        if (job->tile_log2 < UMBB_SQUARE_LOG2 || job->tile_log2 + SQUARES_ACROSS_LOG2 < log2_size) {
            return SIZE_MAX;
        }
        const uint32_t most = log2_size - UMBB_SQUARE_LOG2;
        const uint32_t across = most < SQUARES_ACROSS_LOG2 ? most : SQUARES_ACROSS_LOG2;
        bytes += (uint64_t)4 * sizeof(struct umbb_square_proof) << (2 * across);
    }
    return bytes < SIZE_MAX ? (size_t)bytes : SIZE_MAX;
}

enum umb_status umbb_proofs_open(struct umbb_proofs *proofs, const struct umbb_proofs_job *job,
                                 struct umb_error *error)
{
    const uint32_t count = job->analysis->frustum_count;
    *proofs = (struct umbb_proofs){.cache = job->cache};
    if (memory_bytes(job) > job->max_bytes) {
        return UMB_OK;
    }
    proofs->frusta = calloc(count, sizeof *proofs->frusta);
    if (proofs->frusta == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "proofs: memory for %u frusta refused", count);
    }
    proofs->frustum_count = count;
    for (uint32_t i = 0; i < count; i++) {
        UMB__TRY(open_frustum(job, i, &proofs->frusta[i], error));
    }
    return UMB_OK;
}

void umbb_proofs_close(struct umbb_proofs *proofs)
{
    for (uint32_t i = 0; i < proofs->frustum_count; i++) {
        struct umbb_frustum_proofs *one = &proofs->frusta[i];
        for (size_t t = 0; one->casters != NULL && t < one->tile_count; t++) {
            free(one->casters[t]);
        }
        free((void *)one->casters);
        free(one->before);
        free(one->now);
        free(one->squares);
        free(one->squares_now);
        free(one->inherited);
    }
    free(proofs->frusta);
    memset(proofs, 0, sizeof *proofs);
}

int umbb_proofs_contradict(const struct umbb_frustum_proofs *proofs, uint32_t tile,
                           const uint8_t key[UMB_ID_BYTES], const uint8_t digest[UMB_ID_BYTES])
{
    const struct umbb_tile_proof *before = &proofs->before[tile];
    return memcmp(before->key, key, UMB_ID_BYTES) == 0 &&
           memcmp(before->result, digest, UMB_ID_BYTES) != 0;
}

int umbb_square_is_proven(const struct umbb_frustum_proofs *proofs,
                          const struct umbb_square_proof *square)
{
    return square->time_s != 0 && (square->columns > 0 || square->points >= proofs->points);
}

/* 1 if all squares of a tile were compared. In: squares: [square_count] */
static int is_proven(const struct umbb_frustum_proofs *proofs,
                     const struct umbb_square_proof *squares)
{
    for (size_t i = 0; i < proofs->square_count; i++) {
        if (!umbb_square_is_proven(proofs, &squares[i])) {
            return 0;
        }
    }
    return 1;
}

enum umb_status umbb_proofs_note(struct umbb_frustum_proofs *proofs, const struct umbb_depth *depth,
                                 const struct umbb_tile_place *place,
                                 const uint8_t key[UMB_ID_BYTES],
                                 const uint8_t digest[UMB_ID_BYTES], struct umb_error *error)
{
    struct umbb_tile_proof *now = &proofs->now[place->number];
    const struct umbb_tile_proof *before = &proofs->before[place->number];
    const size_t first = place->number * proofs->square_count;
    memcpy(now->key, key, UMB_ID_BYTES);
    memcpy(now->result, digest, UMB_ID_BYTES);
    if (memcmp(now, before, sizeof *now) == 0 && is_proven(proofs, &proofs->squares[first])) {
        proofs->inherited[place->number] = 1;
        memcpy(&proofs->squares_now[first], &proofs->squares[first],
               proofs->square_count * sizeof *proofs->squares);
        return UMB_OK;
    }
    uint8_t(*casters)[UMBB_SQUARE_DIGEST] = malloc(proofs->square_count * sizeof *casters);
    if (casters == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "proofs: memory for a tile refused");
    }
    proofs->casters[place->number] = casters;
    return umbb_casters_of_squares(depth, place, proofs->tile_log2, proofs->square_log2, casters,
                                   error);
}

void umbb_proofs_refuse(const struct umbb_proofs *proofs)
{
    for (uint32_t f = 0; f < proofs->frustum_count; f++) {
        const struct umbb_frustum_proofs *one = &proofs->frusta[f];
        for (size_t tile = 0; tile < one->tile_count; tile++) {
            if (!one->inherited[tile] && one->casters[tile] != NULL) {
                umbb_tile_cache_drop(proofs->cache, one->now[tile].key);
            }
        }
    }
}

/* 1 if a frustum's record differs from the one that was read. */
static int is_changed(const struct umbb_frustum_proofs *proofs)
{
    return memcmp(proofs->before, proofs->now, proofs->tile_count * sizeof *proofs->now) != 0 ||
           memcmp(proofs->squares, proofs->squares_now,
                  proofs->tile_count * proofs->square_count * sizeof *proofs->squares) != 0;
}

static enum umb_status keep_frustum(struct umbb_tile_cache *cache,
                                    const struct umbb_frustum_proofs *proofs,
                                    struct umb_error *error)
{
    const size_t size = record_bytes(proofs);
    uint8_t *bytes = malloc(size);
    if (bytes == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "proofs: memory for a record refused");
    }
    memcpy(bytes, MAGIC, 8);
    umb__store32(bytes + 8, (uint32_t)proofs->tile_count);
    umb__store32(bytes + 12, (uint32_t)proofs->square_count);
    uint8_t *at = bytes + HEAD_BYTES;
    for (size_t i = 0; i < proofs->tile_count; i++, at += TILE_BYTES) {
        memcpy(at, proofs->now[i].key, UMB_ID_BYTES);
        memcpy(at + UMB_ID_BYTES, proofs->now[i].result, UMB_ID_BYTES);
    }
    for (size_t i = 0; i < proofs->tile_count * proofs->square_count; i++) {
        at = put_square(at, &proofs->squares_now[i]);
    }
    umbs_sha256_bytes(bytes, size - UMB_ID_BYTES, at);
    const enum umb_status status = umbb_tile_cache_write(cache, proofs->place, bytes, size, error);
    free(bytes);
    return status;
}

enum umb_status umbb_proofs_keep(const struct umbb_proofs *proofs, struct umb_error *error)
{
    for (uint32_t i = 0; i < proofs->frustum_count; i++) {
        if (is_changed(&proofs->frusta[i])) {
            UMB__TRY(keep_frustum(proofs->cache, &proofs->frusta[i], error));
        }
    }
    return UMB_OK;
}

/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_TRANSMITTANCE_FIXTURE_H
#define UMBRAGE_TESTS_TRANSMITTANCE_FIXTURE_H
/*
 * Assets of two lights with translucent casters. Every texel has random layers before it, kept
 * twice: as the transmittances that they leave (long double products) and as the lists that a file
 * stores. Opaque voxels stand at random between them.
 */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <math.h>
#include <openssl/evp.h>
#include <stdlib.h>
#include <string.h>

#include "format/transmittance.h"
#include "make_asset.h"
#include "volume_fixture.h"

enum {
    TF_LOG2 = 7,
    TF_SIZE = 1 << TF_LOG2,
    TF_LAYERS = 12, /* of a texel at most */
    TF_LIGHTS = 2,
};

#define TF_VOXEL_M 0.25

/* A texel's layers. */
struct tf_texel {
    uint32_t count;
    struct umb__transmittance_drop steps[TF_LAYERS];
    long double left[TF_LAYERS]; /* behind each step, unrounded */
};

struct tf_asset {
    uint32_t levels[TF_LIGHTS]; /* of the maps; 0: none */
    struct tf_texel *texels[TF_LIGHTS];
    struct bytes file;
    struct umb_asset *asset;
};

static inline void tf_sha256(void *user, const void *const *parts, const size_t *sizes,
                             size_t count, uint8_t out[UMB_ID_BYTES])
{
    (void)user;
    EVP_MD_CTX *context = EVP_MD_CTX_new();
    assert_int_equal(EVP_DigestInit_ex(context, EVP_sha256(), NULL), 1);
    for (size_t i = 0; i < count; i++) {
        assert_int_equal(EVP_DigestUpdate(context, parts[i], sizes[i]), 1);
    }
    assert_int_equal(EVP_DigestFinal_ex(context, out, NULL), 1);
    EVP_MD_CTX_free(context);
}

/* The real one: the oracle proves ids. */
static const struct umb_sha256 tf_digest = {.digest = tf_sha256};

/* Random layers; a third of the texels has none, and so has the corner x + y < 40. */
static inline void tf_fill(struct tf_texel *texel, uint32_t x, uint32_t y, uint64_t *seed)
{
    long double left = 1.0L;
    uint32_t before = UMB__TRANSMITTANCE_ONE;
    memset(texel, 0, sizeof *texel);
    if (x + y < 40 || next_random(seed) % 3 == 0) {
        return;
    }
    for (uint32_t z = (uint32_t)(next_random(seed) % 40); z < TF_SIZE;
         z += 1 + (uint32_t)(next_random(seed) % 30)) {
        const uint64_t kind = next_random(seed) % 9; /* many alike, as of panes of glass */
        left *= kind == 0 ? 0.0L : kind < 4 ? 0.5L : (long double)random_unit(seed);
        const uint32_t units = (uint32_t)floorl(left * (long double)UMB__TRANSMITTANCE_ONE + 0.5L);
        if (units == before || texel->count == TF_LAYERS) {
            return;
        }
        texel->steps[texel->count] = (struct umb__transmittance_drop){z, before - units};
        texel->left[texel->count++] = left;
        before = units;
        if (units == 0) {
            return;
        }
    }
}

/* The entry of all maps. */
static inline void tf_write(const struct tf_asset *f, struct umb__transmittance_bytes *bytes)
{
    const uint8_t levels[TF_LIGHTS] = {(uint8_t)f->levels[0], (uint8_t)f->levels[1]};
    memset(bytes, 0, sizeof *bytes);
    assert_int_equal(umb__transmittance_append(bytes, levels, sizeof levels, SIZE_MAX, NULL),
                     UMB_OK);
    for (uint32_t i = 0; i < TF_LIGHTS; i++) {
        const uint32_t side = f->levels[i] > 0 ? 1U << f->levels[i] : 0;
        for (uint32_t square = 0; square < side / 64 * (side / 64); square++) {
            static struct umb__transmittance_list lists[64 * 64];
            const uint32_t x0 = square % (side / 64) * 64, y0 = square / (side / 64) * 64;
            for (uint32_t k = 0; k < 64 * 64; k++) {
                const struct tf_texel *texel =
                    &f->texels[i][(size_t)(y0 + k / 64) * side + x0 + k % 64];
                lists[k] = (struct umb__transmittance_list){texel->steps, texel->count};
            }
            assert_int_equal(umb__transmittance_square(bytes, lists, SIZE_MAX, NULL), UMB_OK);
        }
    }
}

static inline void tf_open(struct tf_asset *f, uint32_t level0, uint32_t level1)
{
    const struct voxels voxels = {fixture_hills, NULL, TF_LOG2, TF_LIGHTS};
    struct umb__octree octree;
    struct umb__content content;
    struct umb__transmittance_bytes bytes;
    struct umb_error error = {0};
    uint8_t id[UMB_ID_BYTES];
    uint64_t seed = round_seed(20260101);
    memset(f, 0, sizeof *f);
    f->levels[0] = level0;
    f->levels[1] = level1;
    for (uint32_t i = 0; i < TF_LIGHTS; i++) {
        const uint32_t side = f->levels[i] > 0 ? 1U << f->levels[i] : 0;
        f->texels[i] = calloc((size_t)side * side + 1, sizeof *f->texels[i]);
        for (uint32_t k = 0; k < side * side; k++) {
            tf_fill(&f->texels[i][k], k % side, k / side, &seed);
        }
    }
    tf_write(f, &bytes);
    make_octree(&voxels, &octree);
    make_content(&voxels, TF_VOXEL_M, fixture_origin, &content);
    content.transmittance = bytes.data;
    content.transmittance_bytes = bytes.count;
    struct umb_sink sink = bytes_sink(&f->file);
    if (umb__pack_write(&content, &octree, &tf_digest, &sink, id, &error) != UMB_OK ||
        umb_asset_open_bytes(f->file.data, f->file.size, NULL, &f->asset, &error) != UMB_OK) {
        fail_msg("%s", error.message);
    }
    umb__octree_finish(&octree);
    umb__transmittance_bytes_finish(&bytes);
}

static inline void tf_close(struct tf_asset *f)
{
    umb_asset_close(f->asset);
    bytes_finish(&f->file);
    free(f->texels[0]);
    free(f->texels[1]);
}

/* Returns the model's light of a texel at voxel z, in units of 2^-21. Out: exact: the same
 * unrounded, 0..1. */
static inline uint32_t tf_left(const struct tf_asset *f, uint32_t light, uint32_t x, uint32_t y,
                               uint32_t z, long double *exact)
{
    uint32_t left = UMB__TRANSMITTANCE_ONE;
    const struct tf_texel *texel = &f->texels[light][((size_t)y << f->levels[light]) + x];
    *exact = 1.0L;
    for (uint32_t i = 0; i < texel->count && texel->steps[i].z <= z; i++) {
        left -= texel->steps[i].drop;
        *exact = texel->left[i];
    }
    return left;
}

#endif

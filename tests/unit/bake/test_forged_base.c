/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Forged bases: a few bytes are changed anywhere in the file, and its checksum is made right. A
 * bake upon it either fails with an error, or writes pages that hold its octree. It neither reads
 * outside nor runs without bound. Many more: UMBRAGE_CASES.
 */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#define PLANTED_LOG2      10 /* an octree of many pages */
#define PLANTED_TILE_LOG2 8

#include "format/layout.h"
#include "make_asset.h"
#include "planted_scene.h"

/* The bytes of a base. */
struct content {
    uint8_t name[UMB_ID_BYTES];
    uint8_t *bytes;
    size_t size, image, kept_at;
};

/* Bakes the scene before the edit and returns its base. */
static struct content make_base(struct planted *p)
{
    struct planted_bake bake;
    struct content content;
    planted_bake(p, &p->before, &bake);
    bake.keeps = 1;
    assert_int_equal(planted_publish(p, &p->before, &bake), UMB_OK);
    assert_int_equal(umbb_proofs_keep(&bake.proofs, &bake.error), UMB_OK);
    planted_bake_finish(&bake);
    planted_bake(p, &p->before, &bake);
    assert_true(bake.base.is_loaded);
    memcpy(content.name, bake.base.name, sizeof content.name);
    content.size = bake.base.size;
    content.image = bake.base.image;
    content.kept_at = bake.base.kept_at;
    content.bytes = malloc(content.size);
    assert_non_null(content.bytes);
    memcpy(content.bytes, bake.base.bytes, content.size);
    planted_bake_finish(&bake);
    return content;
}

/* Writes a base with these bytes; the cache makes its checksum. */
static void write_base(const struct planted *p, const struct content *content, const uint8_t *bytes,
                       size_t size)
{
    struct umbb_tile_cache cache;
    struct umb_error error;
    assert_int_equal(umbb_tile_cache_open(&cache, p->cache, UINT64_MAX, &error), UMB_OK);
    assert_int_equal(umbb_tile_cache_write(&cache, content->name, bytes, size, &error), UMB_OK);
    umbb_tile_cache_close(&cache);
}

/* Bakes the edit upon the base of the cache. In: found: counts ends. */
static void bake_upon(struct planted *p, int found[3])
{
    struct planted_bake bake;
    planted_bake(p, &p->after, &bake);
    const int used = bake.base.is_loaded;
    const enum umb_status status = planted_publish(p, &p->after, &bake);
    if (status == UMB_OK) { /* the pages of the file are those of the octree */
        found[used]++;
    } else {
        assert_true(status == UMB_E_INTERNAL || status == UMB_E_CORRUPT ||
                    status == UMB_E_TOO_LARGE || status == UMB_E_LIMIT);
        assert_true(used);
        found[2]++;
    }
    umbb_proofs_refuse(&bake.proofs);
    planted_bake_finish(&bake);
}

/* Changes some bytes, mostly small numbers in the part that is drawn. */
static void forge(const struct content *content, uint8_t *bytes, uint64_t *seed)
{
    const size_t begins[3] = {0, content->image, content->kept_at};
    const size_t ends[3] = {content->image, content->kept_at, content->size};
    const size_t part = (size_t)(next_random(seed) % 3);
    const int changes = 1 + (int)(next_random(seed) % 4);
    for (int i = 0; i < changes; i++) {
        const size_t span = next_random(seed) % 4 == 0 ? 256 : ends[part] - begins[part];
        const size_t at = begins[part] + (size_t)(next_random(seed) % span);
        if (at < content->size) {
            const uint64_t draw = next_random(seed);
            bytes[at] = draw % 3 == 0   ? (uint8_t)(draw >> 8)
                        : draw % 3 == 1 ? (uint8_t)(bytes[at] ^ 1U << (draw >> 8) % 8)
                                        : 0;
        }
    }
}

static void a_forged_base_ends_in_an_error_or_in_true_pages(void **state)
{
    struct planted p;
    uint64_t seed = 29;
    int found[3] = {0, 0, 0};
    (void)state;
    planted_init(&p, 0);
    p.with_base = 1;
    const struct content content = make_base(&p);
    uint8_t *bytes = malloc(content.size);
    assert_non_null(bytes);
    const int cases = case_count(100);
    for (int i = 0; i < cases; i++) {
        const size_t size =
            i % 16 == 15 ? (size_t)(next_random(&seed) % content.size) : content.size;
        memcpy(bytes, content.bytes, content.size);
        forge(&content, bytes, &seed);
        write_base(&p, &content, bytes, size);
        bake_upon(&p, found);
    }
    print_message("not used %d, true %d, refused %d\n", found[0], found[1], found[2]);
    assert_true(found[0] > 0 && found[1] > 0 && found[2] > 0);
    free(bytes);
    free(content.bytes);
    planted_finish(&p);
}

/* Makes all sums, parts or pages of the file wrong at once. In: kind: which. */
static void falsify(const struct content *content, uint8_t *bytes, int kind)
{
    uint8_t *at = bytes + content->kept_at + 4;
    uint32_t counts[UMB_LEVEL_MAX + 1] = {0};
    for (uint32_t l = UMB_LEVEL_BRICK + 1; l <= UMB_LEVEL_MAX; l++, at += 4) {
        counts[l] = umb__load32(at);
    }
    for (uint32_t l = UMB_LEVEL_BRICK + 1; l <= UMB_LEVEL_MAX; l++) {
        const size_t count = counts[l];
        if (kind == 0) {
            memset(at, 0, 4 * count); /* all pieces are empty */
        }
        at += 4 * count;
        if (l >= UMB__CUT_LOWEST) {
            if (kind == 1) {
                memset(at, 0, 4 * count); /* no node is cut */
            } else if (kind == 2) {
                memset(at, 0xff, 4 * count); /* each child is in page 15 */
            }
            at += 8 * count;
        }
    }
    if (kind == 3) { /* the hash of every page */
        const uint32_t pages = umb__load32(at);
        for (uint32_t i = 0; i < pages; i++) {
            at[8 + i * (16 + (size_t)UMB__PAGE_ENTRY) + 16 + UMB__PAGE_HASH] ^= 1;
        }
    }
}

static void false_cuts_and_hashes_are_found(void **state)
{
    /* Pages of a small octree without cuts are larger, but hold it. */
    static const enum umb_status wanted[4] = {UMB_OK, UMB_OK, UMB_E_CORRUPT, UMB_E_INTERNAL};
    struct planted p;
    (void)state;
    planted_init(&p, 0);
    p.with_base = 1;
    const struct content content = make_base(&p);
    uint8_t *bytes = malloc(content.size);
    assert_non_null(bytes);
    for (int kind = 0; kind < 4; kind++) {
        struct planted_bake bake;
        memcpy(bytes, content.bytes, content.size);
        falsify(&content, bytes, kind);
        write_base(&p, &content, bytes, content.size);
        planted_bake(&p, &p.after, &bake);
        assert_true(bake.base.is_loaded);
        const enum umb_status status = planted_publish(&p, &p.after, &bake);
        assert_int_equal(status, wanted[kind]);
        planted_bake_finish(&bake);
    }
    free(bytes);
    free(content.bytes);
    planted_finish(&p);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_forged_base_ends_in_an_error_or_in_true_pages),
        cmocka_unit_test(false_cuts_and_hashes_are_found),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

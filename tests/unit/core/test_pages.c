/* SPDX-License-Identifier: Apache-2.0 */
/* Pages written by hand from docs/reference/umb-format.md, pages that must be refused, and the
 * encodings of numbers and lists. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <stdlib.h>
#include <string.h>

#include "format/layout.h"
#include "format/page.h"

enum {
    N = 2, /* state: mixed, by reference */
    X = 3, /* state: mixed, the next node */
};

/* Bits of a mask: states of children 0 to 3; the others are shadowed. */
#define MASK(a, b, c, d) (uint8_t)((a) | (b) << 2 | (c) << 4 | (d) << 6), 0

/*
 * Levels 5 to 3: a node of level 5, two of level 4, two bricks.
 *
 *   level 5: next (0), other 1, lit, next (1)
 *   level 4: node 0: next (0), by reference 0; node 1: other 0, next (1)
 */
static const uint8_t whole[] = {
    3,
    5,
    3,
    1,
    2,
    2, /* encoding, levels, counts */
    2,
    0x87,
    2,
    0,
    9,
    3, /* others: link 263, 9; link 263, 13 */
    MASK(X, N, 1, X),
    3, /* references: other 1 is 2 + 1 */
    1,
    5,
    0x80,
    1, /* other: link 5, 128 */
    MASK(X, N, 0, 0),
    MASK(N, X, 0, 0),
    0,
    2, /* references: 0; other 0 is 2 + 0 */
    3,
    0x01,
    0x81,
    0x80, /* leaves: which rows differ */
    0x0f,
    0x40,
    0xf0,
    0x41, /* 0f, 40..f0, 41..f0 */
    0x01,
    0x11,
    2,
    0,
    1, /* runs; leaf numbers: 2; 0, then 1 from z = 4 */
};

static enum umb_status parse(const uint8_t *bytes, size_t size, struct umb__page *page,
                             struct umb_error *error)
{
    uint8_t *exact = malloc(size > 0 ? size : 1); /* ASan sees the first byte too many */
    assert_non_null(exact);
    memcpy(exact, bytes, size);
    const enum umb_status status = umb__page_parse(exact, size, page, error);
    free(exact);
    return status;
}

static void a_page_reads_as_the_format_says(void **state)
{
    (void)state;
    struct umb__page page;
    uint8_t links[264] = {8, 3}; /* pages 4, 3, 4, 5 ... 265 */
    assert_int_equal(umb__page_parse(whole, sizeof whole, &page, NULL), UMB_OK);
    assert_int_equal(page.link_count, sizeof links);
    assert_int_equal(umb__page_set_links(&page, links, sizeof links, NULL), UMB_OK);
    assert_int_equal(page.node_count[5], 1);
    assert_int_equal(page.node_count[4], 2);
    assert_int_equal(page.node_count[3], 2);
    assert_int_equal(page.child_count[5], 3);
    assert_int_equal(page.child_count[4], 4);
    struct umb__page_others others = umb__page_others(&page, 5);
    struct umb__node_place place = umb__page_others_next(&others);
    assert_int_equal(place.page, 265);
    assert_int_equal(place.position, 9);
    place = umb__page_others_next(&others);
    assert_int_equal(place.page, 265);
    assert_int_equal(place.position, 13);
    others = umb__page_others(&page, 4);
    place = umb__page_others_next(&others);
    assert_int_equal(place.page, 7);
    assert_int_equal(place.position, 128);

    uint16_t mask;
    uint32_t children[8];
    struct umb__page_nodes nodes = umb__page_nodes(&page, 5);
    assert_int_equal(umb__page_nodes_next(&nodes, &mask, children), 3);
    assert_int_equal(mask, 2 | 2 << 2 | 1 << 4 | 2 << 6);
    assert_int_equal(children[0], 0);
    assert_int_equal(children[1], 3);
    assert_int_equal(children[2], 1);
    nodes = umb__page_nodes(&page, 4);
    assert_int_equal(umb__page_nodes_next(&nodes, &mask, children), 2);
    assert_int_equal(children[0], 0);
    assert_int_equal(children[1], 0);
    assert_int_equal(umb__page_nodes_next(&nodes, &mask, children), 2);
    assert_int_equal(children[0], 2);
    assert_int_equal(children[1], 1);

    uint64_t leaves[3], slices[8];
    umb__page_leaves(&page, leaves);
    assert_true(leaves[0] == 0x0f);
    assert_true(leaves[1] == 0x40000000000000f0);
    assert_true(leaves[2] == 0x41000000000000f0);
    struct umb__page_bricks bricks = umb__page_bricks(&page, leaves);
    umb__page_bricks_next(&bricks, slices);
    assert_true(slices[0] == leaves[2] && slices[7] == leaves[2]);
    umb__page_bricks_next(&bricks, slices);
    assert_true(slices[0] == leaves[0] && slices[3] == leaves[0]);
    assert_true(slices[4] == leaves[1] && slices[7] == leaves[1]);
}

static void a_reference_moves_the_next_node_behind_itself(void **state)
{
    (void)state;
    /* Level 5 over four nodes of level 4, none of which has children: 2 by reference, the next, 0
     * by reference, and the next would be 4. */
    uint8_t bytes[] = {3, 5, 4, 1, 4, 0, MASK(N, X, N, 0), 2, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0};
    struct umb__page page;
    assert_int_equal(umb__page_parse(bytes, sizeof bytes, &page, NULL), UMB_OK);
    struct umb__page_nodes nodes = umb__page_nodes(&page, 5);
    uint16_t mask;
    uint32_t children[8];
    assert_int_equal(umb__page_nodes_next(&nodes, &mask, children), 3);
    assert_int_equal(children[0], 2);
    assert_int_equal(children[1], 3);
    assert_int_equal(children[2], 0);
    const uint8_t beyond[] = {MASK(N, X, N, X)};
    memcpy(bytes + 6, beyond, sizeof beyond);
    struct umb_error error;
    assert_int_equal(parse(bytes, sizeof bytes, &page, &error), UMB_E_CORRUPT);
    assert_non_null(strstr(error.message, "more next nodes than there are"));
}

static void every_cut_of_a_page_and_every_byte_behind_it_is_refused(void **state)
{
    (void)state;
    uint8_t more[sizeof whole + 1] = {0};
    struct umb__page page;
    for (size_t size = 0; size < sizeof whole; size++) {
        assert_int_equal(parse(whole, size, &page, NULL), UMB_E_CORRUPT);
    }
    memcpy(more, whole, sizeof whole);
    assert_int_equal(parse(more, sizeof more, &page, NULL), UMB_E_CORRUPT);
}

static void expect(size_t at, uint8_t value, enum umb_status wanted, const char *words)
{
    uint8_t bytes[sizeof whole];
    struct umb__page page;
    struct umb_error error = {0};
    memcpy(bytes, whole, sizeof whole);
    bytes[at] = value;
    const enum umb_status status = parse(bytes, sizeof bytes, &page, &error);
    if (status != wanted || strstr(error.message, words) == NULL) {
        fail_msg("byte %zu is %u: %s: %s, wanted '%s'", at, value, umb_status_name(status),
                 error.message, words);
    }
}

static void what_a_page_must_not_say_is_refused_by_name(void **state)
{
    (void)state;
    expect(0, 1, UMB_E_VERSION,
           "encoding 1, this reader knows 3; made by an earlier version: bake the scene again");
    expect(0, 4, UMB_E_VERSION, "encoding 4, this reader knows 3; made by a later version");
    expect(1, 21, UMB_E_CORRUPT, "levels out of range");
    expect(1, 2, UMB_E_CORRUPT, "levels out of range");
    expect(2, 2, UMB_E_CORRUPT, "levels out of range");
    expect(6, 0x7f, UMB_E_CORRUPT, "not a number or out of range");
    expect(8, 0, UMB_E_CORRUPT, "not a number or out of range"); /* 7, in two bytes */
    expect(14, 4, UMB_E_CORRUPT, "a reference is out of range");
    expect(24, 3, UMB_E_CORRUPT, "a reference is out of range");
    expect(12, X | X << 2 | X << 4, UMB_E_CORRUPT, "more next nodes than there are");
    expect(33, 0, UMB_E_CORRUPT, "first slice does not start a run");
    expect(35, 3, UMB_E_CORRUPT, "a leaf number is out of range");
    expect(25, 0x7f, UMB_E_CORRUPT, "leaves are cut");
}

/* Two others whose links are too many, or whose positions in one page add up to 2^32. */
static void places_out_of_range_are_refused(void **state)
{
    (void)state;
    static const uint8_t links[] = {3, 4, 4, 1, 2, 0xfe, 0xff, 3, 1, 0, 0, MASK(N, N, 0, 0), 0, 1};
    static const uint8_t positions[] = {
        3, 4, 4, 1, 2, 7, 0, 0xff, 0xff, 0xff, 0xff, 15, 0, MASK(N, N, 0, 0), 0, 1};
    static const uint8_t long_number[] = {3, 4, 4, 0xff, 0xff, 0xff, 0xff, 0x1f};
    struct umb__page page;
    struct umb_error error;
    assert_int_equal(parse(links, sizeof links, &page, &error), UMB_E_CORRUPT);
    assert_non_null(strstr(error.message, "a link is not a number or out of range"));
    assert_int_equal(parse(positions, sizeof positions, &page, &error), UMB_E_CORRUPT);
    assert_non_null(strstr(error.message, "a position is not a number or out of range"));
    assert_int_equal(parse(long_number, sizeof long_number, &page, &error), UMB_E_CORRUPT);
    assert_non_null(strstr(error.message, "counts are cut"));
}

static void expect_links(const uint8_t *links, size_t size, const char *words)
{
    struct umb__page page;
    struct umb_error error = {0};
    assert_int_equal(umb__page_parse(whole, sizeof whole, &page, NULL), UMB_OK);
    assert_int_equal(umb__page_set_links(&page, links, size, &error), UMB_E_CORRUPT);
    assert_non_null(strstr(error.message, words));
}

static void links_are_as_many_as_the_page_uses_and_lead_to_pages(void **state)
{
    (void)state;
    uint8_t links[270] = {0};
    expect_links(links, 263, "263 links, its nodes use 264");
    expect_links(links, 265, "265 links, its nodes use 264");
    links[0] = 1; /* page -1 */
    expect_links(links, 264, "leads to no page");
    const uint8_t far[] = {0xfe, 0xff, 0xff, 0xff, 15, 0}; /* page 2^31 - 1, then 2^31 */
    memcpy(links, far, sizeof far);
    expect_links(links, 268, "leads to no page");
    links[263] = 0x80; /* cut */
    memset(links, 0, 263);
    expect_links(links, 264, "a link is not a number");
}

static void lists_of_any_limit_give_back_their_numbers(void **state)
{
    (void)state;
    static const uint64_t limits[] = {0,    1,     256,     257,         512,        513,
                                      4096, 65537, 1 << 24, 0x100000000, 0x1ffffffff};
    static const unsigned high[] = {0, 0, 0, 1, 1, 2, 4, 9, 16, 24, 25};
    uint64_t random = 1;
    for (size_t i = 0; i < sizeof limits / sizeof limits[0]; i++) {
        assert_int_equal(umb__list_high_bits(limits[i]), high[i]);
        for (size_t count = 0; count < 40; count++) {
            uint32_t numbers[40] = {0};
            uint8_t bytes[40 * 5];
            for (size_t k = 0; k < count && limits[i] > 0; k++) {
                random = random * 6364136223846793005U + 1442695040888963407U;
                numbers[k] = (uint32_t)(k == 0 ? limits[i] - 1 : (random >> 20) % limits[i]);
            }
            const uint8_t *end = umb__put_list(bytes, numbers, count, high[i]);
            assert_int_equal(end - bytes, umb__list_bytes(count, high[i]));
            const struct umb__number_list list = {bytes, count, high[i]};
            struct umb__list_reader reader = umb__list_read(&list);
            for (size_t k = 0; k < count; k++) {
                assert_int_equal(umb__list_next(&reader), numbers[k]);
            }
            assert_true(reader.pending == 0 && (count == 0 || high[i] == 0 || reader.high == end));
        }
    }
}

static void bits_that_a_list_leaves_are_zero(void **state)
{
    (void)state;
    /* A node of level 4 with one child, the last of 257 others: 9 bits, 7 are left. */
    uint8_t bytes[600] = {3, 4, 4, 1, 0x81, 2};
    memset(bytes + 6, 1, 514);
    const uint8_t rest[] = {MASK(N, 0, 0, 0), 0, 1};
    memcpy(bytes + 520, rest, sizeof rest);
    struct umb__page page;
    struct umb_error error;
    assert_int_equal(parse(bytes, 524, &page, NULL), UMB_OK);
    bytes[523] = 3;
    assert_int_equal(parse(bytes, 524, &page, &error), UMB_E_CORRUPT);
    assert_non_null(strstr(error.message, "references end in no zeros"));
}

static void numbers_are_as_short_as_can_be(void **state)
{
    (void)state;
    static const uint32_t values[] = {0,     1,          127,        128,       16383,
                                      16384, 0x0fffffff, 0x10000000, UINT32_MAX};
    static const uint8_t lengths[] = {1, 1, 1, 2, 2, 3, 4, 5, 5};
    for (size_t i = 0; i < sizeof values / sizeof values[0]; i++) {
        uint8_t bytes[UMB__NUMBER_BYTES_MAX + 1];
        const uint8_t *end = umb__put_number(bytes, values[i]), *at = bytes;
        uint32_t value = 0;
        assert_int_equal(end - bytes, lengths[i]);
        assert_true(umb__take_number(&at, end, &value) && value == values[i] && at == end);
        at = bytes;
        assert_true(umb__next_number(&at) == values[i] && at == end);
        at = bytes;
        assert_false(umb__take_number(&at, end - 1, &value));
        bytes[lengths[i] - 1] |= 0x80; /* the same, one byte longer */
        bytes[lengths[i]] = 0;
        at = bytes;
        assert_false(umb__take_number(&at, bytes + lengths[i] + 1, &value));
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_page_reads_as_the_format_says),
        cmocka_unit_test(a_reference_moves_the_next_node_behind_itself),
        cmocka_unit_test(every_cut_of_a_page_and_every_byte_behind_it_is_refused),
        cmocka_unit_test(what_a_page_must_not_say_is_refused_by_name),
        cmocka_unit_test(places_out_of_range_are_refused),
        cmocka_unit_test(links_are_as_many_as_the_page_uses_and_lead_to_pages),
        cmocka_unit_test(lists_of_any_limit_give_back_their_numbers),
        cmocka_unit_test(bits_that_a_list_leaves_are_zero),
        cmocka_unit_test(numbers_are_as_short_as_can_be),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

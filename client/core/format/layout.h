/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_FORMAT_LAYOUT_H
#define UMBRAGE_CORE_FORMAT_LAYOUT_H
/*
 * Offsets and numbers of the file formats; docs/reference/umb-format.md is the normative text.
 *
 * Both files begin with a head, contiguous and checked by one XXH3-64. In a packed file every
 * UMB__BLOCK_PAGES pages have a block: their entries, then their links. The head has a table of
 * these blocks. The first block follows the head, the others follow the first block's pages.
 */
#include <stdint.h>

#define UMB__MAGIC_PACKED    "\x89UMB\r\n\x1a\n"
#define UMB__MAGIC_MAPPED    "\x89UMM\r\n\x1a\n"
#define UMB__MAGIC_PARTIAL   "\x89UMP\r\n\x1a\n"
#define UMB__VERSION_PACKED  3U /* Major version; pages of 2 named other pages by number */
#define UMB__VERSION_MAPPED  3U /* Major version; 1 had nodes without gaps, 2 had no columns */
#define UMB__VERSION_MINOR   0U
#define UMB__VERSION_PARTIAL 3U

/* Head: magic at 0, then these fields, then canonical block, directory and info without gaps. */
enum {
    UMB__HEAD_VERSION = 8,           /* u16, major version */
    UMB__HEAD_MINOR = 10,            /* u16 */
    UMB__HEAD_FLAGS = 12,            /* u32, 0 */
    UMB__HEAD_FILE_LENGTH = 16,      /* u64 */
    UMB__HEAD_LENGTH = 24,           /* u64, from the magic to the end of the info */
    UMB__HEAD_CANONICAL_LENGTH = 32, /* u64 */
    UMB__HEAD_DIRECTORY_COUNT = 40,  /* u32, blocks of a packed file, sections of a mapped one */
    UMB__HEAD_INFO_LENGTH = 44,      /* u32 */
    UMB__HEAD_ID = 48,               /* SHA-256 of the canonical block and the block hashes */
    UMB__HEAD_PAGES = 80,            /* u32, pages of a packed file, else 0 */
    UMB__HEAD_FIRST_BLOCK = 84,      /* u32, length of the first block of a packed file, or 0 */
    UMB__HEAD_BLOCKS = 88,           /* u64, offset of the second block, or 0; others follow it */
    UMB__HEAD_ZERO = 96,             /* 24 bytes */
    UMB__HEAD_CHECK = 120,           /* u64, XXH3-64 of head bytes [0,120) and [128, head length) */
    UMB__HEAD_SIZE = 128,
};

/* Directory entry of a packed file: one block of page entries and links. */
enum {
    UMB__BLOCK_CHECK = 0, /* u64, XXH3-64 of the block's bytes */
    UMB__BLOCK_END = 8,   /* u64, bytes of the blocks up to and including this one */
    UMB__BLOCK_HASH = 16, /* SHA-256 of the SHA-256s of its pages, then its links */
    UMB__BLOCK_ENTRY = 48,
    UMB__BLOCK_PAGES = 32, /* Pages of a block; the last block may have fewer */
};

/* Page entry in a block. */
enum {
    UMB__PAGE_OFFSET = 0,        /* u64, offset of the page in the file */
    UMB__PAGE_STORED_LENGTH = 8, /* u32, length of the zstd frame */
    UMB__PAGE_RAW_LENGTH = 12,   /* u32, length uncompressed */
    UMB__PAGE_CHECK = 16,        /* u64, XXH3-64 of the stored bytes */
    UMB__PAGE_LEVEL_HIGH = 24,   /* u8 */
    UMB__PAGE_LEVEL_LOW = 25,    /* u8 */
    UMB__PAGE_LINKS = 26,        /* u16, length of the page's links in the block */
    UMB__PAGE_RECORDS = 28,      /* u32, nodes and bricks in the page */
    UMB__PAGE_HASH = 32,         /* SHA-256 of the raw bytes */
    UMB__PAGE_ENTRY = 64,
};

/* Directory entry of a mapped file: one section. */
enum {
    UMB__SECTION_TAG = 0,    /* u32 */
    UMB__SECTION_ZERO = 4,   /* u32 */
    UMB__SECTION_OFFSET = 8, /* u64, offset in the file, a multiple of 4096 */
    UMB__SECTION_LENGTH = 16,
    UMB__SECTION_CHECK = 24, /* u64, XXH3-64 of the section's bytes */
    UMB__SECTION_ENTRY = 32,
};

#define UMB__TAG(a, b, c, d)                                                                       \
    ((uint32_t)(a) | ((uint32_t)(b) << 8) | ((uint32_t)(c) << 16) | ((uint32_t)(d) << 24))

/* Canonical block entries: u32 tag, u32 flags (bit 0: must be understood), u64 length, bytes,
 * zero padding to 8. */
#define UMB__TAG_SCENE          UMB__TAG('S', 'C', 'E', 'N')
#define UMB__TAG_LIGHTS         UMB__TAG('L', 'G', 'H', 'T')
#define UMB__TAG_FRUSTA         UMB__TAG('F', 'R', 'U', 'S')
#define UMB__TAG_COUNTS         UMB__TAG('C', 'N', 'T', 'S')
#define UMB__TAG_PLAN           UMB__TAG('P', 'L', 'A', 'N')
#define UMB__TAG_SETTINGS       UMB__TAG('B', 'A', 'K', 'E')
#define UMB__TAG_ROOTS          UMB__TAG('R', 'O', 'O', 'T')
#define UMB__TAG_OCCLUDER_DEPTH UMB__TAG('F', 'R', 'N', 'T')
#define UMB__TAG_CURVE          UMB__TAG('C', 'U', 'R', 'V') /* Only if a curve was measured */
#define UMB__TAG_TRANSMITTANCE  UMB__TAG('T', 'R', 'N', 'S') /* Only with translucent casters */
#define UMB__TAG_RECEIVER_MASK  UMB__TAG('N', 'E', 'A', 'R') /* Only under the static rule */
#define UMB__TAG_SIDES          UMB__TAG('S', 'I', 'D', 'E') /* Only with a rectangle */

/* Sections of a mapped file. */
#define UMB__TAG_TOPS    UMB__TAG('T', 'O', 'P', 'S') /* One struct umb__top (view.h) a frustum */
#define UMB__TAG_LEVELS  UMB__TAG('L', 'V', 'L', 'S') /* First word of each wide level, u64 */
#define UMB__TAG_GRID    UMB__TAG('G', 'R', 'I', 'D')
#define UMB__TAG_NODES   UMB__TAG('N', 'O', 'D', 'E')
#define UMB__TAG_BRICKS  UMB__TAG('B', 'R', 'I', 'K')
#define UMB__TAG_COLUMNS UMB__TAG('C', 'O', 'L', 'S')
#define UMB__TAG_PIECES  UMB__TAG('P', 'I', 'E', 'C')

#define UMB__ENTRY_HEAD   16U
#define UMB__SCENE_SIZE   104U
#define UMB__LIGHT_SIZE   136U
#define UMB__SIDE_SIZE    24U /* One vector a light */
#define UMB__FRUSTUM_SIZE 144U
#define UMB__COUNTS_SIZE  152U /* Counts of levels 3..20, then bytes_2014 */
#define UMB__ROOT_SIZE    16U
#define UMB__CURVE_SIZE   40U
/* Limit of a window's nodes and of its cache lines: more than a window of 17 texels can touch */
#define UMB__CURVE_READS_MAX 1024U
#define UMB__TOP_SIZE        32U
#define UMB__MUST_UNDERSTAND 1U

#define UMB__PAGE_ENCODING                                                                         \
    3U                              /* Encoding 2 named other pages by number, 1 also wrote every
                                         reference */
#define UMB__PAGE_LINKS_MAX  65535U /* Links of a page, each of at least a byte */
#define UMB__BLOCK_BYTES_MAX (UMB__BLOCK_PAGES * (UMB__PAGE_ENTRY + 65535U))
#define UMB__PAGE_RAW_MAX    (1U << 20) /* Bytes of the longest page, uncompressed */
/* Most estimated bytes of a page: few, since a thin client needs only some nodes of each page
 * (docs/results/paging.md has the effects of other sizes). Pages are larger in octrees that share
 * many nodes: if copies take more than COPIES_MAX times the bytes of the nodes. */
#define UMB__PAGE_BYTES        7168U
#define UMB__PAGE_BYTES_SHARED 98304U
#define UMB__PAGE_COPIES_MAX   2.0
#define UMB__CANONICAL_MAX     (64U << 20)
#define UMB__INFO_MAX          (1U << 20)
#define UMB__TEXT_MAX          (4U << 20) /* Bytes of the plan, and of the settings */
#define UMB__SECTION_ALIGN     4096U
#define UMB__GRID_LOG2_MAX     7U

/* Wide levels of the mapped layout: 5, 7, ... 19. */
#define UMB__WIDE_FIRST 5U
#define UMB__WIDE_COUNT 8U

#endif

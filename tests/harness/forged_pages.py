# SPDX-License-Identifier: Apache-2.0
"""
A packed asset with a false page and right XXH3s, as a hostile server makes it:

    lie = forged_pages.forge(whole, 3)   # page 3 has a cube lit that is shadowed, or the other way round

The id and all SHA-256s are those of the true asset: only the page's SHA-256 detects the forgery.
"""
import ctypes
import hashlib
import struct

PAGE_ENTRY, BLOCK_PAGES, BLOCK_ENTRY, HEAD = 64, 32, 48, 128

xxhash, zstd = ctypes.CDLL("libxxhash.so.0"), ctypes.CDLL("libzstd.so.1")
xxhash.XXH3_64bits.restype = ctypes.c_uint64
xxhash.XXH3_64bits.argtypes = [ctypes.c_char_p, ctypes.c_size_t]
for name in ("ZSTD_decompress", "ZSTD_compress"):
    getattr(zstd, name).restype = ctypes.c_size_t


def check(data):
    return xxhash.XXH3_64bits(bytes(data), len(data))


def expand(stored, size):
    room = ctypes.create_string_buffer(size)
    got = zstd.ZSTD_decompress(room, ctypes.c_size_t(size), bytes(stored), ctypes.c_size_t(len(stored)))
    assert got == size, got
    return bytearray(room.raw)


def compress(raw):
    room = ctypes.create_string_buffer(2 * len(raw) + 1000)
    size = zstd.ZSTD_compress(room, ctypes.c_size_t(len(room)), bytes(raw), ctypes.c_size_t(len(raw)), 3)
    return room.raw[:size]


class Reader:
    """The numbers of a page, seven bits a byte."""

    def __init__(self, raw, at):
        self.raw, self.at = raw, at

    def number(self):
        value = shift = 0
        while True:
            byte = self.raw[self.at]
            self.at += 1
            value |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                return value


def turn_child(raw):
    """Turns lit and shadowed around for a uniform child of a node of the page's highest level."""
    high, low = raw[1], raw[2]
    assert high > 3, "a page of bricks"
    reader = Reader(raw, 3)
    nodes = [reader.number() for _ in range(high - low + 1)][0]
    for _ in range(2 * reader.number()):
        reader.number()
    for i in range(8 * nodes):
        at = reader.at + 2 * (i // 8)
        mask = struct.unpack_from("<H", raw, at)[0]
        if mask >> 2 * (i % 8) & 3 < 2:
            struct.pack_into("<H", raw, at, mask ^ 1 << 2 * (i % 8))
            return True
    return False


def table_at(data, block):
    """The place of a block's entry in the head."""
    return HEAD + struct.unpack_from("<Q", data, 32)[0] + BLOCK_ENTRY * block


def block_at(data, block):
    """The place and length of a block."""
    head, blocks = struct.unpack_from("<Q", data, 24)[0], struct.unpack_from("<Q", data, 88)[0]
    ends = [struct.unpack_from("<Q", data, table_at(data, b) + 8)[0] for b in range(block + 1)]
    begin = ends[block - 1] if block > 0 else 0
    return (blocks + begin - ends[0] if block > 0 else head), ends[block] - begin


def entry_at(data, page):
    return block_at(data, page // BLOCK_PAGES)[0] + PAGE_ENTRY * (page % BLOCK_PAGES)


def page_count(data):
    return struct.unpack_from("<I", data, 80)[0]


def seal(data):
    """The XXH3 of each block, then the head's."""
    for block in range((page_count(data) + BLOCK_PAGES - 1) // BLOCK_PAGES):
        at, length = block_at(data, block)
        struct.pack_into("<Q", data, table_at(data, block), check(data[at:at + length]))
    head = struct.unpack_from("<Q", data, 24)[0]
    both = struct.pack("<QQ", check(data[:120]), check(data[HEAD:head]))
    struct.pack_into("<Q", data, 120, check(both))


def replace_page(data, page, raw):
    """Puts other bytes in a page's place, with the right lengths and XXH3 of the page, but not its SHA-256."""
    at = entry_at(data, page)
    offset, stored = struct.unpack_from("<QI", data, at)
    lie = compress(raw)
    struct.pack_into("<IIQ", data, at + 8, len(lie), len(raw), check(lie))
    grown = len(lie) - stored
    for later in range(page + 1, page_count(data)):
        then = entry_at(data, later)
        struct.pack_into("<Q", data, then, struct.unpack_from("<Q", data, then)[0] + grown)
    struct.pack_into("<Q", data, 16, len(data) + grown)
    blocks = struct.unpack_from("<Q", data, 88)[0]
    if page < BLOCK_PAGES and blocks > 0:
        struct.pack_into("<Q", data, 88, blocks + grown)
    data[offset:offset + stored] = lie


def raw_page(data, page):
    """A page's bytes, uncompressed."""
    offset, stored, size = struct.unpack_from("<QII", data, entry_at(data, page))
    return expand(data[offset:offset + stored], size)


def forge(whole, page):
    """The file with a lie in `page`, or None if the page has no uniform child to turn."""
    data = bytearray(whole)
    raw = raw_page(data, page)
    if not turn_child(raw):
        return None
    replace_page(data, page, raw)
    seal(data)
    return bytes(data)


def spoil(whole, rng):
    """The file with a page changed at random and every hash right, as an asset of its own: only its content is bad."""
    data = bytearray(whole)
    pages = page_count(data)
    page = rng.randrange(min(pages, 8) if rng.random() < 0.5 else pages)
    raw = raw_page(data, page)
    for _ in range(rng.randrange(1, 5)):
        at = rng.randrange(min(len(raw), 64) if rng.random() < 0.5 else len(raw))
        kind = rng.randrange(4)
        if kind == 0:
            raw[at] ^= 1 << rng.randrange(8)
        elif kind == 1:
            raw[at] = rng.choice((0, 1, 127, 128, 255))
        elif kind == 2:
            raw[at:at] = rng.randbytes(rng.randrange(1, 9))
        else:
            del raw[at:at + rng.randrange(1, 9)]
    replace_page(data, page, raw)
    at = entry_at(data, page) + 32
    data[at:at + 32] = hashlib.sha256(raw).digest()
    hashes = b""
    for block in range((pages + BLOCK_PAGES - 1) // BLOCK_PAGES):
        begin, length = block_at(data, block)
        entries = [entry_at(data, number) for number in range(BLOCK_PAGES * block, min(BLOCK_PAGES * (block + 1), pages))]
        content = b"".join(data[each + 32:each + 64] for each in entries)
        content += b"".join(data[each + 26:each + 28] for each in entries)  # lengths of the links
        content += data[begin + PAGE_ENTRY * len(entries):begin + length]
        at = table_at(data, block) + 16
        data[at:at + 32] = hashlib.sha256(content).digest()
        hashes += data[at:at + 32]
    data[48:80] = hashlib.sha256(data[HEAD:table_at(data, 0)] + hashes).digest()
    seal(data)
    return bytes(data)

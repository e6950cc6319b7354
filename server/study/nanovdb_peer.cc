// SPDX-License-Identifier: Apache-2.0
// A sparse volume as peer; see nanovdb_peer.h.
#include "study/nanovdb_peer.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <vector>

#include <nanovdb/NanoVDB.h>

namespace
{

using Mask = nanovdb::ValueMask;
using Root = nanovdb::NanoRoot<Mask>;
using Upper = nanovdb::NanoUpper<Mask>; // 32^3 lower nodes: the whole grid, at 4096 voxels a side
using Lower = nanovdb::NanoLower<Mask>; // 16^3 leaves
using Leaf = nanovdb::NanoLeaf<Mask>;
using Coord = nanovdb::Coord;

constexpr int BLOCK = 64;      // points transformed at a time
constexpr uint32_t LOWER = 16; // blocks a side of a lower node
constexpr uint32_t LOG2_MAX = 12;

struct Blocks {
    umbt_nanovdb_block_fn state;
    const void *user;
    uint32_t side; // blocks
};

// Content of one square of blocks that a lower node would cover.
struct Square {
    Coord first; // block
    uint32_t mixed = 0;
    bool lit = false, shadowed = false;
};

Coord block_in(const Square &square, uint32_t k)
{
    return square.first + Coord(k % LOWER, k / LOWER % LOWER, k / LOWER / LOWER);
}

int block_state(const Blocks &blocks, const Coord &at, uint64_t slices[8])
{
    return std::max({at[0], at[1], at[2]}) < static_cast<int>(blocks.side)
               ? blocks.state(blocks.user, at[0], at[1], at[2], slices)
               : 1;
}

Square square_count(const Blocks &blocks, const Coord &first)
{
    Square square;
    uint64_t slices[8];
    square.first = first;
    for (uint32_t k = 0; k < LOWER * LOWER * LOWER; k++) {
        const int state = block_state(blocks, block_in(square, k), slices);
        square.mixed += state == 2;
        square.lit |= state == 1;
        square.shadowed |= state == 0;
    }
    return square;
}

void leaf_fill(Leaf &leaf, const uint64_t slices[8])
{
    for (uint32_t z = 0; z < 8; z++) {
        for (uint32_t bit = 0; bit < 64; bit++) {
            if (!(slices[z] >> bit & 1)) {
                leaf.data()->mValueMask.setOn(Leaf::CoordToOffset(Coord(bit % 8, bit / 8, z)));
            }
        }
    }
}

// Fills a lower node and takes its leaves from *leaves on.
void lower_fill(Lower &lower, const Blocks &blocks, const Square &square, Leaf *&leaves)
{
    for (uint32_t k = 0; k < LOWER * LOWER * LOWER; k++) {
        uint64_t slices[8];
        const Coord at = block_in(square, k);
        const int state = block_state(blocks, at, slices);
        const uint32_t n = Lower::CoordToOffset(Coord(8 * at[0], 8 * at[1], 8 * at[2]));
        if (state == 2) {
            leaf_fill(*leaves, slices);
            lower.data()->mChildMask.setOn(n);
            lower.data()->setChild(n, leaves++);
        } else {
            lower.data()->setValue(n, state == 0);
        }
    }
}

} // namespace

// The nodes in one block of memory, as the library lays them out: root, upper, lowers, leaves.
struct umbt_nanovdb {
    void *memory;
    size_t bytes;
    const Root *root;
    int32_t size;
    double m[3][4];
};

int umbt_nanovdb_is_built(void)
{
    return 1;
}

struct umbt_nanovdb *umbt_nanovdb_make(uint32_t log2_size, const double world[3][4],
                                       umbt_nanovdb_block_fn block, const void *user)
{
    if (log2_size > LOG2_MAX) {
        return nullptr;
    }
    const Blocks blocks = {block, user, (1U << log2_size) / 8};
    std::vector<Square> squares;
    size_t lowers = 0, leaves = 0;
    for (uint32_t z = 0; z < blocks.side; z += LOWER) {
        for (uint32_t y = 0; y < blocks.side; y += LOWER) {
            for (uint32_t x = 0; x < blocks.side; x += LOWER) {
                squares.push_back(square_count(blocks, Coord(x, y, z)));
                const Square &square = squares.back();
                lowers += square.mixed > 0 || (square.lit && square.shadowed);
                leaves += square.mixed;
            }
        }
    }
    const size_t root_bytes = Root::memUsage(1);
    const size_t bytes =
        root_bytes + sizeof(Upper) + lowers * sizeof(Lower) + leaves * sizeof(Leaf);
    auto *memory = static_cast<char *>(std::aligned_alloc(2 << 20, (bytes | ((2 << 20) - 1)) + 1));
    if (memory == nullptr) {
        return nullptr;
    }
    std::memset(memory, 0, bytes);
    auto *root = reinterpret_cast<Root *>(memory);
    auto *upper = reinterpret_cast<Upper *>(memory + root_bytes);
    auto *lower = reinterpret_cast<Lower *>(upper + 1);
    auto *leaf = reinterpret_cast<Leaf *>(lower + lowers);
    root->data()->mTableSize = 1;
    root->data()->tile(0)->setChild(Coord(0, 0, 0), upper, root->data());
    for (const Square &square : squares) {
        const Coord at(8 * square.first[0], 8 * square.first[1], 8 * square.first[2]);
        const uint32_t n = Upper::CoordToOffset(at);
        if (square.mixed > 0 || (square.lit && square.shadowed)) {
            lower_fill(*lower, blocks, square, leaf);
            upper->data()->mChildMask.setOn(n);
            upper->data()->setChild(n, lower++);
        } else {
            upper->data()->setValue(n, square.shadowed);
        }
    }
    auto *peer = new umbt_nanovdb{memory, bytes, root, 1 << log2_size, {}};
    std::copy(&world[0][0], &world[0][0] + 12, &peer->m[0][0]);
    return peer;
}

void umbt_nanovdb_destroy(struct umbt_nanovdb *peer)
{
    if (peer != nullptr) {
        std::free(peer->memory);
        delete peer;
    }
}

size_t umbt_nanovdb_bytes(const struct umbt_nanovdb *peer)
{
    return peer->bytes;
}

namespace
{

// Texels of a block of points; the transform in the product's order.
struct Placed {
    int32_t axis[3][BLOCK];
};

void place(const umbt_nanovdb &peer, const float *points, size_t count, Placed &to)
{
    double x[BLOCK], y[BLOCK], z[BLOCK];
    for (size_t i = 0; i < count; i++) {
        x[i] = points[3 * i];
        y[i] = points[3 * i + 1];
        z[i] = points[3 * i + 2];
    }
    for (int axis = 0; axis < 3; axis++) {
        const double *m = peer.m[axis];
        const double high = axis < 2 ? peer.size + 64.0 : peer.size - 1.0; // behind: the last voxel
        for (size_t i = 0; i < count; i++) {
            const double v = m[0] * x[i] + m[1] * y[i] + m[2] * z[i] + m[3];
            to.axis[axis][i] = static_cast<int32_t>(std::floor(std::min(std::max(v, -64.0), high)));
        }
    }
}

template <typename Reader> int window_by_taps(const Reader &reader, const Coord &centre, int half)
{
    int shadowed = 0;
    for (int y = centre[1] - half; y <= centre[1] + half; y++) {
        for (int x = centre[0] - half; x <= centre[0] + half; x++) {
            shadowed += reader.getValue(Coord(x, y, centre[2]));
        }
    }
    return shadowed;
}

// Counts the shadowed texels of a window's part in one leaf. Words of a mask hold columns of y, z.
template <typename Leaf> int leaf_count(const Leaf &leaf, int x0, int x1, int y0, int y1, int z)
{
    const auto *words = reinterpret_cast<const uint64_t *>(&leaf.valueMask());
    const uint64_t rows = (UINT64_MAX << 8 * y0) & (UINT64_MAX >> 8 * (7 - y1));
    const uint64_t mask = rows & UINT64_C(0x0101010101010101) << z;
    int count = 0;
    for (int x = x0; x <= x1; x++) {
        count += __builtin_popcountll(words[x] & mask);
    }
    return count;
}

template <typename Reader> int window_by_leaves(const Reader &reader, const Coord &centre, int half)
{
    const int x0 = centre[0] - half, x1 = centre[0] + half;
    const int y0 = centre[1] - half, y1 = centre[1] + half;
    int shadowed = 0;
    for (int by = y0 & ~7; by <= y1; by += 8) {
        for (int bx = x0 & ~7; bx <= x1; bx += 8) {
            const Coord at(bx, by, centre[2]);
            const int left = std::max(x0 - bx, 0), right = std::min(x1 - bx, 7);
            const int top = std::max(y0 - by, 0), bottom = std::min(y1 - by, 7);
            if (const auto *leaf = reader.probeLeaf(at)) {
                shadowed += leaf_count(*leaf, left, right, top, bottom, centre[2] & 7);
            } else if (reader.getValue(at)) {
                shadowed += (right - left + 1) * (bottom - top + 1);
            }
        }
    }
    return shadowed;
}

template <umbt_nanovdb_way WAY, int TAPS, typename Reader>
void run(const umbt_nanovdb_query &query, const Reader &reader)
{
    Placed placed;
    for (size_t first = 0; first < query.count; first += BLOCK) {
        const size_t count = std::min<size_t>(BLOCK, query.count - first);
        place(*query.peer, query.points + 3 * first, count, placed);
        for (size_t i = 0; i < count; i++) {
            const Coord at(placed.axis[0][i], placed.axis[1][i], placed.axis[2][i]);
            const int shadowed = TAPS == 1 ? static_cast<int>(reader.getValue(at))
                                 : WAY == UMBT_NANOVDB_LEAVES
                                     ? window_by_leaves(reader, at, TAPS / 2)
                                     : window_by_taps(reader, at, TAPS / 2);
            query.answers[first + i] =
                static_cast<float>(TAPS * TAPS - shadowed) / static_cast<float>(TAPS * TAPS);
        }
    }
}

template <int TAPS, typename Reader>
void run_window(const umbt_nanovdb_query &query, const Reader &reader)
{
    query.way == UMBT_NANOVDB_LEAVES ? run<UMBT_NANOVDB_LEAVES, TAPS>(query, reader)
                                     : run<UMBT_NANOVDB_ACCESSOR, TAPS>(query, reader);
}

} // namespace

void umbt_nanovdb_run(const struct umbt_nanovdb_query *query)
{
    const Root &tree = *query->peer->root;
    const nanovdb::DefaultReadAccessor<Mask> accessor(tree);
    switch (query->taps) {
    case 1:
        query->way == UMBT_NANOVDB_TREE ? run<UMBT_NANOVDB_TREE, 1>(*query, tree)
                                        : run<UMBT_NANOVDB_ACCESSOR, 1>(*query, accessor);
        break;
    case 3:
        run_window<3>(*query, accessor);
        break;
    case 5:
        run_window<5>(*query, accessor);
        break;
    case 9:
        run_window<9>(*query, accessor);
        break;
    case 17:
        run_window<17>(*query, accessor);
        break;
    default:
        break;
    }
}

// SPDX-License-Identifier: Apache-2.0
// The walk through an asset's voxels, windows of texels, and the placement of points, for GPUs.
//
// This is the one source: shaders.py makes the includes for WGSL, GLSL ES 3.00, GLSL 4.50, HLSL, CUDA and C from it. So it
// is written in what these languages share: one statement a line, no conditional expressions, literals with a suffix where
// they are unsigned, shifts by unsigned numbers, parameters that are never assigned to.
//
// The data is an array of entries of four 32-bit words (umbrage/gpu.h): entry 0 is the head. Of F frusta, entries 1 + f
// and 1 + F + f describe frustum f; grids, nodes, bricks and the words of occluder depths follow. Nodes are the wide nodes of the mapped layout (docs/reference/umb-format.md, section
// 6), with one addition for partial assets: a child whose bits are 1 in both masks is missing.
//
// A link is a cell's or child's content: 0 shadowed, 1 lit, 0xffffffff missing, else 2 plus the number of a node or brick.
//
// Counts come in pairs: x if all missing cubes are shadowed, y if all are lit. Where both are equal the answer is exact.

// What takes a position to a frustum's voxels (struct umb_gpu_placement of umbrage/gpu.h).
struct UmbragePlacement {
    ivec4 row_x; // Voxels for each unit of position, in 2^-shift; w: upper half of the voxel of position 0
    ivec4 row_y;
    ivec4 row_z;
    ivec4 row_w; // Of lamps, which are spot, point and area lights: W, the distance along the face's axis
    uvec4 low;   // Lower halves of the voxel of position 0
    ivec4 info;  // Shift of row_z less 32; frustum; 1: the automatic bias; of lamps: shift of row_w less that of row_x
    vec4 step_x; // Edge of a voxel in metres, of lamps where W is 1; w: units of position in a metre
    vec4 step_y; // w: voxels of depth that are as long as a texel is wide; of lamps: given bias in metres where W is 1
    vec4 step_z; // w: length in metres of a voxel of depth; of lamps: the same along the axis
    vec4 light;  // Direction in which the light travels; w: given bias in metres, of lamps that where W is 0
    vec4 lamp;   // Position; w: 1 if it shines to one side
    vec4 axis;   // The face's axis
};

// A position in units, if it is in range.
struct UmbrageUnits {
    ivec3 at;
    bool in_range;
};

// Where a position is looked up: its voxel, and its place in that voxel, 0 to below 1. state: 0: to be looked up; 1: lit;
// 2: shadowed, since the surface faces away.
struct UmbrageLook {
    ivec3 voxel;
    vec3 part;
    int state;
};

// A position in a face of a lamp, and the length of the bias in metres.
struct UmbrageSight {
    int face;
    float bias;
};

// Entrance to one frustum's voxels. The last four are entries.
struct UmbrageTree {
    uint size_log2;
    uint cell_level;
    uint grid;
    uint nodes;
    uint bricks;
};

// A cube of 2^level voxels a side.
struct UmbrageCube {
    uint link;
    uint level;
};

// A window: its texels, and the depth of its voxels.
struct UmbrageWindow {
    int x0;
    int y0;
    int x1;
    int y1;
    uint z;
};

// The depths of first occluders that the voxels of a frustum do not have.
struct UmbrageDepths {
    uint first; // Entry of word 0
    uint root;  // Reference to the square of the whole frustum; 0: voxels have all
    uint kind;  // 0: depths are unknown; 1: columns stay shadowed behind their first occluder; 2: the words know
};

// A search for blockers in the cone of the light's rays to a place.
struct UmbrageSearch {
    UmbrageLook place;
    float reach_x; // Texels that the cone grows in a voxel of depth
    float reach_y;
    float gaps;    // Sums of s^2 / g and of s^2 / g^2 over the samples that block
    float cover;
    uint guess;    // Depth of the blocker found last
    bool missing;  // True if a missing cube was met
};

// One axis of a box of real width: texels covered at all, texels covered wholly, and the covered part of the others.
struct UmbrageSpan {
    int low;
    int high;
    int inner_low;
    int inner_high;
    float part;
};

UmbrageTree umbrage_tree(uint frustum)
{
    uvec4 entry = umbrage_load(1u + frustum);
    UmbrageTree tree;
    tree.size_log2 = entry.x & 255u;
    tree.cell_level = entry.x >> 8u;
    tree.grid = entry.y;
    tree.nodes = entry.z;
    tree.bricks = entry.w;
    return tree;
}

uint umbrage_word(uvec4 entry, uint index)
{
    if (index == 0u) {
        return entry.x;
    }
    if (index == 1u) {
        return entry.y;
    }
    if (index == 2u) {
        return entry.z;
    }
    return entry.w;
}

bool umbrage_is_mixed(uint link)
{
    return link >= 2u && link != 0xffffffffu;
}

// Reads the cell of the grid that contains voxel (x, y, z).
uint umbrage_cell(UmbrageTree tree, uint x, uint y, uint z)
{
    uint grid_log2 = tree.size_log2 - tree.cell_level;
    uint row = (y >> tree.cell_level) + ((z >> tree.cell_level) << grid_log2);
    uint at = (x >> tree.cell_level) + (row << grid_log2);
    return umbrage_word(umbrage_load(tree.grid + (at >> 2u)), at & 3u);
}

// Reads the child of `level` that contains voxel (x, y, z), of the node that a link names.
uint umbrage_child(UmbrageTree tree, uint link, uint level, uint x, uint y, uint z)
{
    uint node = tree.nodes + ((link - 2u) >> 1u);
    uvec4 masks = umbrage_load(node);
    uint bit = ((x >> level) & 3u) | (((y >> level) & 3u) << 2u) | (((z >> level) & 1u) << 4u);
    uint mixed = masks.x;
    uint lit = masks.z;
    uint rank = 0u;
    if (((z >> level) & 2u) != 0u) {
        mixed = masks.y;
        lit = masks.w;
        rank = umbrage_bits(masks.x & ~masks.z);
    }
    uint is_lit = (lit >> bit) & 1u;
    if (((mixed >> bit) & 1u) == 0u) {
        return is_lit;
    }
    if (is_lit != 0u) {
        return 0xffffffffu;
    }
    rank += umbrage_bits(mixed & ~lit & ((1u << bit) - 1u));
    return 2u + umbrage_word(umbrage_load(node + 1u + (rank >> 2u)), rank & 3u);
}

// Descends to level `lowest`, or to the cube above it that is not mixed. `start`: a cube around voxel (x, y, z).
UmbrageCube umbrage_descend(UmbrageTree tree, UmbrageCube start, uint lowest, uint x, uint y, uint z)
{
    UmbrageCube cube;
    cube.link = start.link;
    cube.level = start.level;
    while (cube.level > lowest && umbrage_is_mixed(cube.link)) {
        cube.level -= 2u;
        cube.link = umbrage_child(tree, cube.link, cube.level, x, y, z);
    }
    return cube;
}

UmbrageCube umbrage_grid_cube(UmbrageTree tree, uint x, uint y, uint z)
{
    UmbrageCube cube;
    cube.level = tree.cell_level;
    cube.link = umbrage_cell(tree, x, y, z);
    return cube;
}

// Finds the smallest cube around a whole window inside the frustum. Its level is above that of the grid's cells if the
// window touches several cells; its link then means nothing.
UmbrageCube umbrage_around(UmbrageTree tree, UmbrageWindow window)
{
    uint x = uint(window.x0);
    uint y = uint(window.y0);
    uint spread = (x ^ uint(window.x1)) | (y ^ uint(window.y1));
    UmbrageCube cube;
    cube.level = tree.cell_level + 1u;
    cube.link = 2u;
    if ((spread >> tree.cell_level) == 0u) {
        cube = umbrage_grid_cube(tree, x, y, window.z);
        while (cube.level > 3u && umbrage_is_mixed(cube.link) && (spread >> (cube.level - 2u)) == 0u) {
            cube.level -= 2u;
            cube.link = umbrage_child(tree, cube.link, cube.level, x, y, window.z);
        }
    }
    return cube;
}

// Reads the 8x8 texels of block (bx, by) at depth z. x, y: lit texels, bit x + 8 * y; z: all ones if they are missing.
// `around`: a cube around the block, or one above the grid's cells.
uvec4 umbrage_slice(UmbrageTree tree, UmbrageCube around, int bx, int by, uint z)
{
    int side = 1 << (tree.size_log2 - 3u);
    if (bx < 0 || by < 0 || bx >= side || by >= side) {
        return uvec4(0xffffffffu, 0xffffffffu, 0u, 0u);
    }
    uint x = uint(bx) << 3u;
    uint y = uint(by) << 3u;
    UmbrageCube cube;
    cube.link = around.link;
    cube.level = around.level;
    if (around.level > tree.cell_level) {
        cube = umbrage_grid_cube(tree, x, y, z);
    }
    cube = umbrage_descend(tree, cube, 3u, x, y, z);
    if (umbrage_is_mixed(cube.link)) {
        uvec4 pair = umbrage_load(tree.bricks + ((cube.link - 2u) << 2u) + ((z & 7u) >> 1u));
        if ((z & 1u) != 0u) {
            return uvec4(pair.z, pair.w, 0u, 0u);
        }
        return uvec4(pair.x, pair.y, 0u, 0u);
    }
    if (cube.link == 0u) {
        return uvec4(0u, 0u, 0u, 0u);
    }
    if (cube.link == 1u) {
        return uvec4(0xffffffffu, 0xffffffffu, 0u, 0u);
    }
    return uvec4(0u, 0u, 0xffffffffu, 0u);
}

UmbrageWindow umbrage_window(UmbrageTree tree, ivec3 voxel, int taps)
{
    UmbrageWindow window;
    window.x0 = voxel.x - taps / 2;
    window.y0 = voxel.y - taps / 2;
    window.x1 = voxel.x + taps / 2;
    window.y1 = voxel.y + taps / 2;
    int last = (1 << tree.size_log2) - 1;
    window.z = uint(voxel.z);
    if (voxel.z > last) {
        window.z = uint(last);
    }
    return window;
}

// True if a window lies outside the frustum on x or y, or before it: all is lit there.
bool umbrage_is_outside(UmbrageTree tree, UmbrageWindow window, ivec3 voxel)
{
    int size = 1 << tree.size_log2;
    return voxel.z < 0 || window.x1 < 0 || window.y1 < 0 || window.x0 >= size || window.y0 >= size;
}

bool umbrage_is_inside(UmbrageTree tree, UmbrageWindow window)
{
    int size = 1 << tree.size_log2;
    return window.x0 >= 0 && window.y0 >= 0 && window.x1 < size && window.y1 < size;
}

// Counts of a window in a cube that is not mixed. `total`: the count of a window that is all lit.
uvec2 umbrage_uniform(uint link, uint total)
{
    if (link == 0u) {
        return uvec2(0u, 0u);
    }
    if (link == 1u) {
        return uvec2(total, total);
    }
    return uvec2(0u, total);
}

// Bytes `first` and up of a word, as a mask.
uint umbrage_bytes_from(int first)
{
    if (first <= 0) {
        return 0xffffffffu;
    }
    if (first >= 4) {
        return 0u;
    }
    return 0xffffffffu << (uint(first) << 3u);
}

// Bits of the texels of a block that lie in a window: its rows 0 to 3, and 4 to 7.
uvec2 umbrage_block_mask(UmbrageWindow window, int bx, int by)
{
    int left = window.x0 - (bx * 8);
    int right = window.x1 - (bx * 8);
    int top = window.y0 - (by * 8);
    int bottom = window.y1 - (by * 8);
    uint row = 255u;
    if (left > 0) {
        row = (row << uint(left)) & 255u;
    }
    if (right < 7) {
        row = row & (255u >> uint(7 - right));
    }
    uint rows = row * 0x01010101u;
    uint upper = umbrage_bytes_from(top) & ~umbrage_bytes_from(bottom + 1);
    uint lower = umbrage_bytes_from(top - 4) & ~umbrage_bytes_from(bottom - 3);
    return uvec2(rows & upper, rows & lower);
}

// Counts the lit texels among taps * taps around a voxel: taps is odd, 1 to 17.
uvec2 umbrage_count_box(uint frustum, ivec3 voxel, int taps)
{
    UmbrageTree tree = umbrage_tree(frustum);
    UmbrageWindow window = umbrage_window(tree, voxel, taps);
    uint total = uint(taps * taps);
    if (umbrage_is_outside(tree, window, voxel)) {
        return uvec2(total, total);
    }
    UmbrageCube around;
    around.level = 32u;
    around.link = 2u;
    if (umbrage_is_inside(tree, window)) {
        around = umbrage_around(tree, window);
        if (!umbrage_is_mixed(around.link)) {
            return umbrage_uniform(around.link, total);
        }
    }
    uint lit = 0u;
    uint missing = 0u;
    for (int by = window.y0 >> 3u; by <= (window.y1 >> 3u); by++) {
        for (int bx = window.x0 >> 3u; bx <= (window.x1 >> 3u); bx++) {
            uvec4 slice = umbrage_slice(tree, around, bx, by, window.z);
            uvec2 mask = umbrage_block_mask(window, bx, by);
            lit += umbrage_bits(slice.x & mask.x) + umbrage_bits(slice.y & mask.y);
            if (slice.z != 0u) {
                missing += umbrage_bits(mask.x) + umbrage_bits(mask.y);
            }
        }
    }
    return uvec2(lit, lit + missing);
}

// Weight of texel `index` of a tent: 1 at its ends, (taps + 1) / 2 in the middle, 0 outside.
uint umbrage_tent_weight(int index, int taps)
{
    int weight = index + 1;
    if (weight > taps - index) {
        weight = taps - index;
    }
    if (weight < 0) {
        weight = 0;
    }
    return uint(weight);
}

// Number of set bits in each byte of a word.
uint umbrage_bits_of_bytes(uint word)
{
    uint pairs = word - ((word >> 1u) & 0x55555555u);
    uint fours = (pairs & 0x33333333u) + ((pairs >> 2u) & 0x33333333u);
    return (fours + (fours >> 4u)) & 0x0f0f0f0fu;
}

// Sum of the weights of the set texels of four rows. columns: 8 texels' weights on x, bit p of each in byte p.
uint umbrage_weigh_rows(uint rows, uint columns, int index, int taps)
{
    uint sums = umbrage_bits_of_bytes(rows & ((columns & 255u) * 0x01010101u));
    sums += umbrage_bits_of_bytes(rows & (((columns >> 8u) & 255u) * 0x01010101u)) << 1u;
    sums += umbrage_bits_of_bytes(rows & (((columns >> 16u) & 255u) * 0x01010101u)) << 2u;
    sums += umbrage_bits_of_bytes(rows & ((columns >> 24u) * 0x01010101u)) << 3u;
    uint sum = (sums & 255u) * umbrage_tent_weight(index, taps);
    sum += ((sums >> 8u) & 255u) * umbrage_tent_weight(index + 1, taps);
    sum += ((sums >> 16u) & 255u) * umbrage_tent_weight(index + 2, taps);
    sum += (sums >> 24u) * umbrage_tent_weight(index + 3, taps);
    return sum;
}

// Weights on x of the 8 texels from texel `index` of a tent on: bit p of texel k is bit k of byte p.
uint umbrage_tent_columns(int index, int taps)
{
    uint columns = 0u;
    for (uint k = 0u; k < 8u; k++) {
        uint weight = umbrage_tent_weight(index + int(k), taps);
        uint spread = (weight & 1u) | ((weight & 2u) << 7u) | ((weight & 4u) << 14u) | ((weight & 8u) << 21u);
        columns |= spread << k;
    }
    return columns;
}

// Adds up the weights of a tent's lit texels, of ((taps + 1) / 2)^4 in all: taps is odd, 1 to 17.
uvec2 umbrage_count_tent(uint frustum, ivec3 voxel, int taps)
{
    UmbrageTree tree = umbrage_tree(frustum);
    UmbrageWindow window = umbrage_window(tree, voxel, taps);
    uint middle = uint(taps + 1) >> 1u;
    uint total = middle * middle * middle * middle;
    if (umbrage_is_outside(tree, window, voxel)) {
        return uvec2(total, total);
    }
    UmbrageCube around;
    around.level = 32u;
    around.link = 2u;
    if (umbrage_is_inside(tree, window)) {
        around = umbrage_around(tree, window);
        if (!umbrage_is_mixed(around.link)) {
            return umbrage_uniform(around.link, total);
        }
    }
    uint lit = 0u;
    uint missing = 0u;
    for (int bx = window.x0 >> 3u; bx <= (window.x1 >> 3u); bx++) {
        uint columns = umbrage_tent_columns((bx * 8) - window.x0, taps);
        for (int by = window.y0 >> 3u; by <= (window.y1 >> 3u); by++) {
            uvec4 slice = umbrage_slice(tree, around, bx, by, window.z);
            int row = (by * 8) - window.y0;
            lit += umbrage_weigh_rows(slice.x, columns, row, taps);
            lit += umbrage_weigh_rows(slice.y, columns, row + 4, taps);
            missing += umbrage_weigh_rows(slice.z, columns, row, taps);
            missing += umbrage_weigh_rows(slice.z, columns, row + 4, taps);
        }
    }
    return uvec2(lit, lit + missing);
}

// Looks a voxel up down to cells of 2^level voxels: level is odd, 3 or more. Counts halves: 2 lit, 1 mixed, 0 shadowed.
uvec2 umbrage_count_cell(uint frustum, ivec3 voxel, uint level)
{
    UmbrageTree tree = umbrage_tree(frustum);
    UmbrageWindow window = umbrage_window(tree, voxel, 1);
    if (umbrage_is_outside(tree, window, voxel)) {
        return uvec2(2u, 2u);
    }
    uint x = uint(voxel.x);
    uint y = uint(voxel.y);
    UmbrageCube cube = umbrage_grid_cube(tree, x, y, window.z);
    cube = umbrage_descend(tree, cube, level, x, y, window.z);
    if (umbrage_is_mixed(cube.link)) {
        return uvec2(1u, 1u);
    }
    return umbrage_uniform(cube.link, 2u);
}

// --- placement -----------------------------------------------------------------------------------------------------------
// Positions become whole numbers (units), and all that follows is in whole numbers of 64 bits: the same on every GPU,
// whatever its compiler does to floats. struct umb_gpu_placement states the bound. A number of 64 bits is its lower and
// its upper half.

uvec2 umbrage_add(uvec2 a, uvec2 b)
{
    uint low = a.x + b.x;
    uint high = a.y + b.y;
    if (low < a.x) {
        high += 1u;
    }
    return uvec2(low, high);
}

// Product of two numbers with sign.
uvec2 umbrage_multiply(int a, int b)
{
    uint ua = uint(a);
    uint ub = uint(b);
    uint low = (ua & 65535u) * (ub & 65535u);
    uint crossed = (ua >> 16u) * (ub & 65535u);
    uint other = (ua & 65535u) * (ub >> 16u);
    uint middle = (low >> 16u) + (crossed & 65535u) + (other & 65535u);
    uint high = (ua >> 16u) * (ub >> 16u) + (crossed >> 16u) + (other >> 16u) + (middle >> 16u);
    if (a < 0) {
        high -= ub;
    }
    if (b < 0) {
        high -= ua;
    }
    return uvec2((low & 65535u) | (middle << 16u), high);
}

// Number with sign times 2^count, count 1 to 63.
uvec2 umbrage_shift_left(int a, uint count)
{
    if (count >= 32u) {
        return uvec2(0u, uint(a) << (count - 32u));
    }
    return uvec2(uint(a) << count, uint(a >> (32u - count)));
}

// One coordinate of a position in units, in 2^-shift voxels. `low`: lower half of the voxel of position 0.
uvec2 umbrage_row(ivec4 row, uint low, ivec3 units)
{
    uvec2 sum = umbrage_add(uvec2(low, uint(row.w)), umbrage_multiply(row.x, units.x));
    sum = umbrage_add(sum, umbrage_multiply(row.y, units.y));
    return umbrage_add(sum, umbrage_multiply(row.z, units.z));
}

// The part behind the point of a number of 64 bits, 0 to below 1. `shift`: bits behind the point, less 32.
float umbrage_fraction(uvec2 a, uint shift)
{
    uint bits = (a.y << (32u - shift)) | (a.x >> shift);
    return float(bits >> 8u) * 0.000000059604644775390625;
}

float umbrage_dot(vec3 a, vec4 b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

// Takes a position, and its move by the bias, to units.
UmbrageUnits umbrage_units(UmbragePlacement at, vec3 position, vec3 move_by)
{
    float scale = at.step_x.w;
    vec3 p = vec3(position.x * scale, position.y * scale, position.z * scale);
    vec3 m = vec3(move_by.x * scale, move_by.y * scale, move_by.z * scale);
    float limit = 1073741824.0;
    UmbrageUnits units;
    units.at = ivec3(0, 0, 0);
    units.in_range = abs(p.x) + abs(m.x) < limit && abs(p.y) + abs(m.y) < limit && abs(p.z) + abs(m.z) < limit;
    if (units.in_range) {
        units.at = ivec3(int(p.x) + int(m.x), int(p.y) + int(m.y), int(p.z) + int(m.z));
    }
    return units;
}

// Bias of a look-up: x: shift in depth towards the light, voxels; y, z: slopes of the surface; w: move along the normal,
// in units of the normal.
vec4 umbrage_bias(UmbragePlacement at, vec3 normal, float length2, float taps, float steps)
{
    if (at.info.z != 1) {
        return vec4(0.0, 0.0, 0.0, at.light.w / sqrt(length2));
    }
    float along_x = umbrage_dot(normal, at.step_x) * steps;
    float along_y = umbrage_dot(normal, at.step_y) * steps;
    float across = abs(along_x) + abs(along_y);
    float depth = abs(umbrage_dot(normal, at.step_z)) * steps;
    float most = (2.0 * taps - 0.5) * at.step_y.w;
    float follows = 1.0;
    if (taps < 2.0) {
        follows = 0.0;
    }
    if (steps > 1.0) {
        most = 0.0;
    }
    float need = 0.5078125 * (taps * across + depth);
    float rest = need - most * depth;
    if (rest > 0.0) {
        return vec4(most, 0.0, 0.0, rest / length2);
    }
    return vec4(0.5078125 * ((taps - follows) * across + depth) / depth, follows * along_x / depth,
                follows * along_y / depth, 0.0);
}

// Moves a position, and finds its voxel. bias: what umbrage_bias gives; its w has no effect here.
UmbrageLook umbrage_seek(UmbragePlacement at, vec3 position, vec3 move_by, vec4 bias)
{
    UmbrageLook look;
    look.voxel = ivec3(0, 0, 0);
    look.part = vec3(0.0, 0.0, 0.0);
    look.state = 1;
    UmbrageUnits moved = umbrage_units(at, position, move_by);
    if (!moved.in_range) {
        return look;
    }
    ivec3 units = moved.at;
    uint shift = uint(at.info.x);
    uvec2 x = umbrage_row(at.row_x, at.low.x, units);
    uvec2 y = umbrage_row(at.row_y, at.low.y, units);
    uvec2 z = umbrage_row(at.row_z, at.low.z, units);
    look.part.x = umbrage_fraction(x, shift);
    look.part.y = umbrage_fraction(y, shift);
    float lift = bias.y * (0.5 - look.part.x) + bias.z * (0.5 - look.part.y) - bias.x;
    z = umbrage_add(z, umbrage_shift_left(int(lift * 4096.0), shift + 20u));
    look.part.z = umbrage_fraction(z, shift);
    look.voxel = ivec3(int(x.y) >> shift, int(y.y) >> shift, int(z.y) >> shift);
    look.state = 0;
    return look;
}

// The bias of a position with a normal, or without one: `normal` is then 0, 0, 0, and w is metres towards the light.
vec4 umbrage_bias_of(UmbragePlacement at, vec3 normal, float taps, float steps)
{
    float length2 = normal.x * normal.x + normal.y * normal.y + normal.z * normal.z;
    if (length2 > 0.0) {
        return umbrage_bias(at, normal, length2, taps, steps);
    }
    if (at.info.z == 1) {
        return vec4(0.0, 0.0, 0.0, 0.29318577 * (2.0 * taps + 1.0) * steps * at.step_z.w);
    }
    return vec4(0.0, 0.0, 0.0, at.light.w);
}

// The direction of the bias: the normal, or towards the light without one.
vec3 umbrage_bias_along(UmbragePlacement at, vec3 normal)
{
    if (normal.x * normal.x + normal.y * normal.y + normal.z * normal.z > 0.0) {
        return normal;
    }
    return vec3(0.0 - at.light.x, 0.0 - at.light.y, 0.0 - at.light.z);
}

// Finds where a position is looked up. `steps`: edge in voxels of the cells of the look-up.
UmbrageLook umbrage_look_steps(UmbragePlacement at, vec3 position, vec3 normal, float taps, float steps)
{
    vec3 along = umbrage_bias_along(at, normal);
    vec4 bias = umbrage_bias_of(at, normal, taps, steps);
    UmbrageLook look = umbrage_seek(at, position, vec3(along.x * bias.w, along.y * bias.w, along.z * bias.w), bias);
    if (umbrage_dot(along, at.light) >= 0.0) {
        look.state = 2;
    }
    return look;
}

// Finds the voxel at which a position is looked up. w: the state of struct UmbrageLook.
ivec4 umbrage_place_steps(UmbragePlacement at, vec3 position, vec3 normal, float taps, float steps)
{
    UmbrageLook look = umbrage_look_steps(at, position, normal, taps, steps);
    return ivec4(look.voxel.x, look.voxel.y, look.voxel.z, look.state);
}

// The same for a window of taps * taps texels.
ivec4 umbrage_place(UmbragePlacement at, vec3 position, vec3 normal, int taps)
{
    return umbrage_place_steps(at, position, normal, float(taps), 1.0);
}

// --- lamps ---------------------------------------------------------------------------------------------------------------
// A lamp has one to six faces, each with a placement. A position belongs to the face with the greatest W. Faces overlap, so
// that a window lies in one face.

// A number of 64 bits with sign times 2^count, rounded down; count is above -64. w: 1 if it has more than 53 bits.
uvec4 umbrage_scale(uvec2 a, int count)
{
    uint sign = uint(int(a.y) >> 31u);
    if (count <= -32) {
        return uvec4(uint(int(a.y) >> uint(-32 - count)), sign, 0u, 0u);
    }
    if (count < 0) {
        uint right = uint(-count);
        return uvec4((a.x >> right) | (a.y << (32u - right)), uint(int(a.y) >> right), 0u, 0u);
    }
    uint size = a.y ^ sign;
    if (count > 20 || (size >> uint(20 - count)) != 0u) {
        return uvec4(0u, 0u, 0u, 1u);
    }
    if (count == 0) {
        return uvec4(a.x, a.y, 0u, 0u);
    }
    return uvec4(a.x << uint(count), (a.y << uint(count)) | (a.x >> uint(32 - count)), 0u, 0u);
}

// Number of zero bits before the highest set bit of a word, 0 to 32.
int umbrage_leading_zeros(uint word)
{
    uint rest = word;
    int zeros = 0;
    if (rest == 0u) {
        return 32;
    }
    while ((rest >> 31u) == 0u) {
        rest = rest << 1u;
        zeros += 1;
    }
    return zeros;
}

// The whole part of a * 2^shift / w, rounded down, for w above 0; 0x40000000 if it has more than 21 bits.
int umbrage_divide(uvec2 a, uvec2 w, int shift)
{
    int zeros = umbrage_leading_zeros(w.y);
    if (w.y == 0u) {
        zeros += umbrage_leading_zeros(w.x);
    }
    int up = zeros - 33;
    uvec4 divisor = umbrage_scale(w, up);
    if (up >= 0) {
        divisor = uvec4(w.x << uint(up), 0u, 0u, 0u);
    }
    uvec4 scaled = umbrage_scale(a, shift + up);
    int high = int(scaled.y);
    if (scaled.w != 0u || high >= 1048576 || high < -1048576) {
        return 1073741824;
    }
    float estimate = (float(high) * 4294967296.0 + float(scaled.x)) / float(divisor.x);
    int whole = int(floor(estimate));
    uvec2 rest = umbrage_multiply(whole, int(divisor.x));
    rest = umbrage_add(uvec2(scaled.x, scaled.y), umbrage_add(uvec2(~rest.x, ~rest.y), uvec2(1u, 0u)));
    for (int i = 0; i < 4; i++) {
        if (int(rest.y) < 0) {
            whole -= 1;
            rest = umbrage_add(rest, uvec2(divisor.x, 0u));
        } else if (rest.y != 0u || rest.x >= divisor.x) {
            whole += 1;
            rest = umbrage_add(rest, umbrage_add(uvec2(~divisor.x, 0xffffffffu), uvec2(1u, 0u)));
        }
    }
    return whole;
}

float umbrage_dot3(vec3 a, vec3 b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

// The face with the greatest W at a place relative to the lamp.
int umbrage_face(UmbragePlacement faces[6], int count, vec3 from_lamp)
{
    int best = 0;
    float w = umbrage_dot(from_lamp, faces[0].axis);
    for (int i = 1; i < count; i++) {
        float other = umbrage_dot(from_lamp, faces[i].axis);
        if (other > w) {
            w = other;
            best = i;
        }
    }
    return best;
}

// Length of the bias in metres. along: the unit normal; without one, has_normal is false.
float umbrage_lamp_bias(UmbragePlacement at, vec3 from_lamp, vec3 along, bool has_normal, float taps, float steps)
{
    float w = umbrage_dot(from_lamp, at.axis);
    if (at.info.z != 1) {
        return at.light.w + at.step_y.w * w;
    }
    float thickness = at.step_z.w * steps;
    if (!has_normal) {
        return 0.29318577 * (2.0 * taps + 1.0) * thickness * sqrt(umbrage_dot3(from_lamp, from_lamp)) / w;
    }
    float across = abs(umbrage_dot(along, at.step_x)) + abs(umbrage_dot(along, at.step_y));
    float width = taps * steps * across;
    float depth = (abs(umbrage_dot3(along, from_lamp)) / w + 0.5 * width) * thickness;
    float growth = 0.5 * width * umbrage_dot(along, at.axis);
    float rest = 1.0;
    if (growth > 0.0) {
        rest = 1.0 - growth;
    }
    if (rest < 0.25) {
        rest = 0.25;
    }
    return 0.5078125 * (width * w + depth) / rest;
}

// The direction in which the bias moves a position: its unit normal, or to the lamp without one.
vec3 umbrage_lamp_direction(vec3 from_lamp, vec3 normal)
{
    float length2 = umbrage_dot3(normal, normal);
    vec3 along = vec3(0.0 - from_lamp.x, 0.0 - from_lamp.y, 0.0 - from_lamp.z);
    float scale = 0.0;
    if (length2 > 0.0) {
        along = normal;
        scale = 1.0 / sqrt(length2);
    } else if (umbrage_dot3(from_lamp, from_lamp) > 0.0) {
        scale = 1.0 / sqrt(umbrage_dot3(from_lamp, from_lamp));
    }
    return vec3(along.x * scale, along.y * scale, along.z * scale);
}

// Finds face and bias of a position. If the bias leads into another face, it suffices for the voxels of both.
UmbrageSight umbrage_sight(UmbragePlacement faces[6], int count, vec3 from_lamp, vec3 normal, float taps, float steps)
{
    UmbrageSight sight;
    sight.face = umbrage_face(faces, count, from_lamp);
    sight.bias = 0.0;
    vec3 along = umbrage_lamp_direction(from_lamp, normal);
    bool has_normal = umbrage_dot3(normal, normal) > 0.0;
    for (int i = 0; i < 2; i++) {
        if (umbrage_dot(from_lamp, faces[sight.face].axis) > 0.0) {
            float bias = umbrage_lamp_bias(faces[sight.face], from_lamp, along, has_normal, taps, steps);
            if (bias > sight.bias) {
                sight.bias = bias;
            }
            sight.face = umbrage_face(faces, count, vec3(from_lamp.x + along.x * sight.bias,
                                                        from_lamp.y + along.y * sight.bias,
                                                        from_lamp.z + along.z * sight.bias));
        }
    }
    return sight;
}

// Finds the voxel of a position that moves by `bias` along a unit vector, in a face. w: as of umbrage_place.
ivec4 umbrage_place_face(UmbragePlacement at, vec3 position, vec3 along, float bias)
{
    UmbrageUnits moved = umbrage_units(at, position, vec3(along.x * bias, along.y * bias, along.z * bias));
    if (!moved.in_range) {
        return ivec4(0, 0, 0, 1);
    }
    ivec3 units = moved.at;
    uvec2 w = umbrage_row(at.row_w, at.low.w, units);
    if (int(w.y) < 0 || (w.x == 0u && w.y == 0u)) {
        return ivec4(0, 0, 0, 1);
    }
    int x = umbrage_divide(umbrage_row(at.row_x, at.low.x, units), w, at.info.w);
    int y = umbrage_divide(umbrage_row(at.row_y, at.low.y, units), w, at.info.w);
    uvec2 z = umbrage_row(at.row_z, at.low.z, units);
    return ivec4(x, y, int(z.y) >> uint(at.info.x), 0);
}

// Finds the voxel at which a position is looked up under a lamp of `count` faces. w: 0: to be looked up, and 4 times the
// face; 1: lit; 2: shadowed.
ivec4 umbrage_place_lamp(UmbragePlacement faces[6], int count, vec3 position, vec3 normal, float taps, float steps)
{
    vec4 lamp = faces[0].lamp;
    vec3 from_lamp = vec3(position.x - lamp.x, position.y - lamp.y, position.z - lamp.z);
    bool has_normal = umbrage_dot3(normal, normal) > 0.0;
    if (has_normal && umbrage_dot3(normal, from_lamp) >= 0.0) {
        return ivec4(0, 0, 0, 2);
    }
    if (lamp.w > 0.0 && !(umbrage_dot(from_lamp, faces[0].light) > 0.0)) {
        return ivec4(0, 0, 0, 2);
    }
    UmbrageSight sight = umbrage_sight(faces, count, from_lamp, normal, taps, steps);
    vec3 along = umbrage_lamp_direction(from_lamp, normal);
    ivec4 place = umbrage_place_face(faces[sight.face], position, along, sight.bias);
    return ivec4(place.x, place.y, place.z, place.w + 4 * sight.face);
}

// --- occluder depths -----------------------------------------------------------------------------------------------------
// The words of docs/reference/umb-format.md, section 3: a tree of squares of 8 x 8 down to planes.

UmbrageDepths umbrage_depths(uint frustum)
{
    uvec4 head = umbrage_load(0u);
    uvec4 entry = umbrage_load(1u + head.z + frustum);
    UmbrageDepths depths;
    depths.first = entry.x;
    depths.root = entry.y;
    depths.kind = entry.z;
    return depths;
}

uint umbrage_depth_word(uint first, uint index)
{
    return umbrage_word(umbrage_load(first + (index >> 2u)), index & 3u);
}

// Reads bit `bit` of the mask of 64 bits at word `at`.
bool umbrage_depth_bit(uint first, uint at, uint bit)
{
    return ((umbrage_depth_word(first, at + (bit >> 5u)) >> (bit & 31u)) & 1u) != 0u;
}

// Number of set bits below `bit` in that mask.
uint umbrage_depth_rank(uint first, uint at, uint bit)
{
    uint below = (1u << (bit & 31u)) - 1u;
    uint low = umbrage_depth_word(first, at);
    if (bit < 32u) {
        return umbrage_bits(low & below);
    }
    return umbrage_bits(low) + umbrage_bits(umbrage_depth_word(first, at + 1u) & below);
}

// Height of a plane of 64 texels a side at texel (x, y).
int umbrage_wide_plane(uint first, uint at, uint x, uint y)
{
    uvec2 sum = uvec2(umbrage_depth_word(first, at), umbrage_depth_word(first, at + 1u));
    sum = umbrage_add(sum, umbrage_multiply(int(umbrage_depth_word(first, at + 2u)), int(x)));
    sum = umbrage_add(sum, umbrage_multiply(int(umbrage_depth_word(first, at + 3u)), int(y)));
    return int((sum.y << 12u) | (sum.x >> 20u));
}

// Height of a plane of 8 texels a side at texel (x, y).
int umbrage_narrow_plane(uint first, uint at, uint x, uint y)
{
    uvec2 sum = umbrage_multiply(int(umbrage_depth_word(first, at)), 1);
    sum = umbrage_add(sum, umbrage_multiply(int(umbrage_depth_word(first, at + 1u)), int(x)));
    sum = umbrage_add(sum, umbrage_multiply(int(umbrage_depth_word(first, at + 2u)), int(y)));
    return int((sum.y << 20u) | (sum.x >> 12u));
}

// Number `index` of an array of `width` bits each, 1 to 20.
uint umbrage_residual(uint first, uint at, uint width, uint index)
{
    uint bit = index * width;
    uint begin = bit & 31u;
    uint value = umbrage_depth_word(first, at + (bit >> 5u)) >> begin;
    if (begin + width > 32u) {
        value |= umbrage_depth_word(first, at + (bit >> 5u) + 1u) << (32u - begin);
    }
    return value & ((1u << width) - 1u);
}

// Depth that a block's record gives at texel (x, y) of its square; -1: the voxels have it.
int umbrage_block_depth(uint first, uint reference, uint planes, uint x, uint y)
{
    uint at = reference & 67108863u;
    uint kind = reference >> 26u;
    uint texel = (x & 7u) + ((y & 7u) << 3u);
    if (kind < 32u && kind > 24u) {
        uint plane = umbrage_residual(first, at, kind - 24u, texel);
        if (plane == 0u) {
            return -1;
        }
        return umbrage_wide_plane(first, planes + (plane - 1u) * 6u, x, y);
    }
    uint next = at + 3u;
    if (kind >= 32u) {
        if (!umbrage_depth_bit(first, next, texel)) {
            return -1;
        }
        next += 2u;
    }
    int depth = umbrage_narrow_plane(first, at, x & 7u, y & 7u);
    if ((kind & 31u) != 0u) {
        depth -= int(umbrage_residual(first, next, kind & 31u, texel));
    }
    return depth;
}

// Depth that a square of several planes gives at its texel (x, y); -1: the voxels have it.
int umbrage_square_depth(uint first, uint at, uint x, uint y)
{
    uint bit = (x >> 3u) + ((y >> 3u) << 3u);
    uint count = umbrage_depth_word(first, at);
    for (uint i = 0u; i < count; i++) {
        uint plane = at + 1u + i * 6u;
        if (umbrage_depth_bit(first, plane + 4u, bit)) {
            return umbrage_wide_plane(first, plane, x, y);
        }
    }
    uint rest = at + 1u + count * 6u;
    if (!umbrage_depth_bit(first, rest, bit)) {
        return -1;
    }
    uint reference = umbrage_depth_word(first, rest + 2u + umbrage_depth_rank(first, rest, bit));
    return umbrage_block_depth(first, reference, at + 1u, x, y);
}

// Depth of the first occluder of column (x, y), if words tell it; -1: the voxels have it.
int umbrage_stored_depth(UmbrageDepths depths, uint size_log2, uint x, uint y)
{
    uint reference = depths.root;
    uint level = ((size_log2 + 2u) / 3u) * 3u;
    while (reference >> 26u == 63u) {
        level -= 3u;
        uint at = reference & 67108863u;
        uint child = ((x >> level) & 7u) + (((y >> level) & 7u) << 3u);
        if (!umbrage_depth_bit(depths.first, at, child)) {
            return -1;
        }
        reference = umbrage_depth_word(depths.first, at + 2u + umbrage_depth_rank(depths.first, at, child));
    }
    if (reference == 0u) {
        return -1;
    }
    if (reference >> 26u == 0u) {
        return umbrage_wide_plane(depths.first, reference & 67108863u, x & 63u, y & 63u);
    }
    return umbrage_square_depth(depths.first, reference & 67108863u, x & 63u, y & 63u);
}

// --- penumbras -----------------------------------------------------------------------------------------------------------
// Percentage closer soft shadows under suns, as the core computes them in doubles (client/core/query/penumbra.c): a search
// of the cone of the light's rays finds how far blockers are, and a box as wide as the penumbra gives the answer.

// The largest cube around a voxel that is not mixed, or the voxel: level 0.
UmbrageCube umbrage_uniform_cube(UmbrageTree tree, uint x, uint y, uint z)
{
    UmbrageCube cube = umbrage_grid_cube(tree, x, y, z);
    cube = umbrage_descend(tree, cube, 3u, x, y, z);
    if (umbrage_is_mixed(cube.link)) {
        uvec4 pair = umbrage_load(tree.bricks + ((cube.link - 2u) << 2u) + ((z & 7u) >> 1u));
        uint rows = umbrage_word(pair, ((z & 1u) << 1u) | ((y >> 2u) & 1u));
        cube.link = (rows >> ((x & 7u) | ((y & 3u) << 3u))) & 1u;
        cube.level = 0u;
    }
    return cube;
}

// Depth of the first shadowed voxel of a column at `limit` or before; -1: there is none; -2: a missing cube was met.
int umbrage_first_occluder(UmbrageTree tree, UmbrageDepths depths, uint x, uint y, uint limit, uint guess)
{
    if (depths.kind == 2u) {
        int stored = umbrage_stored_depth(depths, tree.size_log2, x, y);
        if (stored > int(limit)) {
            return -1;
        }
        if (stored >= 0) {
            return stored;
        }
    }
    UmbrageCube cube = umbrage_uniform_cube(tree, x, y, limit);
    if (cube.link == 1u) {
        return -1;
    }
    uint low = 0u;
    uint high = limit & ~((1u << cube.level) - 1u);
    uint probe = high >> 1u;
    if (guess < high) {
        probe = guess;
    }
    while (low < high && cube.link < 2u) {
        cube = umbrage_uniform_cube(tree, x, y, probe);
        uint begin = probe & ~((1u << cube.level) - 1u);
        if (cube.link == 1u) {
            low = begin + (1u << cube.level);
        } else {
            high = begin;
        }
        probe = low + ((high - low) >> 1u);
    }
    if (cube.link > 1u) {
        return -2;
    }
    return int(high);
}

// Least distance before a place, in voxels of depth, at which the cone reaches the texel `offset` texels away.
float umbrage_cone_gap(int offset, float part, float reach)
{
    float away = abs(float(offset) + 0.5 - part) - 0.5;
    if (away > 0.0) {
        return away / reach;
    }
    return 0.0;
}

// The last voxel of depth whose centre is at least `gap` before a place; below 0: none.
int umbrage_depth_limit(UmbrageLook place, float gap, int last)
{
    if (gap > 16777216.0) {
        return -1;
    }
    int limit = place.voxel.z + int(floor(place.part.z - gap - 0.5));
    if (limit > last) {
        return last;
    }
    return limit;
}

// Samples a column, which stands for stride * stride columns.
UmbrageSearch umbrage_sample(UmbrageTree tree, UmbrageDepths depths, UmbrageSearch before, int i, int j, float stride)
{
    UmbrageSearch search = before;
    UmbrageLook place = before.place;
    int last = (1 << tree.size_log2) - 1;
    int x = place.voxel.x + i;
    int y = place.voxel.y + j;
    if (x < 0 || y < 0 || x > last || y > last) {
        return search;
    }
    float gap = umbrage_cone_gap(i, place.part.x, before.reach_x);
    float other = umbrage_cone_gap(j, place.part.y, before.reach_y);
    if (other > gap) {
        gap = other;
    }
    int limit = umbrage_depth_limit(place, gap, last);
    if (limit < 0) {
        return search;
    }
    int depth = umbrage_first_occluder(tree, depths, uint(x), uint(y), uint(limit), before.guess);
    if (depth == -2) {
        search.missing = true;
    }
    if (depth >= 0) {
        float distance = float(place.voxel.z - depth) + place.part.z - 0.5;
        if (distance < 0.00000095367431640625) {
            distance = 0.00000095367431640625;
        }
        search.gaps += stride * stride / distance;
        search.cover += stride * stride / distance / distance;
        search.guess = uint(depth);
    }
    return search;
}

// True if one cube proves that no column up to `outer` texels away has a blocker at depth `limit` or before.
bool umbrage_is_clear(UmbrageTree tree, UmbrageDepths depths, ivec3 voxel, int outer, int limit)
{
    UmbrageWindow window;
    window.x0 = voxel.x - outer;
    window.y0 = voxel.y - outer;
    window.x1 = voxel.x + outer;
    window.y1 = voxel.y + outer;
    window.z = uint(limit);
    if (depths.kind != 1u || !umbrage_is_inside(tree, window)) {
        return false;
    }
    UmbrageCube around = umbrage_around(tree, window);
    return around.link == 1u;
}

// Searches rings of columns around a place: at distances 0, 1, 2, 3 to 4, 5 to 8 and so on up to 1024 texels. Each ring has
// at most 56 samples.
UmbrageSearch umbrage_search(UmbrageTree tree, UmbrageDepths depths, UmbrageSearch start)
{
    UmbrageSearch search = umbrage_sample(tree, depths, start, 0, 0, 1.0);
    float reach = start.reach_x;
    if (start.reach_y > reach) {
        reach = start.reach_y;
    }
    int limit = 0;
    for (int outer = 1; outer <= 1024 && limit >= 0; outer += outer) {
        int stride = 1;
        if (outer > 4) {
            stride = outer / 4;
        }
        int inner = (outer / 2) / stride;
        int end = outer / stride;
        limit = umbrage_depth_limit(start.place, float(outer / 2) / reach, (1 << tree.size_log2) - 1);
        if (limit >= 0 && !umbrage_is_clear(tree, depths, start.place.voxel, outer, limit)) {
            for (int j = 0 - end; j <= end; j++) {
                for (int i = 0 - end; i <= end; i++) {
                    if (i < 0 - inner || i > inner || j < 0 - inner || j > inner) {
                        search = umbrage_sample(tree, depths, search, i * stride, j * stride, float(stride));
                    }
                }
            }
        }
    }
    return search;
}

UmbrageSpan umbrage_span(int middle, float width)
{
    int inner = int((width - 1.0) * 0.5);
    UmbrageSpan span;
    span.part = (width - float(2 * inner + 1)) * 0.5;
    span.inner_low = middle - inner;
    span.inner_high = middle + inner;
    span.low = span.inner_low;
    span.high = span.inner_high;
    if (span.part > 0.0) {
        span.low -= 1;
        span.high += 1;
    }
    return span;
}

// Sum of the weights of the texels begin .. end of an axis.
float umbrage_span_weight(UmbrageSpan span, int begin, int end)
{
    float sum = 0.0;
    int low = begin;
    int high = end;
    if (span.low < span.inner_low) {
        if (begin <= span.low && end >= span.low) {
            sum += span.part;
        }
        if (begin <= span.high && end >= span.high) {
            sum += span.part;
        }
    }
    if (low < span.inner_low) {
        low = span.inner_low;
    }
    if (high > span.inner_high) {
        high = span.inner_high;
    }
    if (high >= low) {
        sum += float(high - low + 1);
    }
    return sum;
}

// Sum of the weights of the lit texels of a brick's slice. rows: its 64 bits; x, y: its first texel.
float umbrage_weigh_slice(UmbrageSpan across, UmbrageSpan down, uvec2 rows, int x, int y)
{
    UmbrageWindow inner;
    inner.x0 = across.inner_low;
    inner.x1 = across.inner_high;
    inner.y0 = y;
    inner.y1 = y;
    inner.z = 0u;
    float sum = 0.0;
    for (int row = 0; row < 8; row++) {
        uint bits = (rows.x >> (uint(row & 3) << 3u)) & 255u;
        if (row > 3) {
            bits = (rows.y >> (uint(row & 3) << 3u)) & 255u;
        }
        uvec2 mask = umbrage_block_mask(inner, x >> 3u, y >> 3u);
        float lit = float(umbrage_bits(bits & mask.x));
        if (across.low < across.inner_low) {
            if (across.low >= x && across.low < x + 8) {
                lit += across.part * float((bits >> uint(across.low - x)) & 1u);
            }
            if (across.high >= x && across.high < x + 8) {
                lit += across.part * float((bits >> uint(across.high - x)) & 1u);
            }
        }
        sum += lit * umbrage_span_weight(down, y + row, y + row);
    }
    return sum;
}

// Lit share of a box at one depth: x; y: 1 if it met a missing cube.
vec2 umbrage_box_share(UmbrageTree tree, UmbrageSpan across, UmbrageSpan down, int depth)
{
    int size = 1 << tree.size_log2;
    uint z = uint(depth);
    if (depth >= size) {
        z = uint(size - 1);
    }
    float lit = 0.0;
    float missing = 0.0;
    for (int by = down.low >> 3u; by <= (down.high >> 3u); by++) {
        int y = by * 8;
        float rows = umbrage_span_weight(down, y, y + 7);
        int x = (across.low >> 3u) * 8;
        while (x <= across.high) {
            int next = x + 8;
            if (x < 0 || y < 0 || x >= size || y >= size) {
                lit += rows * umbrage_span_weight(across, x, x + 7);
            } else {
                UmbrageCube cube = umbrage_grid_cube(tree, uint(x), uint(y), z);
                cube = umbrage_descend(tree, cube, 3u, uint(x), uint(y), z);
                next = (x | ((1 << cube.level) - 1)) + 1;
                if (umbrage_is_mixed(cube.link)) {
                    uvec4 slice = umbrage_slice(tree, cube, x >> 3u, by, z);
                    lit += umbrage_weigh_slice(across, down, uvec2(slice.x, slice.y), x, y);
                } else if (cube.link == 1u) {
                    lit += rows * umbrage_span_weight(across, x, next - 1);
                } else if (cube.link != 0u) {
                    missing = 1.0;
                }
            }
            x = next;
        }
    }
    float width = umbrage_span_weight(across, across.low, across.high);
    return vec2(lit / (width * umbrage_span_weight(down, down.low, down.high)), missing);
}

// Width in texels of the box for a gap of depth between a place and its blockers.
float umbrage_penumbra_width(float reach, float gap, int taps)
{
    float width = 1.77245385 * reach * gap;
    if (width > 2047.0) {
        width = 2047.0;
    }
    if (width < float(taps)) {
        width = float(taps);
    }
    return width;
}

// Slope of a surface: x, y: voxels of depth that it gains a texel. normal 0, 0, 0: 1.
vec2 umbrage_slope(UmbragePlacement at, vec3 normal)
{
    float depth = abs(umbrage_dot(normal, at.step_z));
    if (at.info.z != 1) {
        return vec2(0.0, 0.0);
    }
    if (depth == 0.0) {
        return vec2(1.0, 1.0);
    }
    return vec2(abs(umbrage_dot(normal, at.step_x)) / depth, abs(umbrage_dot(normal, at.step_y)) / depth);
}

// Share of light at a place: x if all missing cubes are shadowed, y if all are lit. extent: angular diameter, radians.
vec2 umbrage_penumbra_at(UmbragePlacement at, UmbrageLook place, vec2 slope, int taps, float extent)
{
    uint frustum = uint(at.info.y);
    UmbrageTree tree = umbrage_tree(frustum);
    UmbrageDepths depths = umbrage_depths(frustum);
    if (place.voxel.z < 0) {
        return vec2(1.0, 1.0);
    }
    float grows = tan(extent * 0.5) * sqrt(umbrage_dot(vec3(at.step_z.x, at.step_z.y, at.step_z.z), at.step_z));
    UmbrageSearch search;
    search.place = place;
    search.reach_x = grows / sqrt(umbrage_dot(vec3(at.step_x.x, at.step_x.y, at.step_x.z), at.step_x));
    search.reach_y = grows / sqrt(umbrage_dot(vec3(at.step_y.x, at.step_y.y, at.step_y.z), at.step_y));
    search.gaps = 0.0;
    search.cover = 0.0;
    search.guess = 0xffffffffu;
    search.missing = false;
    if (depths.kind != 0u) {
        search = umbrage_search(tree, depths, search);
    }
    float gap = 0.0;
    float lift = 0.0;
    if (search.cover > 0.0) {
        gap = search.gaps / search.cover;
    }
    float width = umbrage_penumbra_width(search.reach_x, gap, taps);
    float height = umbrage_penumbra_width(search.reach_y, gap, taps);
    if (gap > 0.0) {
        lift = 0.5 * (slope.x * (width + 2.0 - float(taps)) + slope.y * (height + 2.0 - float(taps)));
    }
    if (lift > 0.5 * gap) {
        lift = 0.5 * gap;
    }
    int depth = place.voxel.z + int(floor(place.part.z - lift));
    if (depth < 0) {
        return vec2(1.0, 1.0);
    }
    vec2 share = umbrage_box_share(tree, umbrage_span(place.voxel.x, width), umbrage_span(place.voxel.y, height), depth);
    if (search.missing || share.y > 0.0) {
        return vec2(0.0, 1.0);
    }
    return vec2(share.x, share.x);
}

// --- footprints ----------------------------------------------------------------------------------------------------------

// A unit vector along the surface whose unit normal is given.
vec3 umbrage_across(vec3 normal)
{
    vec3 axis = vec3(1.0, 0.0, 0.0);
    float least = normal.x;
    if (abs(normal.y) < abs(least)) {
        axis = vec3(0.0, 1.0, 0.0);
        least = normal.y;
    }
    if (abs(normal.z) < abs(least)) {
        axis = vec3(0.0, 0.0, 1.0);
        least = normal.z;
    }
    vec3 along = vec3(axis.x - least * normal.x, axis.y - least * normal.y, axis.z - least * normal.z);
    float scale = 1.0 / sqrt(umbrage_dot3(along, along));
    return vec3(along.x * scale, along.y * scale, along.z * scale);
}

// Mean of 32 look-ups over a square of the surface, `side` metres wide.
vec2 umbrage_square(UmbragePlacement at, vec3 position, vec3 normal, float side)
{
    vec3 along = umbrage_bias_along(at, normal);
    vec4 bias = umbrage_bias_of(at, normal, 1.0, 1.0);
    float scale = 1.0 / sqrt(umbrage_dot3(along, along));
    vec3 up = vec3(along.x * scale, along.y * scale, along.z * scale);
    vec3 a = umbrage_across(up);
    vec3 b = vec3(up.y * a.z - up.z * a.y, up.z * a.x - up.x * a.z, up.x * a.y - up.y * a.x);
    float lift = 0.0;
    if (at.info.z == 1) {
        lift = 0.5 * side;
    }
    uint low = 0u;
    uint high = 0u;
    for (uint k = 0u; k < 32u; k++) {
        float u = ((float(k) + 0.5) * 0.03125 - 0.5) * side;
        float v = ((float((k * 25u) & 31u) + 0.5) * 0.03125 - 0.5) * side;
        vec3 move_by = vec3(along.x * bias.w + u * a.x + v * b.x - lift * at.light.x,
                            along.y * bias.w + u * a.y + v * b.y - lift * at.light.y,
                            along.z * bias.w + u * a.z + v * b.z - lift * at.light.z);
        UmbrageLook look = umbrage_seek(at, position, move_by, vec4(bias.x, 0.0, 0.0, 0.0));
        uvec2 lit = uvec2(1u, 1u);
        if (look.state == 0) {
            lit = umbrage_count_box(uint(at.info.y), look.voxel, 1);
        }
        low += lit.x;
        high += lit.y;
    }
    return vec2(float(low) * 0.03125, float(high) * 0.03125);
}

// --- answers -------------------------------------------------------------------------------------------------------------
// Share of light at a position, 0 to 1: x if all missing cubes are shadowed, y if all are lit. normal: 0, 0, 0: none.

vec2 umbrage_box(UmbragePlacement at, vec3 position, vec3 normal, int taps)
{
    ivec4 place = umbrage_place(at, position, normal, taps);
    if (place.w != 0) {
        return vec2(float(2 - place.w), float(2 - place.w));
    }
    uvec2 count = umbrage_count_box(uint(at.info.y), ivec3(place.x, place.y, place.z), taps);
    float total = float(taps * taps);
    return vec2(float(count.x) / total, float(count.y) / total);
}

vec2 umbrage_tent(UmbragePlacement at, vec3 position, vec3 normal, int taps)
{
    ivec4 place = umbrage_place(at, position, normal, taps);
    if (place.w != 0) {
        return vec2(float(2 - place.w), float(2 - place.w));
    }
    uvec2 count = umbrage_count_tent(uint(at.info.y), ivec3(place.x, place.y, place.z), taps);
    float middle = float((taps + 1) / 2);
    float total = middle * middle * middle * middle;
    return vec2(float(count.x) / total, float(count.y) / total);
}

// Stops at cells of 2^level voxels: 0.5 where both lit and shadowed voxels are in the cell.
vec2 umbrage_coarse(UmbragePlacement at, vec3 position, vec3 normal, uint level)
{
    ivec4 place = umbrage_place_steps(at, position, normal, 1.0, float(2u << level));
    if (place.w != 0) {
        return vec2(float(2 - place.w), float(2 - place.w));
    }
    uvec2 count = umbrage_count_cell(uint(at.info.y), ivec3(place.x, place.y, place.z), level);
    return vec2(float(count.x) * 0.5, float(count.y) * 0.5);
}

// Mean over a square of the surface, `side` metres wide, that a pixel sees: `taps` texels or wider.
vec2 umbrage_footprint(UmbragePlacement at, vec3 position, vec3 normal, int taps, float side)
{
    float texel = sqrt(umbrage_dot(vec3(at.step_x.x, at.step_x.y, at.step_x.z), at.step_x));
    texel += sqrt(umbrage_dot(vec3(at.step_y.x, at.step_y.y, at.step_y.z), at.step_y));
    float level = 0.5 * texel * float(taps);
    if (!(side > level) || umbrage_dot(normal, at.light) > 0.0) {
        return umbrage_box(at, position, normal, taps);
    }
    float least = level;
    for (int i = 0; i < 39 && level + level <= side; i++) {
        level += level;
    }
    vec2 above = umbrage_square(at, position, normal, level + level);
    vec2 below = above;
    if (level > least) {
        below = umbrage_square(at, position, normal, level);
    } else {
        below = umbrage_box(at, position, normal, taps);
    }
    float weight = (side - level) / level;
    if (weight > 1.0) {
        weight = 1.0;
    }
    return vec2(below.x + weight * (above.x - below.x), below.y + weight * (above.y - below.y));
}

// The penumbra of a sun with an angular diameter of `extent` radians, `taps` texels or wider. Of a partial asset 0, 1 where
// the search or the box meets a missing cube.
vec2 umbrage_penumbra(UmbragePlacement at, vec3 position, vec3 normal, int taps, float extent)
{
    UmbrageLook place = umbrage_look_steps(at, position, normal, float(taps), 1.0);
    if (place.state != 0) {
        return vec2(float(2 - place.state), float(2 - place.state));
    }
    return umbrage_penumbra_at(at, place, umbrage_slope(at, normal), taps, extent);
}

// Under a lamp of `count` faces, 1 to 6.
vec2 umbrage_lamp_box(UmbragePlacement faces[6], int count, vec3 position, vec3 normal, int taps)
{
    ivec4 place = umbrage_place_lamp(faces, count, position, normal, float(taps), 1.0);
    int state = place.w & 3;
    if (state != 0) {
        return vec2(float(2 - state), float(2 - state));
    }
    uint frustum = uint(faces[place.w >> 2u].info.y);
    uvec2 lit = umbrage_count_box(frustum, ivec3(place.x, place.y, place.z), taps);
    float total = float(taps * taps);
    return vec2(float(lit.x) / total, float(lit.y) / total);
}
